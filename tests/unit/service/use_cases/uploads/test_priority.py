"""Computations, and threads that write uploads, step back behind requests."""

import asyncio
import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from service.use_cases.uploads import upload_threads
from service.use_cases.uploads.upload_threads import step_back, undisturbed

NICENESS = 7

PROGRAM = """
import os, sys
from pathlib import Path
from service.adapters.processes.process_limits import let_others_first
let_others_first(int(sys.argv[1]))
let_others_first(int(sys.argv[1]))
session = Path("/proc/self/autogroup")
batch = os.sched_getscheduler(0) == os.SCHED_BATCH
print(os.getpriority(os.PRIO_PROCESS, 0), batch, session.read_text() if session.exists() else "")
"""


def said_with(niceness: int) -> str:
    """Said by a process that has let others first, in a session of its own as computations are."""
    command = [sys.executable, "-c", PROGRAM, str(niceness)]
    return subprocess.run(command, capture_output=True, text=True, check=True, start_new_session=True).stdout


@pytest.fixture(scope="module")
def said() -> str:
    return said_with(NICENESS)


def test_where_somebody_waits_for_it_nothing_steps_back() -> None:
    assert said_with(0).split()[:2] == [str(os.getpriority(os.PRIO_PROCESS, 0)), "False"]


def test_a_computation_is_nicer_than_others_and_no_nicer_when_it_is_told_twice(said: str) -> None:
    assert int(said.split(maxsplit=1)[0]) == max(NICENESS, os.getpriority(os.PRIO_PROCESS, 0))


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux knows batch processes")
def test_a_computation_that_wakes_up_pushes_nothing_aside(said: str) -> None:
    assert said.split()[1] == "True"


@pytest.mark.skipif(not Path("/proc/self/autogroup").exists(), reason="sessions have no share of their own here")
def test_its_session_has_a_smaller_share_too(said: str) -> None:
    # the kernel takes one such wish in a tenth of a second from all users but root, so that it may go unheard
    assert said.rsplit(maxsplit=1)[-1] in {str(NICENESS), "0"}


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux gives every thread a priority of its own")
def test_threads_that_write_uploads_are_nicer_than_the_one_that_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(upload_threads, "_threads", ThreadPoolExecutor(1, initializer=upload_threads._step_back))
    monkeypatch.setattr(upload_threads, "_niceness", [0])
    step_back(NICENESS)

    def niceness() -> int:
        return os.getpriority(os.PRIO_PROCESS, threading.get_native_id())

    before = niceness()
    assert asyncio.run(undisturbed(niceness)) == max(NICENESS, before)
    assert niceness() == before
