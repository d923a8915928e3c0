"""Resumable uploads on their way."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Protocol

from service.ports.documents import Json


@dataclass(frozen=True)
class PendingUpload:
    """What is known of a resumable upload besides its bytes."""

    id: str
    """Also the id of the file that it becomes."""
    filename: str
    length: int
    """Bytes of the whole file."""
    metadata: str
    """As the client sent it."""
    created: datetime
    finished: bool = False
    """The file is entered."""
    problem: Json | None = None
    """Why the complete upload was refused."""
    owner: str = ""
    """Project that the upload belongs to; empty: the default project."""


@dataclass(frozen=True)
class UploadState:
    """A resumable upload and how far it is."""

    upload: PendingUpload
    offset: int
    """Bytes that have arrived for good."""
    touched: datetime
    """When the last byte came."""

    @property
    def complete(self) -> bool:
        """Tell whether all bytes are there."""
        return self.offset >= self.upload.length


class OpenUpload(Protocol):
    """A resumable upload that nobody else, in no process, writes to until it is closed."""

    @property
    def state(self) -> UploadState:
        """Tell how far it is."""

    def whole(self) -> Path:
        """Give a file with all bytes of a complete upload, which may take long."""

    def set_room_aside(self, ahead: int) -> bool:
        """Keep room on the disk for so many bytes more, or the rest if it is less; False where that is not possible.

        InsufficientStorageError when there is not as much.
        """

    def give_room_back(self) -> None:
        """Keep no room any more for what is still to come."""

    def touch(self) -> None:
        """Note that somebody is about to write."""

    def write(self, data: bytes) -> None:
        """Append."""

    def sync(self) -> None:
        """Make durable what was written."""

    def doubt(self) -> None:
        """Declare all that is written from now on as not verified; it goes if the process dies before `trust`."""

    def trust(self) -> None:
        """Declare what was written as verified."""

    def cut(self) -> None:
        """Remove what is not verified."""

    def asked_for(self) -> bool:
        """Tell whether another request wants the upload."""

    def save(self, upload: PendingUpload) -> None:
        """Record a change; the bytes of an upload that is finished or refused go."""

    def remove(self) -> None:
        """Remove the upload."""

    def close(self) -> None:
        """Let others have it."""


class UploadStore(Protocol):
    """Keep resumable uploads: the offset is what is there for good."""

    def of(self, owner: str) -> "UploadStore":
        """Give the uploads of one project: those of others do not exist there, and new ones belong to it.

        PermissionError when this store is another project's.
        """

    def create(self, upload: PendingUpload) -> None:
        """Enter a new upload, which is empty."""

    def find(self, upload_id: str) -> UploadState:
        """Tell how far an upload is. NoSuchUploadError when it is unknown."""

    def lock(self, upload_id: str) -> OpenUpload | None:
        """Open an upload; None while it is open elsewhere. NoSuchUploadError when it is unknown."""

    def ask_for(self, upload_id: str) -> None:
        """Let whoever has the upload open know that it is wanted."""

    def ids(self) -> Sequence[str]:
        """List all uploads."""

    def promised_bytes(self) -> int:
        """Sum up what the uploads that are neither finished nor refused will have."""

    def unfinished(self) -> int:
        """Count the uploads that have become no file: those on their way, and those that were refused."""

    def remove_abandoned(self, moment: datetime) -> int:
        """Remove what killed processes left half-made before a moment; give the number."""
