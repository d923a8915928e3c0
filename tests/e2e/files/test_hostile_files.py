"""Damaged files and bombs, inspected in processes of their own as uploads are: read or refused, whatever they claim.

`TIELINE_FUZZ` is the number of damaged files; each has its number for a seed.
"""

import asyncio
import os
import socket
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import psutil
import pytest

from service.adapters.files.object_files import blob_store
from service.adapters.processes.child_process import ChildProcesses
from service.adapters.processes.nursery_client import WarmUp
from service.errors import ComputationFailedError
from service.ports import StepFailedError
from service.settings import Settings
from tests.measures.patience import patience
from tests.scenes.hostile.hostile_bombs import bombs
from tests.scenes.hostile.hostile_mutations import damaged
from tests.scenes.hostile.hostile_seeds import MADE_HERE, MESH_WRITERS, WRITERS, whole_files

pytestmark = pytest.mark.service

DAMAGED_FILES = int(os.environ.get("TIELINE_FUZZ", "220"))
AT_ONCE = 20
"""Files of one test."""
MAX_POINTS, MAX_PIXELS = 1_000_000, 4_000_000
BYTES_PER_POINT, BYTES_PER_PIXEL, BYTES_PER_BYTE, LIBRARIES_BYTES = 160, 12, 60, 40_000_000
"""What reading may need beside each other: coordinates, colours and copies of them; pixels twice; XML as a tree."""
LONGEST_CPU_S = 8.0
"""Of files of a few MB at most."""
PATIENCE_S = 280.0
"""The machine may be busy with other things."""


@dataclass
class Inspection:
    """Inspects contents, and counts what came of them."""

    runner: ChildProcesses
    settings: Settings
    outcomes: Counter[str] = field(default_factory=Counter)
    largest_growth: int = 0
    largest_cpu_s: float = 0.0

    def of(self, name: str, content: bytes) -> Mapping[str, Any]:
        """Give ``{"found"}`` or ``{"problem"}``; the process that read has ended."""
        path = self.settings.data_dir / "blobs" / "incoming" / "hostile"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
        try:
            answer = asyncio.run(self._run({"key": "incoming/hostile", "filename": name, "bytes": len(content)}))
        except StepFailedError as error:
            pytest.fail(f"{name}: {error.problem}")
        except ComputationFailedError as error:
            pytest.fail(f"{name}: {error}")
        path.unlink()
        assert answer["cpu_s"] < LONGEST_CPU_S
        self.largest_growth = max(self.largest_growth, answer["grown"])
        self.largest_cpu_s = max(self.largest_cpu_s, answer["cpu_s"])
        self.outcomes["read" if "found" in answer else str(answer["problem"]["status"])] += 1
        return answer

    async def _run(self, arguments: dict[str, Any]) -> dict[str, Any]:
        return await self.runner.run("inspect-file", arguments, timeout_s=PATIENCE_S * patience())

    def is_bounded(self, answer: Mapping[str, Any], content: bytes) -> bool:
        """Tell whether memory kept to what the limits and the length of the file allow."""
        allowed = max(MAX_POINTS * BYTES_PER_POINT, MAX_PIXELS * BYTES_PER_PIXEL)
        return bool(answer["grown"] <= LIBRARIES_BYTES + allowed + BYTES_PER_BYTE * len(content))


@pytest.fixture(scope="module")
def inspection(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Inspection]:
    home = tmp_path_factory.mktemp("hostile")
    settings = Settings(
        data_dir=home, max_points=MAX_POINTS, max_photo_pixels=MAX_PIXELS, step_memory_bytes=2_000_000_000
    )
    warm_up = WarmUp("service.use_cases.steps.warm_up:load_for_reading")
    runner = ChildProcesses(settings, blob_store, "tests.scenes.hostile.hostile_steps:STEPS", warm_up)
    before = set(psutil.Process().children(recursive=True))
    made = Inspection(runner, settings)
    yield made
    print(f"\n{dict(made.outcomes)}, at most {made.largest_growth / 1e6:.0f} MB and {made.largest_cpu_s:.1f} s")
    runner.close()
    left = [path for path in home.rglob("*") if path.is_file()]
    assert left == []
    _, alive = psutil.wait_procs(set(psutil.Process().children(recursive=True)) - before, timeout=5.0 * patience())
    assert alive == []


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, bytes]:
    return whole_files(tmp_path_factory.mktemp("whole"))


@pytest.fixture(scope="module")
def whole_meshes(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, bytes]:
    return whole_files(tmp_path_factory.mktemp("meshes"), {**MESH_WRITERS, **MADE_HERE})


def fault_of(name: str, answer: Mapping[str, Any]) -> str:
    """Say what is wrong with an outcome: a refusal names the file, the reason and the place; empty: nothing."""
    if "found" in answer:
        return ""
    problem = answer["problem"]
    if problem["status"] == 413:
        return "" if name in problem["detail"] else f"which file? {problem}"
    told = problem["status"] == 400 and problem["file"] == name and problem["reason"] and problem["place"]
    return "" if told else f"says too little: {problem}"


@pytest.mark.parametrize("name", WRITERS)
def test_the_whole_file_is_read(inspection: Inspection, whole: Mapping[str, bytes], name: str) -> None:
    assert "found" in inspection.of(name, whole[name])


@pytest.mark.parametrize("name", MESH_WRITERS)
def test_the_whole_mesh_is_read(inspection: Inspection, whole_meshes: Mapping[str, bytes], name: str) -> None:
    assert "found" in inspection.of(name, whole_meshes[name])


@pytest.mark.parametrize("first", range(0, DAMAGED_FILES, AT_ONCE))
def test_damaged_files_are_read_or_refused(inspection: Inspection, whole: Mapping[str, bytes], first: int) -> None:
    assert faults_of(inspection, whole, first) == {}


@pytest.mark.parametrize("first", range(0, DAMAGED_FILES // 11, AT_ONCE))
def test_damaged_meshes_are_read_or_refused(
    inspection: Inspection, whole_meshes: Mapping[str, bytes], first: int
) -> None:
    assert faults_of(inspection, whole_meshes, first) == {}


def faults_of(inspection: Inspection, whole: Mapping[str, bytes], first: int) -> Mapping[int, tuple[str, str, int]]:
    """Inspect some damaged files; give what is wrong with the outcomes, by number."""
    faults = {}
    for number in range(first, min(first + AT_ONCE, DAMAGED_FILES)):
        name, content = damaged(whole, number)
        answer = inspection.of(name, content)
        fault = fault_of(name, answer)
        if fault or not inspection.is_bounded(answer, content):
            faults[number] = (name, fault, answer["grown"])
    return faults


@pytest.fixture(scope="module")
def listener() -> Iterator[socket.socket]:
    """Listen where nobody may connect."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.setblocking(False)
        yield server


def outside(listener: socket.socket) -> str:
    return f"http://127.0.0.1:{listener.getsockname()[1]}/secret"


BOMBS = tuple(bombs(dict.fromkeys(WRITERS, b""), "http://127.0.0.1/"))


@pytest.mark.parametrize("which", BOMBS)
def test_a_bomb_is_refused_or_does_no_harm(
    inspection: Inspection, whole: Mapping[str, bytes], listener: socket.socket, which: str
) -> None:
    name, content = bombs(whole, outside(listener))[which]()
    answer = inspection.of(name, content)
    assert fault_of(name, answer) == ""
    assert inspection.is_bounded(answer, content), f"{answer['grown'] / 1e6:.0f} MB"
    assert "root:" not in str(answer), "read /etc/passwd"
    with pytest.raises(BlockingIOError):
        listener.accept()
