"""Fetch files from servers that the operator allows, and from nowhere else."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import httpx

from service.adapters.address_check import parsed_address
from service.adapters.pinned_http import pinned_request
from service.errors import AddressRefusedError
from service.ports import RemoteFile
from service.settings import Settings
from service.use_cases.file_names import clean_filename

CONNECT_WITHIN_S = 10.0


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
            async with pinned_request(
                "GET",
                url,
                allow_private=self._settings.allow_private_sources,
                timeouts=httpx.Timeout(CONNECT_WITHIN_S, read=self._settings.body_timeout_s),
                headers={"Accept-Encoding": "identity"},
            ) as answer:
                _require_content(answer, href)
                length = answer.headers.get("content-length", "")
                yield RemoteFile(name, answer.aiter_raw(), int(length) if length.isdigit() else None)
        except (httpx.HTTPError, OSError) as error:
            raise AddressRefusedError(href, f"it could not be fetched: {error or type(error).__name__}") from None

    def _checked(self, href: str) -> httpx.URL:
        if not self._allowed:
            raise AddressRefusedError(
                href, "this service fetches no files; its operator can allow sources by TIELINE_ALLOWED_SOURCES"
            )
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
