"""Resumable uploads: begin, continue, look, end; the last byte makes a file of it."""

import asyncio
import hashlib
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from functools import partial

from service.errors import (
    ChecksumMismatchError,
    FileTooLargeError,
    InsufficientStorageError,
    NoSuchUploadError,
    UnreadableFileError,
    UploadGoneError,
    UploadLockedError,
    UploadOffsetError,
    UploadOverrunError,
    to_problem,
)
from service.ports import OpenUpload, PendingUpload, StepFailedError, UploadState, UploadStore
from service.use_cases.inputs.stated_columns import FIELD, stated_columns
from service.use_cases.limits.free_space import BYTES_BETWEEN_CHECKS
from service.use_cases.limits.patient_reading import timely
from service.use_cases.uploads.store_files import FileIntake
from service.use_cases.uploads.upload_metadata import metadata_values
from service.use_cases.uploads.upload_threads import undisturbed

CHECKSUMS = ("sha1", "sha256")
BLOCK_BYTES = 1 << 20
TICK_S = 0.25
STALE_AFTER_S = 1.0
"""A request that has sent nothing for so long may be ended by a new one for the same upload."""
TAKE_OVER_WITHIN_S = 5.0


@dataclass(frozen=True)
class Checksum:
    """What the hash of one request's body must be."""

    algorithm: str
    digest: bytes


@dataclass(frozen=True)
class UploadPart:
    """The body of one request that continues an upload."""

    offset: int
    """Where the client says that it continues."""
    chunks: AsyncIterator[bytes]
    declared_bytes: int | None = None
    checksum: Checksum | None = None


@dataclass(frozen=True)
class UploadDesk:
    """Where resumable uploads are taken in."""

    uploads: UploadStore
    intake: FileIntake

    async def begin(self, filename: str, length: int, metadata: str, now: datetime) -> UploadState:
        """Enter an upload.

        Raises
        ------
        FileTooLargeError, InsufficientStorageError, QuotaFullError, QuotaExceededError
            It would exceed a limit.
        UnreadableFileError
            It is empty.
        """
        limit = self.intake.settings.max_file_bytes
        if length > limit:
            raise FileTooLargeError(filename, length, limit)
        if length == 0:
            raise UnreadableFileError(filename, "the file is empty", "byte 0")
        await asyncio.to_thread(self.intake.require_room, length)
        upload = PendingUpload(self.intake.make_id(), filename, length, metadata, now)
        with suppress(NoSuchUploadError):  # begun by a request that broke off and is tried again
            await self.terminate(upload.id)
        await asyncio.to_thread(self.intake.require_quota, length)
        await asyncio.to_thread(self.intake.belongings.require_upload, self.intake.settings)
        await asyncio.to_thread(self.uploads.create, upload)
        return UploadState(upload, 0, now)

    async def describe(self, upload_id: str, now: datetime) -> UploadState:
        """Tell how far an upload is, without disturbing who writes to it.

        Raises
        ------
        NoSuchUploadError, UploadGoneError
            There is none, or it has waited too long.
        """
        state = await asyncio.to_thread(self.uploads.find, upload_id)
        if self.expires(state) < now:
            raise UploadGoneError(upload_id, "nothing came for too long")
        return state

    async def look(self, upload_id: str, now: datetime) -> UploadState:
        """Tell where to continue an upload; a request for it that has stalled is ended.

        Raises
        ------
        UploadLockedError
            A request is writing to it right now.
        NoSuchUploadError, UploadGoneError
            There is none, it has waited too long, or what came was no readable file.
        """
        state = await self.describe(upload_id, now)
        if not state.complete:
            async with self._locked(upload_id) as opened:
                state = await _state_of(opened)
        _require_unrefused(state.upload)
        return state

    async def append(self, upload_id: str, part: UploadPart, now: datetime) -> UploadState:
        """Continue an upload; the last byte makes a file of it.

        What has come when the connection breaks is kept, unless a checksum was promised for it.

        Raises
        ------
        UploadLockedError, UploadOffsetError, UploadOverrunError, ChecksumMismatchError, InsufficientStorageError
            The part cannot be taken.
        UnreadableFileError, StepFailedError
            The upload is complete and no readable file.
        NoSuchUploadError, UploadGoneError
            There is no such upload, or not any more.
        """
        await self.describe(upload_id, now)
        async with self._locked(upload_id) as opened:
            state = await _state_of(opened)
            _require_unrefused(state.upload)
            if part.offset != state.offset:
                raise UploadOffsetError(upload_id, part.offset, state.offset)
            room = state.upload.length - state.offset
            if part.declared_bytes is not None and part.declared_bytes > room:
                raise UploadOverrunError(upload_id, state.offset + part.declared_bytes, state.upload.length)
            await asyncio.to_thread(self._make_room, opened, part.declared_bytes or 0)
            try:
                await self._take(opened, state.upload, part)
            finally:  # room is kept for what comes, not for what was announced
                await undisturbed(opened.give_room_back)
            await self._finish(opened, now)
            return await _state_of(opened)

    async def finish(self, upload_id: str, now: datetime) -> None:
        """Make a file of an upload whose last byte came before a process died; nothing happens if another one does it.

        Raises
        ------
        UnreadableFileError, StepFailedError
            It is no readable file.
        """
        opened = await asyncio.to_thread(self.uploads.lock, upload_id)
        if opened is not None:
            try:
                await self._finish(opened, now)
            finally:
                await undisturbed(opened.close)

    async def terminate(self, upload_id: str) -> None:
        """Remove an upload; a file that it has become stays.

        Raises
        ------
        UploadLockedError
            A request is writing to it right now.
        NoSuchUploadError
            There is none.
        """
        async with self._locked(upload_id) as opened:
            await undisturbed(opened.remove)

    def expires(self, state: UploadState) -> datetime:
        """Tell when an upload is removed unless it goes on."""
        return state.touched + timedelta(seconds=self.intake.settings.upload_expiry_s)

    @asynccontextmanager
    async def _locked(self, upload_id: str) -> AsyncIterator[OpenUpload]:
        opened = await asyncio.to_thread(self.uploads.lock, upload_id)
        if opened is None:
            opened = await self._taken_over(upload_id)
        try:
            yield opened
        finally:
            await undisturbed(opened.close)

    async def _taken_over(self, upload_id: str) -> OpenUpload:
        """Ask a request that has stalled to end."""
        state = await asyncio.to_thread(self.uploads.find, upload_id)
        if (datetime.now(UTC) - state.touched).total_seconds() < STALE_AFTER_S:
            raise UploadLockedError(upload_id)
        self.uploads.ask_for(upload_id)
        deadline = time.monotonic() + TAKE_OVER_WITHIN_S
        while time.monotonic() < deadline:
            await asyncio.sleep(TICK_S / 5.0)
            opened = await asyncio.to_thread(self.uploads.lock, upload_id)
            if opened is not None:
                return opened
        raise UploadLockedError(upload_id)

    def _make_room(self, opened: OpenUpload, coming_bytes: int = 0) -> None:
        """Set room aside for what comes next of an upload, unless there is too little for all that is announced."""
        self.intake.require_room(coming_bytes)
        try:
            opened.set_room_aside(2 * BYTES_BETWEEN_CHECKS)
            self.intake.require_room()
        except InsufficientStorageError:
            opened.give_room_back()
            raise

    async def _take(self, opened: OpenUpload, upload: PendingUpload, part: UploadPart) -> None:
        writer = _PartWriter(opened, upload, part, partial(self._make_room, opened))
        await undisturbed(opened.touch)
        if part.checksum is not None:
            opened.doubt()
        try:
            async for chunk in timely(part.chunks, self.intake.settings.body_timeout_s, TICK_S):
                await writer.add(chunk)
            await writer.finish()
        except BaseException:
            await writer.give_up()
            raise

    async def _finish(self, opened: OpenUpload, now: datetime) -> None:
        state = await _state_of(opened)
        upload = state.upload
        if upload.finished or upload.problem is not None or not state.complete:
            return
        try:
            path = await undisturbed(opened.whole)
            await self.intake.of(upload.owner).store_finished(
                upload.id, upload.filename, path, now, _columns_of(upload)
            )
        except (UnreadableFileError, StepFailedError) as error:  # trying again would not help
            await undisturbed(opened.save, replace(upload, problem=to_problem(error)))
            raise
        await undisturbed(opened.save, replace(upload, finished=True))


