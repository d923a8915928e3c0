"""Files on other servers, whatever the kind of server."""

from contextlib import AbstractAsyncContextManager
from functools import cached_property

from service.errors import AddressRefusedError
from service.ports import RemoteFile, Sources
from service.settings import Settings


class RemoteSources:
    """Reach what an address names by the scheme that it begins with.

    Made in every computing process, of which few fetch: the parts are loaded when they are needed.

    Parameters
    ----------
    settings
        With the allowed beginnings of addresses.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings

    def check(self, href: str) -> None:
        """Refuse an address that is not allowed, without asking anybody.

        Raises
        ------
        AddressRefusedError
            With the reason.
        """
        self._of(href).check(href)

    def opened(self, href: str) -> AbstractAsyncContextManager[RemoteFile]:
        """Begin to fetch a file.

        Raises
        ------
        AddressRefusedError
            It is not allowed, not there, or not reached; also while its bytes are read.
        """
        return self._of(href).opened(href)

    def _of(self, href: str) -> Sources:
        if not self._settings.source_beginnings:
            raise AddressRefusedError(
                href, "this service fetches no files; its operator can allow sources by TIELINE_ALLOWED_SOURCES"
            )
        return self._s3 if href.startswith("s3://") else self._https

    @cached_property
    def _https(self) -> Sources:
        from service.adapters.outgoing.https_sources import HttpsSources

        return HttpsSources(self._settings)

    @cached_property
    def _s3(self) -> Sources:
        from service.adapters.outgoing.s3_sources import S3Sources

        return S3Sources(self._settings)
