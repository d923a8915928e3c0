"""Computations as copies of a process that has the libraries loaded."""

import asyncio
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import psutil
import pytest
from engine_harness import alive, wait_until
from engine_steps import PRACTISING

from service.adapters.files.object_files import blob_store
from service.adapters.processes.child_process import ChildProcesses
from service.adapters.processes.nursery import SCOUT
from service.adapters.processes.nursery_client import WarmUp
from service.errors import ComputationFailedError
from service.settings import Settings
from tests.measures.patience import patience

pytestmark = pytest.mark.service

STEPS = "engine_steps:STEPS"


def not_confined(folder: Path, **settings: bool) -> Settings:
    """Give settings with which the steps may write down what they do where the tests look, and start programs."""
    return Settings(data_dir=folder, confine_children=False, **settings)


@pytest.fixture
def runner(tmp_path: Path) -> Iterator[ChildProcesses]:
    made = ChildProcesses(not_confined(tmp_path), blob_store, STEPS)
    yield made
    made.close()


def nap(folder: Path, name: str, seconds: float = 0.05) -> dict[str, object]:
    return {"name": name, "seconds": seconds, "trace": str(folder / "trace")}


def started(folder: Path) -> list[int]:
    """Give the processes of the naps that have begun."""
    trace = folder / "trace"
    lines = trace.read_text().splitlines() if trace.exists() else []
    return [int(line.split()[2]) for line in lines if line.startswith("start")]


def nursery_of(computation: int) -> int:
    return psutil.Process(computation).ppid()


async def napping(runner: ChildProcesses, folder: Path, name: str) -> tuple["asyncio.Task[object]", int]:
    """Begin a long nap and wait until it sleeps."""
    known = len(started(folder))
    task = asyncio.create_task(runner.run("nap", nap(folder, name, 60.0), timeout_s=100.0 * patience()))
    await asyncio.to_thread(wait_until, lambda: len(started(folder)) > known)
    return task, started(folder)[-1]


def test_every_computation_has_a_process_of_its_own(runner: ChildProcesses, tmp_path: Path) -> None:
    async def three() -> None:
        for name in ("a", "b", "c"):
            await runner.run("nap", nap(tmp_path, name), timeout_s=30.0 * patience())

    asyncio.run(three())
    assert len(set(started(tmp_path))) == 3


def test_the_second_computation_starts_at_once(runner: ChildProcesses, tmp_path: Path) -> None:
    async def second() -> float:
        await runner.run("nap", nap(tmp_path, "a"), timeout_s=30.0 * patience())
        begun = time.monotonic()
        await runner.run("nap", nap(tmp_path, "b"), timeout_s=30.0 * patience())
        return time.monotonic() - begun

    assert asyncio.run(second()) < 0.5 * patience()  # a fresh interpreter alone takes as long


def test_computations_side_by_side_get_their_own_results(runner: ChildProcesses, tmp_path: Path) -> None:
    async def together() -> list[object]:
        runs = [runner.run("nap", nap(tmp_path, name, 0.3), timeout_s=30.0 * patience()) for name in "abcdef"]
        return list(await asyncio.gather(*runs))

    assert asyncio.run(together()) == [{"name": name} for name in "abcdef"]


def test_a_cancelled_computation_ends_within_a_second(runner: ChildProcesses, tmp_path: Path) -> None:
    async def cancelled() -> tuple[float, int]:
        task, process = await napping(runner, tmp_path, "long")
        begun = time.monotonic()
        task.cancel()
        await asyncio.wait({task})
        return time.monotonic() - begun, process

    seconds, process = asyncio.run(cancelled())
    assert (seconds < 1.0 * patience(), alive(process)) == (True, False)


def test_a_crash_is_told_with_its_signal_and_last_words(runner: ChildProcesses, tmp_path: Path) -> None:
    with pytest.raises(ComputationFailedError, match=r"SIGSEGV.*the roof is on fire"):
        asyncio.run(runner.run("crash", nap(tmp_path, "crash"), timeout_s=30.0 * patience()))


def test_the_death_of_the_nursery_ends_its_computations_and_is_got_over(runner: ChildProcesses, tmp_path: Path) -> None:
    async def bereaved() -> tuple[int, object]:
        task, process = await napping(runner, tmp_path, "long")
        os.kill(nursery_of(process), signal.SIGKILL)
        with pytest.raises(ComputationFailedError):
            await task
        return process, await runner.run("nap", nap(tmp_path, "next"), timeout_s=30.0 * patience())

    process, after = asyncio.run(bereaved())
    assert (alive(process), after) == (False, {"name": "next"})


