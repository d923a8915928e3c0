"""Read what a client sends, but not for ever."""

import asyncio
from collections.abc import AsyncIterator

from service.errors import RequestTimeoutError


async def timely(chunks: AsyncIterator[bytes], timeout_s: float, tick_s: float | None = None) -> AsyncIterator[bytes]:
    """Pass a stream on.

    Parameters
    ----------
    chunks
        The stream.
    timeout_s
        Longest time without a chunk.
    tick_s
        While none comes, an empty one is given so often, for the reader to do something else; None: never.

    Raises
    ------
    RequestTimeoutError
        No chunk came in time.
    """
    tick_s = timeout_s if tick_s is None else tick_s
    while True:
        pending = asyncio.ensure_future(anext(chunks, None))
        try:
            waited = 0.0
            while not (await asyncio.wait({pending}, timeout=tick_s))[0]:
                waited += tick_s
                if waited >= timeout_s:
                    raise RequestTimeoutError(timeout_s)
                yield b""
            chunk = pending.result()
        finally:
            pending.cancel()
        if chunk is None:
            return
        yield chunk
