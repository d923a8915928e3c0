"""Inspections take turns: on the machine, within a project, and large files take several places."""

import asyncio
import time
from contextlib import suppress
from pathlib import Path

import pytest

from service.refusals import BusyError
from service.settings import GIGABYTE, Settings
from service.use_cases.access.service_proof import LOCK
from service.use_cases.limits.machine_shares import INSPECT, machine_memory_bytes, machine_shares
from service.use_cases.uploads.inspection_places import inspection_place
from tests.measures.patience import patience


class Crowd:
    """Hold places until told to leave, and count who is in."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.inside: list[str] = []
        self.most = 0
        self.leave = asyncio.Event()

    async def visit(self, owner: str, size: int = 1000, wait_s: float = 20.0) -> None:
        async with inspection_place(self.settings, owner, "a.e57", size, wait_s):
            self.inside.append(owner)
            self.most = max(self.most, len(self.inside))
            await self.leave.wait()
            self.inside.remove(owner)

    async def settled(self, number: int) -> None:
        async with asyncio.timeout(20.0 * patience()):
            while len(self.inside) < number:  # noqa: ASYNC110 - visitors come and go
                await asyncio.sleep(0.01)
        await asyncio.sleep(0.2)  # long enough for one more to come in, were there a place


@pytest.fixture
def settings(tmp_path: Path, request: pytest.FixtureRequest) -> Settings:
    if getattr(request, "param", "a service") == "a service":
        (tmp_path / LOCK).touch()
    return Settings(data_dir=tmp_path, inspections=3)


async def _crowded(settings: Settings, visitors: list[tuple[str, int]], inside: int) -> Crowd:
    crowd = Crowd(settings)
    visits = [asyncio.ensure_future(crowd.visit(*visitor)) for visitor in visitors]
    await crowd.settled(inside)
    assert len(crowd.inside) == inside
    crowd.leave.set()
    await asyncio.gather(*visits)
    return crowd


@pytest.mark.parametrize("settings", ["a service", "nothing"], indirect=True)
def test_no_more_than_the_machine_has_places_for_are_inspected(settings: Settings) -> None:
    crowd = asyncio.run(_crowded(settings, [(f"project {k}", 1000) for k in range(9)], 3))
    assert crowd.most == 3


def test_a_project_leaves_a_place_to_others(settings: Settings) -> None:
    async def flooded() -> None:
        crowd = Crowd(settings)
        flood = [asyncio.ensure_future(crowd.visit("flooding")) for _ in range(20)]
        await crowd.settled(2)
        other = asyncio.ensure_future(crowd.visit("other"))
        await crowd.settled(3)
        assert sorted(crowd.inside) == ["flooding", "flooding", "other"]
        crowd.leave.set()
        await asyncio.gather(*flood, other)

    asyncio.run(flooded())


def test_who_waits_too_long_is_told_when_to_come_back(settings: Settings) -> None:
    async def waiting() -> None:
        crowd = Crowd(settings)
        held = [asyncio.ensure_future(crowd.visit(f"project {k}")) for k in range(3)]
        await crowd.settled(3)
        with pytest.raises(BusyError, match="its turn") as refused:
            await crowd.visit("late", wait_s=0.2)
        assert (refused.value.status, refused.value.headers()) == (503, {"Retry-After": "10"})
        crowd.leave.set()
        await asyncio.gather(*held)

    asyncio.run(waiting())


def test_a_place_is_free_when_who_waits_or_inspects_is_cancelled(settings: Settings) -> None:
    async def cancelled() -> None:
        crowd = Crowd(settings)
        visits = [asyncio.ensure_future(crowd.visit(f"project {k}")) for k in range(5)]
        await crowd.settled(3)
        for visit in visits:
            visit.cancel()
        await asyncio.wait(visits)
        crowd.inside.clear()
        again = [asyncio.ensure_future(crowd.visit(f"project {k}")) for k in range(3)]
        await crowd.settled(3)
        crowd.leave.set()
        await asyncio.gather(*again)

    asyncio.run(cancelled())


def test_a_large_file_takes_all_places_and_is_not_starved_by_small_ones(settings: Settings) -> None:
    async def large() -> None:
        crowd = Crowd(settings)
        small = asyncio.ensure_future(crowd.visit("small"))
        await crowd.settled(1)
        big = asyncio.ensure_future(crowd.visit("big", 10**15))
        await asyncio.sleep(0.2)
        later = [asyncio.ensure_future(crowd.visit(f"later {k}")) for k in range(3)]
        await crowd.settled(1)
        assert crowd.inside == ["small"]
        crowd.leave.set()
        await asyncio.gather(small, big, *later)

    asyncio.run(large())


def test_places_of_another_process_count(settings: Settings) -> None:
    async def held() -> None:
        crowd = Crowd(settings)
        visits = [asyncio.ensure_future(crowd.visit(f"project {k}")) for k in range(3)]
        await crowd.settled(3)
        began = time.monotonic()
        # another event loop knows nothing of those who wait in this one, as little as another process does
        refused = await asyncio.to_thread(asyncio.run, _refused(settings))
        assert refused
        assert time.monotonic() - began < 20.0 * patience()
        crowd.leave.set()
        await asyncio.gather(*visits)

    asyncio.run(held())


async def _refused(settings: Settings) -> bool:
    with suppress(BusyError):
        async with inspection_place(settings, "late", "a.e57", 1000, 0.2):
            return False
    return True


@pytest.mark.parametrize("memory", [8 * GIGABYTE, 24 * GIGABYTE, 512 * GIGABYTE])
@pytest.mark.parametrize("slots", [1, 2, 8])
def test_all_that_may_run_at_once_fits_the_machine(memory: int, slots: int) -> None:
    settings = Settings(slots=slots, step_memory_bytes=1000 * GIGABYTE)
    shares = machine_shares(settings, memory)
    together = slots * shares.step_bytes + shares.places * shares.memory_of(INSPECT, 1000)
    assert together <= 0.81 * memory
    assert shares.memory_of(INSPECT, 10**12) == shares.places * shares.place_bytes


def test_no_step_has_more_than_the_operator_allows() -> None:
    shares = machine_shares(Settings(step_memory_bytes=GIGABYTE), 512 * GIGABYTE)
    assert {shares.memory_of(step, 10**12) for step in (INSPECT, "features")} == {GIGABYTE}


def test_the_memory_of_this_machine_is_known() -> None:
    assert 100_000_000 < machine_memory_bytes() < 10**14
