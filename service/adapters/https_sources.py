"""Fetch files from servers that the operator allows, and from nowhere else.

An address is resolved once, checked, and connected to as it was resolved: a name that points elsewhere a moment later
leads nowhere. Redirects are not followed, proxies of the environment not used.
"""

import asyncio
import ipaddress
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import httpx

from service.errors import SourceRefusedError
from service.ports import RemoteFile
from service.settings import Settings
from service.use_cases.file_names import clean_filename

MAX_HREF = 2000
CONNECT_WITHIN_S = 10.0
PORTS = {"https": 443, "http": 80}
DISGUISED = tuple(map(ipaddress.ip_network, ("64:ff9b::/96", "64:ff9b:1::/48", "2002::/16", "2001::/32")))
"""Networks of IPv6 whose addresses stand for others of IPv4."""


class HttpsSources:
    """Reach files by HTTP.

    Parameters
    ----------
    settings
        With the allowed beginnings of addresses.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._allowed = [httpx.URL(text.strip()) for text in settings.allowed_sources.split(",") if text.strip()]

    def check(self, href: str) -> None:
        """Refuse an address that is not allowed, without asking anybody.

        Raises
        ------
        SourceRefusedError
            With the reason.
        """
        self._checked(href)

    @asynccontextmanager
    async def opened(self, href: str) -> AsyncIterator[RemoteFile]:
        """Begin to fetch a file.

        Raises
        ------
        SourceRefusedError
            It is not allowed, not there, or not reached; also while its bytes are read.
        """
        url = self._checked(href)
        name = clean_filename(url.path)
        if not name:
            raise SourceRefusedError(href, "the address must end with the file's name, whose ending tells the format")
        address = await self._resolved(url, href)
        pinned = url.copy_with(host=address, port=url.port or PORTS[url.scheme])
        headers = {"Host": url.netloc.decode("ascii"), "Accept-Encoding": "identity", "User-Agent": "tieline"}
        timeout = httpx.Timeout(CONNECT_WITHIN_S, read=self._settings.body_timeout_s)
        try:
            async with (
                httpx.AsyncClient(trust_env=False, follow_redirects=False, timeout=timeout) as client,
                client.stream("GET", pinned, headers=headers, extensions={"sni_hostname": url.host}) as answer,
            ):
                _require_content(answer, href)
                length = answer.headers.get("content-length", "")
                yield RemoteFile(name, answer.aiter_raw(), int(length) if length.isdigit() else None)
        except (httpx.HTTPError, OSError) as error:
            raise SourceRefusedError(href, f"it could not be fetched: {error or type(error).__name__}") from None

    def _checked(self, href: str) -> httpx.URL:
        if not self._allowed:
            raise SourceRefusedError(
                href, "this service fetches no files; its operator can allow sources by TIELINE_ALLOWED_SOURCES"
            )
        if len(href) > MAX_HREF:
            raise SourceRefusedError(f"{href[:50]}…", f"the address has more than {MAX_HREF} characters")
        try:
            url = httpx.URL(href)
        except httpx.InvalidURL as error:
            raise SourceRefusedError(href, f"this is no address: {error}") from None
        if url.scheme not in PORTS or not url.host or url.userinfo:
            raise SourceRefusedError(href, "an address of the form https://host/path without a user name is expected")
        if not any(_lies_below(url, beginning) for beginning in self._allowed):
            raise SourceRefusedError(href, "it is none of the sources that the operator of this service allows")
        return url

    async def _resolved(self, url: httpx.URL, href: str) -> str:
        """Give the address to connect to."""
        loop = asyncio.get_running_loop()
        try:
            found = await loop.getaddrinfo(url.host, url.port or PORTS[url.scheme], type=socket.SOCK_STREAM)
        except OSError as error:
            raise SourceRefusedError(href, f"the name of its host cannot be resolved: {error}") from None
        addresses = [str(each[4][0]) for each in found]
        if not self._settings.allow_private_sources and not all(map(is_public, addresses)):
            raise SourceRefusedError(href, "its host is not on the public internet")
        return addresses[0]


def is_public(address: str) -> bool:
    """Tell whether an address belongs to the public internet, also when it stands for another one."""
    ip = ipaddress.ip_address(address.partition("%")[0])
    if isinstance(ip, ipaddress.IPv6Address):
        if ip.ipv4_mapped is not None:
            return is_public(str(ip.ipv4_mapped))
        if any(ip in network for network in DISGUISED):
            return False
    return ip.is_global and not ip.is_multicast


def _lies_below(url: httpx.URL, beginning: httpx.URL) -> bool:
    if (url.scheme, url.host, url.port) != (beginning.scheme, beginning.host, beginning.port):
        return False
    if "\\" in url.path or any(part in {".", ".."} for part in url.path.split("/")):
        return False
    return url.path.startswith(beginning.path.rstrip("/") + "/")


def _require_content(answer: httpx.Response, href: str) -> None:
    if answer.has_redirect_location or answer.is_redirect:
        raise SourceRefusedError(href, "it leads elsewhere, and redirects are not followed; give the final address")
    if answer.status_code != httpx.codes.OK:
        raise SourceRefusedError(href, f"its server answered {answer.status_code} {answer.reason_phrase}".strip())
    if answer.headers.get("content-encoding", "identity") != "identity":
        raise SourceRefusedError(href, "its server sends it compressed though it was not asked to")
