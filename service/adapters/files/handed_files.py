"""The blobs of one step, in a process that knows no store: what it was handed, and what it makes."""

from collections.abc import AsyncIterator, Mapping, Sequence
from pathlib import Path

from service.adapters.files.local_files import LocalFiles
from service.adapters.processes.handing import WantedError


class HandedFiles:
    """The blobs of one step, as `service.ports.StepFiles`.

    Parameters
    ----------
    paths
        By key, of what it was handed.
    on_request
        Keys of what is there and was not handed.
    directory
        Its own, for what it makes.
    """

    def __init__(self, paths: Mapping[str, str], on_request: Sequence[str], directory: Path) -> None:
        self._paths, self._on_request = paths, frozenset(on_request)
        self._made = LocalFiles(directory, directory)

    async def write_stream(
        self, key: str, chunks: AsyncIterator[bytes], max_bytes: int, expected_bytes: int = 0
    ) -> tuple[int, str]:
        """Make a blob of a stream."""
        return await self._made.write_stream(key, chunks, max_bytes, expected_bytes)

    def write_bytes(self, key: str, data: bytes) -> None:
        """Make a small blob."""
        self._made.write_bytes(key, data)

    def put_file(self, key: str, path: Path) -> None:
        """Make a blob of a finished file."""
        self._made.put_file(key, path)

    def local_path(self, key: str) -> Path:
        """Give a blob that was handed or made. FileNotFoundError when absent.

        Raises
        ------
        WantedError
            It has to be asked for.
        """
        if key in self._paths:
            return Path(self._paths[key])
        if key in self._on_request:
            raise WantedError(key)
        return self._made.local_path(key)

    def size(self, key: str) -> int:
        """Give the number of bytes of a blob that was handed or made. FileNotFoundError when absent."""
        return self.local_path(key).stat().st_size

    def exists(self, key: str) -> bool:
        """Tell whether a blob was handed or made."""
        return key in self._paths or self._made.exists(key)

    def delete_prefix(self, prefix: str) -> None:
        """Remove what was made."""
        self._made.delete_prefix(prefix)

    def scratch(self) -> Path:
        """Give a new empty directory."""
        return self._made.scratch()
