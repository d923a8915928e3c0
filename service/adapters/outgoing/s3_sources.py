"""Fetch files from object stores that the operator allows.

Clients name bucket and key only; where the store is, and the credentials, are the operator's: in the allowed beginning
(``s3://bucket/prefix?endpoint=…&region=…``) and in the ``AWS_…`` variables of the environment, as for the service's own
storage.
"""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING
from urllib.parse import unquote

from service.adapters.files.object_files import ObjectStoreAddress, connected
from service.adapters.outgoing.address_check import MAX_HREF
from service.errors import AddressRefusedError
from service.names.file_names import clean_filename
from service.ports import RemoteFile
from service.settings import Settings

if TYPE_CHECKING:
    from obstore.store import S3Store

SCHEME = "s3://"
READ_BYTES = 8 << 20


class S3Sources:
    """Reach files in object stores.

    Parameters
    ----------
    settings
        With the allowed beginnings of addresses.
    """

    def __init__(self, settings: Settings) -> None:
        self._allowed = [
            ObjectStoreAddress.parsed(beginning)
            for beginning in settings.source_beginnings
            if beginning.startswith(SCHEME)
        ]

    def check(self, href: str) -> None:
        """Refuse an address that is not allowed, without asking anybody.

        Raises
        ------
        AddressRefusedError
            With the reason.
        """
        self._found(href)

    @asynccontextmanager
    async def opened(self, href: str) -> AsyncIterator[RemoteFile]:
        """Begin to fetch a file.

        Raises
        ------
        AddressRefusedError
            It is not allowed, not there, or not reached; also while its bytes are read.
        """
        import obstore
        from obstore.exceptions import BaseError

        place, key = self._found(href)
        name = clean_filename(key)
        if not name:
            raise AddressRefusedError(href, "the address must end with the file's name, whose ending tells the format")
        try:
            store = connected(place)
            told = await obstore.head_async(store, key)
            yield RemoteFile(name, _chunks(store, key, told["size"], told["e_tag"]), told["size"])
        except FileNotFoundError:
            raise AddressRefusedError(href, "there is no such object") from None
        except BaseError as error:
            kind = type(error).__name__.removesuffix("Error")
            raise AddressRefusedError(href, f"the object store does not give it ({kind})") from error

    def _found(self, href: str) -> tuple[ObjectStoreAddress, str]:
        """Give the place and the key of an address."""
        if len(href) > MAX_HREF:
            raise AddressRefusedError(f"{href[:50]}…", f"the address has more than {MAX_HREF} characters")
        bucket, _, written = href.removeprefix(SCHEME).partition("/")
        key = unquote(written)
        wrong = any(part in {"", ".", ".."} for part in key.split("/")) or "?" in href or "#" in href or "@" in bucket
        if not href.startswith(SCHEME) or not href.isprintable() or not key.isprintable() or wrong or "\\" in key:
            raise AddressRefusedError(href, "an address of the form s3://bucket/key is expected")
        for place in self._allowed:
            if bucket == place.bucket and (not place.prefix or key.startswith(f"{place.prefix}/")):
                return place, key
        raise AddressRefusedError(href, "it is none of the sources that the operator of this service allows")


async def _chunks(store: "S3Store", key: str, size: int, e_tag: str | None) -> AsyncIterator[bytes]:
    """Read piece by piece, each tried again by the library; all of the same version of the object."""
    import obstore

    for start in range(0, size, READ_BYTES):
        wanted = (start, min(start + READ_BYTES, size))
        piece = await obstore.get_async(store, key, options={"range": wanted, "if_match": e_tag})
        yield bytes(await piece.bytes_async())
