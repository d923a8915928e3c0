"""Files on other servers."""

from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True)
class RemoteFile:
    """A file on another server, on its way."""

    name: str
    chunks: AsyncIterator[bytes]
    """All of it, in spite of broken connections where its server can go on in the middle; else AddressRefusedError."""
    declared_bytes: int | None = None


class Sources(Protocol):
    """Reach files on other servers, as far as the operator allows."""

    def check(self, href: str) -> None:
        """Refuse an address that is not allowed, without asking anybody. AddressRefusedError says why."""

    def opened(self, href: str) -> AbstractAsyncContextManager[RemoteFile]:
        """Begin to fetch a file. AddressRefusedError: it is not allowed, not there, or not reached."""
