"""Take uploaded files in: all of a request, or nothing."""

import asyncio
import hashlib
from collections.abc import AsyncIterator, Callable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

from schemas.values.text_columns import TEXT_ENDINGS
from service.errors import (
    ComputationFailedError,
    FileNotFoundInStoreError,
    JobNotFinishedError,
    UnreadableFileError,
)
from service.names.content_keys import content_key, incoming_key
from service.names.feature_keys import features_of_content, features_of_project
from service.names.identifiers import MakeIdentifier, is_identifier, new_identifier
from service.ports import BlobStore, FileStore, JobStore, StepFailedError, StepRunner, StoredFile
from service.settings import Settings
from service.use_cases.limits.free_space import BYTES_BETWEEN_CHECKS, require_free_space
from service.use_cases.limits.machine_shares import INSPECT
from service.use_cases.limits.quotas import Belongings, admit_file
from service.use_cases.uploads.inspection_places import inspection_place
from service.use_cases.uploads.upload_threads import undisturbed


@dataclass(frozen=True)
class Upload:
    """One file on its way in."""

    filename: str
    chunks: AsyncIterator[bytes]
    expected_bytes: int = 0
    """At most so many come, as far as is known."""


@dataclass(frozen=True)
class FileIntake:
    """Where uploaded files go."""

    belongings: Belongings
    blobs: BlobStore
    steps: StepRunner
    settings: Settings
    make_id: MakeIdentifier = new_identifier

    @property
    def files(self) -> FileStore:
        """Give the files among which they go."""
        return self.belongings.files

    def of(self, owner: str) -> "FileIntake":
        """Give the place where the uploads of one project go."""
        return replace(self, belongings=self.belongings.of(owner))

    async def store(
        self, uploads: AsyncIterator[Upload], now: datetime, columns: Callable[[], str] = lambda: ""
    ) -> Sequence[StoredFile]:
        """Write each stream to the store, have it inspected in a process of its own, then enter all of them.

        Parameters
        ----------
        uploads
            The files on their way in.
        now
            Time of the request.
        columns
            Gives, once all have arrived, what the columns of those that are text tables are; empty: nobody says.

        Raises
        ------
        UnreadableFileError
            A file is empty, or no reader understands it.
        FileTooLargeError, InsufficientStorageError
            A limit is reached.
        """
        received: list[Received] = []
        entered: list[StoredFile] = []
        try:
            async for upload in uploads:
                received.append(Received(self.make_id(), upload.filename))
                await self._receive(upload, received[-1])
            stated = columns()
            tables = [each for each in received if each.filename.lower().endswith(TEXT_ENDINGS)] or received
            inspected = [await self.inspected(each, now, stated if each in tables else "") for each in received]
            besides = await asyncio.to_thread(self.belongings.besides_files)
            for file in inspected:
                entered.append(file)
                entered[-1] = await undisturbed(self.enter, file, besides)
        except BaseException:  # also when the client leaves or the service stops: nothing may stay behind
            await undisturbed(self._take_back, received, entered)
            raise
        return entered

    async def store_finished(
        self, file_id: str, filename: str, path: Path, now: datetime, columns: str = ""
    ) -> StoredFile:
        """Take a finished local file in, which is never written again and stays where it is; doing it again is no harm.

        Raises
        ------
        UnreadableFileError
            The file is empty, or no reader understands it.
        """
        known = await asyncio.to_thread(self.files.get, file_id)
        if known is not None:
            return known
        received = Received(file_id, filename)
        received.bytes, received.sha256 = await undisturbed(_size_and_hash, path)
        if received.bytes == 0:
            raise UnreadableFileError(filename, "the file is empty", "byte 0")
        try:
            await undisturbed(self.blobs.put_copy, incoming_key(file_id), path)
            file = await self.inspected(received, now, columns)
            # there was room for it when its upload began: what jobs have stored since then does not take it away
            return await undisturbed(self.enter, file, 0)
        except BaseException:
            await undisturbed(self.drop, received)
            raise

    def drop(self, received: "Received") -> None:
        """Remove what has arrived and is not entered."""
        self.blobs.delete_prefix(incoming_key(received.id))
        if received.sha256:
            release_content(received.sha256, self.files, self.blobs)

    def discard(self, files: Sequence[StoredFile]) -> None:
        """Take back what `store` entered."""
        for file in files:
            self.files.delete(file.id)
            release_content(file.sha256, self.files, self.blobs)

    def _take_back(self, received: Sequence["Received"], entered: Sequence[StoredFile]) -> None:
        for each in received:
            self.blobs.delete_prefix(incoming_key(each.id))
        self.discard(entered)

    def require_room(self, coming_bytes: int = 0) -> None:
        """Refuse when the disk would be (nearly) full.

        Raises
        ------
        InsufficientStorageError
            Less than the configured rest would remain free.
        """
        require_free_space(self.settings.data_dir, self.settings.min_free_bytes, coming_bytes)

    def require_quota(self, coming_bytes: int = 0) -> None:
        """Refuse what the project has no room for, before it comes; it is counted again when it is entered.

        Raises
        ------
        QuotaFullError
            The project has too much.
        """
        admit_file(self.settings, coming_bytes, self.belongings.besides_files())(self.files.amount())

    def room(self) -> int:
        """Give the most bytes that one more file of the project may have.

        Raises
        ------
        QuotaFullError
            The project has too much.
        """
        stored, besides = self.files.amount(), self.belongings.besides_files()
        admit_file(self.settings, 0, besides)(stored)
        return min(self.settings.max_file_bytes, self.settings.max_project_bytes - stored.bytes - besides)

    def enter(self, file: StoredFile, besides: int | None = None) -> StoredFile:
        """Give the file its place; where its content is stored already, that of the new one takes its place.

        Parameters
        ----------
        file
            What has arrived.
        besides
            Bytes that the project has and that are not of files; None: counted now.
        """
        here, there = incoming_key(file.id), content_key(file.sha256)
        made_before = self.files.get(file.id)
        if made_before is not None:  # by a request that broke off and is tried again
            self.blobs.delete_prefix(here)
            return made_before
        self.blobs.prepare_move(here, there)
        besides = self.belongings.besides_files() if besides is None else besides
        admit = admit_file(self.settings, file.bytes, besides)
        return self.files.add(file, lambda: self.blobs.move(here, there), admit)

    async def _receive(self, upload: Upload, received: "Received") -> None:
        received.bytes, received.sha256 = await self.blobs.write_stream(
            incoming_key(received.id),
            self._watched(upload.chunks),
            self.settings.max_file_bytes,
            upload.expected_bytes,
        )
        if received.bytes == 0:
            raise UnreadableFileError(upload.filename, "the file is empty", "byte 0")

    async def _watched(self, chunks: AsyncIterator[bytes]) -> AsyncIterator[bytes]:
        unchecked = BYTES_BETWEEN_CHECKS
        async for chunk in chunks:
            unchecked += len(chunk)
            if unchecked >= BYTES_BETWEEN_CHECKS:
                self.require_room()
                unchecked = 0
            yield chunk

    async def inspected(
        self, received: "Received", now: datetime, columns: str = "", wait_s: float | None = None
    ) -> StoredFile:
        """Find out in a process of its own what has arrived, when it is its turn.

        Parameters
        ----------
        received
            What has arrived.
        now
            Time of the request.
        columns
            Those of a text table, if they were stated.
        wait_s
            How long to wait for its turn; None: as the settings say.

        Raises
        ------
        BusyError
            It was not its turn in time.
        UnreadableFileError
            No reader understands it.
        """
        try:
            async with inspection_place(
                self.settings, self.belongings.owner, received.filename, received.bytes, wait_s
            ):
                found = await self.steps.run(
                    INSPECT,
                    {
                        "key": incoming_key(received.id),
                        "filename": received.filename,
                        "bytes": received.bytes,
                        "columns": columns,
                    },
                    timeout_s=self.settings.inspect_timeout_s,
                )
        except (ComputationFailedError, StepFailedError) as error:
            if isinstance(error, StepFailedError) and not error.broke_down:
                raise
            # a file that kills its reader, or needs more time or memory than there is for reading, is a bad file
            raise UnreadableFileError(received.filename, f"reading it broke down: {error}") from error
        return StoredFile(
            id=received.id,
            name=received.filename,
            bytes=received.bytes,
            sha256=received.sha256,
            format=found["format"],
            kind=found["kind"],
            created=now,
            scans=tuple(found["scans"]),
            photos=tuple(found["photos"]),
        )


