"""Threads of uploads."""

import asyncio
import threading

import pytest

from service.use_cases.uploads.upload_threads import undisturbed
from tests.measures.patience import patience


def test_who_is_cancelled_waits_until_what_runs_has_ended() -> None:
    begun, may_end, ended = threading.Event(), threading.Event(), threading.Event()

    def write() -> None:
        begun.set()
        may_end.wait(10.0)
        ended.set()

    async def cancelled() -> bool:
        writing = asyncio.create_task(undisturbed(write))
        await asyncio.to_thread(begun.wait, 10.0)
        writing.cancel()
        await asyncio.sleep(0)
        ended_early = writing.done()
        may_end.set()
        with pytest.raises(asyncio.CancelledError):
            await writing
        return ended_early

    assert not asyncio.run(cancelled())
    assert ended.is_set()


def test_others_answer_while_all_of_them_wait_for_the_disk() -> None:
    disk = threading.Event()

    async def answered() -> int:
        writing = [asyncio.create_task(undisturbed(disk.wait, 10.0)) for _ in range(40)]
        answer = await asyncio.wait_for(asyncio.to_thread(lambda: 42), 5.0 * patience())
        disk.set()
        await asyncio.gather(*writing)
        return answer

    assert asyncio.run(answered()) == 42
