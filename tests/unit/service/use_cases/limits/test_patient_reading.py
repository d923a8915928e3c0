"""Streams that fall silent."""

import asyncio
from collections.abc import AsyncIterator

import pytest

from service.errors import RequestTimeoutError
from service.use_cases.limits.patient_reading import timely


async def chunks(*pauses_s: float) -> AsyncIterator[bytes]:
    for pause_s in pauses_s:
        await asyncio.sleep(pause_s)
        yield b"x"


def collected(stream: AsyncIterator[bytes]) -> list[bytes]:
    async def collect() -> list[bytes]:
        return [chunk async for chunk in stream]

    return asyncio.run(collect())


def test_a_stream_passes_as_it_is() -> None:
    assert collected(timely(chunks(0, 0, 0), 1.0)) == [b"x"] * 3


def test_silence_is_filled_with_empty_chunks() -> None:
    found = collected(timely(chunks(0, 0.1, 0), 10.0, 0.02))
    assert b"".join(found) == b"xxx"
    assert found.count(b"") >= 2


def test_silence_that_lasts_too_long_is_an_error() -> None:
    with pytest.raises(RequestTimeoutError, match=r"0\.05 s"):
        collected(timely(chunks(0, 5.0), 0.05))


def test_the_time_counts_from_the_last_chunk() -> None:
    stream = timely((chunk * 100 async for chunk in chunks(*[0.03] * 5)), 0.1)
    assert collected(stream) == [b"x" * 100] * 5


def test_a_stream_that_only_trickles_is_an_error() -> None:
    with pytest.raises(RequestTimeoutError):
        collected(timely(chunks(*[0.02] * 100), 0.1))


def test_time_in_which_nobody_waits_for_the_stream_is_not_its_fault() -> None:
    async def slowly() -> int:
        count = 0
        async for _ in timely(chunks(*[0.0] * 5), 0.05):
            count += 1
            await asyncio.sleep(0.03)
        return count

    assert asyncio.run(slowly()) == 5


def test_an_error_of_the_stream_passes() -> None:
    async def broken() -> AsyncIterator[bytes]:
        yield b"x"
        raise ConnectionError

    with pytest.raises(ConnectionError):
        collected(timely(broken(), 1.0))
