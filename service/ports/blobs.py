"""Where bytes are kept."""

from collections.abc import AsyncIterator, Sequence
from datetime import datetime
from pathlib import Path
from typing import Protocol


class StepFiles(Protocol):
    """What a step reads and makes: blobs under keys such as ``files/<sha256>``, ``jobs/<id>/result.json``."""

    async def write_stream(
        self, key: str, chunks: AsyncIterator[bytes], max_bytes: int, expected_bytes: int = 0
    ) -> tuple[int, str]:
        """Store a stream in constant memory; give its size and sha256. Nothing remains when the stream breaks.

        Room for what is expected is set aside beforehand where that is possible; InsufficientStorageError when there is
        none.
        """

    def write_bytes(self, key: str, data: bytes) -> None:
        """Store small content."""

    def put_file(self, key: str, path: Path) -> None:
        """Move a finished local file into the store."""

    def local_path(self, key: str) -> Path:
        """Give a local, readable copy of a blob (the blob itself for a local store). FileNotFoundError when absent."""

    def size(self, key: str) -> int:
        """Give the number of bytes of a blob. FileNotFoundError when absent."""

    def exists(self, key: str) -> bool:
        """Tell whether the key is stored."""

    def delete_prefix(self, prefix: str) -> None:
        """Remove a blob, or all in a folder; nothing happens when there is nothing."""

    def scratch(self) -> Path:
        """Give a new empty directory on the same file system; the caller removes it."""


class BlobStore(StepFiles, Protocol):
    """Keep bytes under keys such as ``files/<sha256>``, ``features/<hash>.npz``, ``jobs/<id>/result.json``.

    A blob appears whole or not at all (temporary name, fsync, rename).
    """

    def put_copy(self, key: str, path: Path) -> None:
        """Put a finished local file, which is never written again, into the store; the file itself stays."""

    def prepare_move(self, key: str, new_key: str) -> None:
        """Do beforehand what takes long of moving a blob to the name of its content; it need not be done."""

    def move(self, key: str, new_key: str) -> None:
        """Rename a blob; what lay under the new key is replaced. FileNotFoundError when absent."""

    def keys(self, prefix: str) -> Sequence[str]:
        """List the keys under a prefix."""

    def total(self, prefix: str) -> int:
        """Sum up the bytes of all blobs under a prefix."""

    def unchanged_since(self, prefix: str, moment: datetime) -> Sequence[str]:
        """List the keys under a prefix that were last written before a moment."""

    def remove_abandoned(self, moment: datetime) -> int:
        """Remove unfinished blobs that nobody has written to since a moment; give their number."""