def test_a_closed_runner_leaves_no_process(tmp_path: Path) -> None:
    async def closed() -> list[int]:
        runner = ChildProcesses(not_confined(tmp_path), blob_store, STEPS)
        task, process = await napping(runner, tmp_path, "long")
        family = [process, nursery_of(process)]
        runner.close()
        with pytest.raises(ComputationFailedError):
            await task
        return family

    family = asyncio.run(closed())
    # a dying process closes its pipes, which is what the runner notices, a moment before it is dead
    wait_until(lambda: not any(alive(process) for process in family), 1.0)


@pytest.mark.parametrize("settings", [{"nursery": False}, {"nursery": True}])
def test_where_there_is_no_nursery_computations_load_their_own_libraries(
    tmp_path: Path, settings: dict[str, bool]
) -> None:
    warm_up = WarmUp("engine_steps:not_there") if settings["nursery"] else WarmUp()
    runner = ChildProcesses(not_confined(tmp_path, **settings), blob_store, STEPS, warm_up)
    result = asyncio.run(runner.run("nap", nap(tmp_path, "cold"), timeout_s=60.0 * patience()))
    runner.close()
    assert result == {"name": "cold"}


@dataclass
class Practice:
    """A runner that has kernels to practise, and who practised."""

    runner: ChildProcesses
    told: Path

    def practised(self) -> list[list[str]]:
        """Give process, parent and name of all that practised."""
        return [line.split() for line in self.told.read_text().splitlines()] if self.told.exists() else []


@pytest.fixture
def practice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Practice]:
    monkeypatch.setenv("TMPDIR", str(tmp_path))  # of the variables that the steps get
    warm_up = WarmUp(practice="engine_steps:practise", kernels="engine_steps:practise", rest="engine_steps:practise")
    made = Practice(ChildProcesses(not_confined(tmp_path), blob_store, STEPS, warm_up), tmp_path / "practised")
    yield made
    made.runner.close()


def test_in_an_idle_moment_a_copy_compiles_then_the_nursery_loads_then_another_copy_compiles_the_rest(
    practice: Practice,
) -> None:
    practice.runner.warm_up()
    wait_until(lambda: len(practice.practised()) == 3)
    (first, parent_of_scout, scout), (nursery, _, name), (second, *rest) = practice.practised()
    assert (parent_of_scout, scout) == (nursery, SCOUT) == tuple(rest)
    assert name != SCOUT
    assert len({first, nursery, second}) == 3


def test_what_cannot_be_practised_is_left_and_computations_run(practice: Practice, tmp_path: Path) -> None:
    (tmp_path / PRACTISING).write_text("fails")
    practice.runner.warm_up()
    wait_until(lambda: len(practice.practised()) == 1)
    time.sleep(3.0)  # longer than the nursery would wait before it tried again
    assert asyncio.run(practice.runner.run("nap", nap(tmp_path, "a"), timeout_s=30.0 * patience())) == {"name": "a"}
    assert len(practice.practised()) == 1


def test_orders_are_followed_while_a_scout_compiles_and_it_ends_with_the_nursery(
    practice: Practice, tmp_path: Path
) -> None:
    (tmp_path / PRACTISING).write_text("takes long")
    practice.runner.warm_up()
    wait_until(lambda: len(practice.practised()) == 1)
    begun = time.monotonic()
    asyncio.run(practice.runner.run("nap", nap(tmp_path, "a"), timeout_s=30.0 * patience()))
    assert time.monotonic() - begun < 2.0 * patience() * patience()
    scout = int(practice.practised()[0][0])
    assert alive(scout)
    practice.runner.close()
    wait_until(lambda: not alive(scout), 1.0)


def test_loading_leaves_one_thread(tmp_path: Path) -> None:
    """Copies of a process with several threads are not whole."""
    program = (
        "import os; from service.use_cases.steps.warm_up import load_for_registration, load_for_reports; "
        "from service.use_cases.steps.kernels import load_common_kernels; "
        "load_for_registration(); load_for_reports(); load_common_kernels(); print(len(os.listdir('/proc/self/task')))"
    )
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "2", "OMP_NUM_THREADS": "2"}
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, cwd=tmp_path, check=True
    )
    assert done.stdout.strip() == "1"