class _PartWriter:
    """Write one body block by block."""

    def __init__(
        self, opened: OpenUpload, upload: PendingUpload, part: UploadPart, make_room: Callable[[], None]
    ) -> None:
        self._opened = opened
        self._upload = upload
        self._part = part
        self._room = upload.length - part.offset
        self._digest = None if part.checksum is None else hashlib.new(part.checksum.algorithm, usedforsecurity=False)
        self._make_room = make_room
        self._block = bytearray()
        self._written = 0
        self._unchecked = 0
        self._due = time.monotonic() + TICK_S

    async def add(self, chunk: bytes) -> None:
        """Take a chunk; an empty one only says that time has passed."""
        self._block += chunk
        if self._written + len(self._block) > self._room:
            size = self._part.offset + self._written + len(self._block)
            raise UploadOverrunError(self._upload.id, size, self._upload.length)
        # what a slow client sends shows soon: the size of the file on disk is what others take for its progress
        if len(self._block) >= BLOCK_BYTES or time.monotonic() >= self._due:
            if self._opened.asked_for():
                raise UploadLockedError(self._upload.id)
            await self._flush()

    async def finish(self) -> None:
        """Write the rest and compare the checksum."""
        await self._flush()
        await undisturbed(self._opened.sync)
        if self._digest is not None and self._part.checksum is not None:
            if self._digest.digest() != self._part.checksum.digest:
                raise ChecksumMismatchError(self._part.checksum.algorithm, self._part.offset)
            await undisturbed(self._opened.trust)

    async def give_up(self) -> None:
        """Keep what has come, if it counts without being complete."""
        if self._digest is not None:
            await undisturbed(self._opened.cut)
        elif self._written + len(self._block) <= self._room:
            await self._flush()

    async def _flush(self) -> None:
        data = bytes(self._block)
        self._block.clear()  # never written again, even if the disk is full in the middle
        self._due = time.monotonic() + TICK_S
        if data:
            await undisturbed(self._write, data)

    def _write(self, data: bytes) -> None:
        self._unchecked += len(data)
        if self._unchecked >= BYTES_BETWEEN_CHECKS:
            self._make_room()
            self._unchecked = 0
        self._opened.write(data)
        self._written += len(data)
        if self._digest is not None:
            self._digest.update(data)


async def _state_of(opened: OpenUpload) -> UploadState:
    """Read in a thread how far an upload is: that may be a question to a database."""
    return await undisturbed(lambda: opened.state)


def _columns_of(upload: PendingUpload) -> str:
    """Give what the client says of the columns of a text table; it was checked when the upload began."""
    return stated_columns(metadata_values(upload.metadata).get(FIELD, ""))


def _require_unrefused(upload: PendingUpload) -> None:
    if upload.problem is not None:
        raise UploadGoneError(upload.id, str(upload.problem.get("detail")))
