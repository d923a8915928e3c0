"""What the service keeps of files: their metadata."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Protocol

from service.ports.documents import Json

OF_READING = ("warnings", "text_columns", "scan_pose", "unit")
"""What a plan sees of scans, besides which of them cannot be used."""


@dataclass(frozen=True)
class StoredFile:
    """Metadata of an uploaded file."""

    id: str
    name: str
    bytes: int
    sha256: str
    format: str
    kind: str
    """scan, photo, project or other."""
    created: datetime
    expires: datetime | None = None
    scans: tuple[Json, ...] = ()
    """One document per scan: index, name, points, structured, rows, columns, bounds_m, has_intensity, ..."""
    photos: tuple[Json, ...] = ()
    owner: str = ""
    """Project that the file belongs to; empty: the default project."""
    computed_bytes: int = 0
    """What was computed of its content for its project and is kept beside it: features, points for the viewer."""

    def summary(self) -> Json:
        """Give what a plan sees of the file."""
        seen = {name: getattr(self, name) for name in ("name", "sha256", "bytes", "format", "kind", "owner")}
        said = [scan for scan in self.scans if not scan.get("usable", True) or any(map(scan.get, OF_READING))]
        kept = ("index", "name", "usable", "reason", *OF_READING)
        scans = [{name: scan[name] for name in kept if scan.get(name) is not None} for scan in said]
        return {**seen, "scans": scans} if scans else seen


@dataclass(frozen=True)
class StoredAmount:
    """How much is stored."""

    files: int
    bytes: int


def admit_any_file(_stored: StoredAmount) -> None:
    """Let a file in, whatever is stored already."""


class FileStore(Protocol):
    """Keep the metadata of files."""

    def of(self, owner: str) -> "FileStore":
        """Give the files of one project: those of others do not exist there, and new ones belong to it.

        What is said of contents (`contents`, `remove_unused`, `forget_lost`) stays true of all projects, which share
        them. PermissionError when this store is another project's.
        """

    def amount(self) -> StoredAmount:
        """Sum up the files with what was computed of them; contents that several files share count for each."""

    def add(
        self,
        file: StoredFile,
        place: Callable[[], None] = lambda: None,
        admit: Callable[[StoredAmount], None] = admit_any_file,
    ) -> StoredFile:
        """Insert, and give what was inserted: it belongs to the store's project.

        Parameters
        ----------
        file
            The metadata.
        place
            Puts the content where it belongs, in the same transaction; meanwhile nobody else adds or removes content
            of this hash. When it raises, the file is not inserted.
        admit
            Sees what the project has stored before; when it raises, the file is not inserted. Nobody else adds a file
            of the same project meanwhile.
        """

    def get(self, file_id: str) -> StoredFile | None:
        """Fetch."""

    def find(self, limit: int, offset: int) -> tuple[Sequence[StoredFile], int]:
        """List, newest first, with the number of all."""

    def contents(self) -> frozenset[str]:
        """Give the hashes of all contents that files have."""

    def delete(self, file_id: str) -> bool:
        """Forget; False when it was unknown."""

    def note_computed(self, sha256: str, size: int) -> None:
        """Note how many bytes are kept of what was computed of a content; later files with it have as many."""

    def remove_unused(self, sha256: str, remove: Callable[[], None], owner: str | None = None) -> bool:
        """Call `remove` if no file, of one project if it is named, has this content, while nobody can add one.

        Returns
        -------
        Whether it was called.
        """

    def forget_lost(self, sha256: str, is_there: Callable[[], bool]) -> int:
        """Forget the files of a content that is not there (any more); give their number."""
