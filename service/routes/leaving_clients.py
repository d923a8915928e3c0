"""What is done for a client is given up when the client has gone."""

import asyncio
from collections.abc import AsyncIterator, Coroutine
from typing import Any, TypeVar

from fastapi import Request
from starlette.requests import ClientDisconnect

Value = TypeVar("Value")


async def marked(chunks: AsyncIterator[Value], read: asyncio.Event) -> AsyncIterator[Value]:
    """Pass on what is read of a body, and note its end."""
    async for chunk in chunks:
        yield chunk
    read.set()


async def unless_client_leaves(request: Request, work: Coroutine[Any, Any, Value], read: asyncio.Event) -> Value:
    """Do the work of a request; give it up when its client goes after the body was read.

    Parameters
    ----------
    request, work
        What is done, and for whom.
    read
        Set by the work when nothing of the body is left to be read: until then who reads it sees the client go.

    Raises
    ------
    starlette.requests.ClientDisconnect
        The client has gone.
    """
    doing = asyncio.ensure_future(work)
    watching = asyncio.ensure_future(_departure(request, read))
    try:
        await asyncio.wait({doing, watching}, return_when=asyncio.FIRST_COMPLETED)
        if doing.done():
            return doing.result()
        watching.result()  # also when it was the key that has gone
        raise ClientDisconnect
    finally:
        for task in (doing, watching):
            task.cancel()
        await asyncio.wait({doing, watching})


async def _departure(request: Request, read: asyncio.Event) -> None:
    await read.wait()
    while (await request.receive())["type"] != "http.disconnect":
        pass