@dataclass
class Received:
    """One file that arrives, or has arrived."""

    id: str
    filename: str
    bytes: int = 0
    sha256: str = ""


def find_file(file_id: str, files: FileStore) -> StoredFile:
    """Fetch the metadata of a file.

    Raises
    ------
    FileNotFoundInStoreError
        There is no such file.
    """
    file = files.get(file_id) if is_identifier(file_id) else None
    if file is None:
        raise FileNotFoundInStoreError(file_id)
    return file


def delete_file(file_id: str, files: FileStore, jobs: JobStore, blobs: BlobStore) -> None:
    """Remove a file that no unfinished job reads, and its content with the features of its scans unless a twin has it.

    Raises
    ------
    FileNotFoundInStoreError
        There is no such file.
    JobNotFinishedError
        A job still reads it.
    """
    file = find_file(file_id, files)
    user = jobs.unfinished_using(file_id)
    if user is not None:
        raise JobNotFinishedError(f"file '{file.name}'", user.id)
    files.delete(file_id)
    if not release_content(file.sha256, files, blobs):
        computed = features_of_project(file.sha256, file.owner)
        files.remove_unused(file.sha256, lambda: blobs.delete_prefix(computed), file.owner)


def release_content(sha256: str, files: FileStore, blobs: BlobStore) -> bool:
    """Remove a content and what was computed from it if no file has it; tell whether it was removed."""

    def remove() -> None:
        blobs.delete_prefix(content_key(sha256))
        blobs.delete_prefix(features_of_content(sha256))

    return files.remove_unused(sha256, remove)


def _size_and_hash(path: Path) -> tuple[int, str]:
    with path.open("rb") as file:
        return path.stat().st_size, hashlib.file_digest(file, "sha256").hexdigest()
