"""Read what a client sends, but not for ever."""

import asyncio
import time
from collections.abc import AsyncIterator

from service.errors import RequestTimeoutError

LEAST_BYTES_PER_S = 500


async def timely(chunks: AsyncIterator[bytes], timeout_s: float, tick_s: float | None = None) -> AsyncIterator[bytes]:
    """Pass a stream on.

    Parameters
    ----------
    chunks
        The stream.
    timeout_s
        Longest time without a chunk; and of all the time that is spent waiting, the longest in which less than
        `LEAST_BYTES_PER_S` come.
    tick_s
        While none comes, an empty one is given so often, for the reader to do something else; None: never.

    Raises
    ------
    RequestTimeoutError
        No chunk came in time, or too little.
    """
    tick_s = timeout_s if tick_s is None else tick_s
    pace = _Pace(timeout_s)
    while True:
        pending = asyncio.ensure_future(anext(chunks, None))
        begun = time.monotonic()
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
        pace.note(len(chunk), time.monotonic() - begun)
        yield chunk


class _Pace:
    """Look whether enough comes. Time in which nobody waits, because the service is busy with what has come, is none.

    Parameters
    ----------
    span_s
        Over which it is looked at.
    """

    def __init__(self, span_s: float) -> None:
        self._span_s = span_s
        self._bytes, self._waited_s = 0, 0.0

    def note(self, size: int, waited_s: float) -> None:
        """Take note of a chunk. RequestTimeoutError when it and those before it are too little."""
        self._bytes += size
        self._waited_s += waited_s
        if self._waited_s < self._span_s:
            return
        if self._bytes < LEAST_BYTES_PER_S * self._waited_s:
            raise RequestTimeoutError(self._span_s)
        self._bytes, self._waited_s = 0, 0.0
