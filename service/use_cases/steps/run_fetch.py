"""Fetch one file to this machine: a step of a job, in a process of its own."""

import asyncio
from collections.abc import AsyncIterator

from service.errors import AddressRefusedError, FileTooLargeError, UnreadableFileError
from service.names.content_keys import incoming_key
from service.ports import Json, RemoteFile, StepContext
from service.use_cases.limits.free_space import BYTES_BETWEEN_CHECKS, require_free_space

MEGABYTE = 1_000_000


def fetch_file(context: StepContext, arguments: Json) -> Json:
    """Write the file where files arrive; give its name, size and hash. Nothing remains of one that does not arrive.

    Raises
    ------
    AddressRefusedError
        It is not allowed, not there, or not reached.
    FileTooLargeError, InsufficientStorageError
        A limit is reached.
    UnreadableFileError
        It is empty.
    """
    return asyncio.run(_fetched(context, arguments))


async def _fetched(context: StepContext, arguments: Json) -> Json:
    if context.sources is None:
        raise AddressRefusedError(arguments["href"], "this process reaches no other servers")
    most = int(arguments["max_bytes"])
    async with context.sources.opened(arguments["href"]) as remote:
        declared = remote.declared_bytes or 0
        if declared > most:
            raise FileTooLargeError(remote.name, declared, most)
        _require_room(context, declared)
        key = incoming_key(arguments["id"])
        size, sha256 = await context.blobs.write_stream(key, _watched(context, remote), most, declared)
    if size == 0:
        context.blobs.delete_prefix(key)
        raise UnreadableFileError(remote.name, "the file is empty", "byte 0")
    return {"name": remote.name, "bytes": size, "sha256": sha256}


async def _watched(context: StepContext, remote: RemoteFile) -> AsyncIterator[bytes]:
    """Pass the file on, tell how far it is, and stop before the disk is full."""
    got = unchecked = 0
    async for chunk in remote.chunks:
        got += len(chunk)
        unchecked += len(chunk)
        if unchecked >= BYTES_BETWEEN_CHECKS:
            _require_room(context)
            unchecked = 0
        if remote.declared_bytes:
            context.progress.report(got / remote.declared_bytes, f"{100 * got // remote.declared_bytes} %")
        else:
            context.progress.report(0.0, f"{got // MEGABYTE} MB")
        yield chunk


def _require_room(context: StepContext, coming_bytes: int = 0) -> None:
    scratch = context.blobs.scratch()
    require_free_space(scratch, context.limits["min_free_bytes"], coming_bytes)
    scratch.rmdir()
