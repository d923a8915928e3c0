"""Fetch files from servers that the operator allows, and from nowhere else."""

import asyncio
from collections.abc import AsyncIterator, Mapping
from contextlib import AbstractAsyncContextManager, asynccontextmanager

import httpx

from service.adapters.outgoing.address_check import parsed_address
from service.adapters.outgoing.pinned_http import pinned_request
from service.errors import AddressRefusedError
from service.names.file_names import clean_filename
from service.ports import RemoteFile
from service.settings import Settings

CONNECT_WITHIN_S = 10.0
CONTINUED = 5
"""How often a broken download is continued."""
FIRST_PAUSE_S = 0.5


class HttpsSources:
    """Reach files by HTTP.

    Parameters
    ----------
    settings
        With the allowed beginnings of addresses.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._allowed = [httpx.URL(beginning) for beginning in settings.source_beginnings]

    def check(self, href: str) -> None:
        """Refuse an address that is not allowed, without asking anybody.

        Raises
        ------
        AddressRefusedError
            With the reason.
        """
        self._checked(href)

    @asynccontextmanager
    async def opened(self, href: str) -> AsyncIterator[RemoteFile]:
        """Begin to fetch a file.

        Raises
        ------
        AddressRefusedError
            It is not allowed, not there, or not reached; also while its bytes are read.
        """
        url = self._checked(href)
        name = clean_filename(url.path)
        if not name:
            raise AddressRefusedError(href, "the address must end with the file's name, whose ending tells the format")
        try:
            async with self._asked(url, {}) as answer:
                _require_content(answer, href)
                length = answer.headers.get("content-length", "")
                chunks = self._continued(url, href, answer)
                yield RemoteFile(name, chunks, int(length) if length.isdigit() else None)
        except (httpx.HTTPError, OSError) as error:
            raise AddressRefusedError(href, f"it could not be fetched: {str(error) or type(error).__name__}") from None

    async def _continued(self, url: httpx.URL, href: str, first: httpx.Response) -> AsyncIterator[bytes]:
        """Give all bytes; where the connection breaks and the server can, go on where it broke."""
        version = _version(first)
        got, broken = 0, 0
        try:
            async for chunk in first.aiter_raw():
                got += len(chunk)
                yield chunk
        except httpx.TransportError as error:
            if version is None:
                raise
            reason = error
        else:
            return
        while broken < CONTINUED:
            await asyncio.sleep(FIRST_PAUSE_S * 2.0**broken)
            broken += 1
            try:
                async with self._asked(url, {"Range": f"bytes={got}-", "If-Range": version}) as answer:
                    _require_rest(answer, href, got)
                    async for chunk in answer.aiter_raw():
                        got += len(chunk)
                        yield chunk
                    return
            except httpx.TransportError as error:
                reason = error
        raise reason

    def _asked(self, url: httpx.URL, headers: Mapping[str, str]) -> AbstractAsyncContextManager[httpx.Response]:
        return pinned_request(
            "GET",
            url,
            allow_private=self._settings.allow_private_sources,
            timeouts=httpx.Timeout(CONNECT_WITHIN_S, read=self._settings.body_timeout_s),
            headers={"Accept-Encoding": "identity", **headers},
        )

    def _checked(self, href: str) -> httpx.URL:
        url = parsed_address(href)
        if not any(_lies_below(url, beginning) for beginning in self._allowed):
            raise AddressRefusedError(href, "it is none of the sources that the operator of this service allows")
        return url


def _lies_below(url: httpx.URL, beginning: httpx.URL) -> bool:
    if (url.scheme, url.host, url.port) != (beginning.scheme, beginning.host, beginning.port):
        return False
    if "\\" in url.path or any(part in {".", ".."} for part in url.path.split("/")):
        return False
    return url.path.startswith(beginning.path.rstrip("/") + "/")


def _require_content(answer: httpx.Response, href: str) -> None:
    if answer.has_redirect_location or answer.is_redirect:
        raise AddressRefusedError(href, "it leads elsewhere, and redirects are not followed; give the final address")
    if answer.status_code != httpx.codes.OK:
        raise AddressRefusedError(href, f"its server answered {answer.status_code} {answer.reason_phrase}".strip())
    if answer.headers.get("content-encoding", "identity") != "identity":
        raise AddressRefusedError(href, "its server sends it compressed though it was not asked to")


def _require_rest(answer: httpx.Response, href: str, got: int) -> None:
    if answer.status_code != httpx.codes.PARTIAL_CONTENT or not answer.headers.get("content-range", "").startswith(
        f"bytes {got}-"
    ):
        reason = f"the connection broke after {got} bytes, and its server did not go on from there"
        raise AddressRefusedError(href, f"{reason} (answer {answer.status_code})")


def _version(answer: httpx.Response) -> str | None:
    """Give what tells whether the file is still the same; None: its server cannot go on in the middle."""
    if answer.headers.get("accept-ranges", "").lower() != "bytes":
        return None
    tag: str = answer.headers.get("etag", "")
    modified: str | None = answer.headers.get("last-modified")
    return tag if tag and not tag.startswith("W/") else modified
