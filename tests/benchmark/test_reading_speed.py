"""Speed of reading scans beside the plain libraries, of files of ten million points, in processes of their own."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from algorithms.progress import NoProgress
from service.formats.writers import writer_of
from tests.benchmark import reading_child
from tests.benchmark.test_registered_scans import hall

pytestmark = pytest.mark.benchmark
LEAST_OF_LIBRARY = 0.8
POINTS, SMALL = 10_000_000, 20_000
REPEATS = 3


def used(way: str, file: Path, small: Path) -> dict[str, float]:
    command = [sys.executable, "-m", reading_child.__name__, way, str(file), str(small), str(REPEATS)]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


@pytest.mark.parametrize(("kind", "library"), [("e57", "pye57"), ("laz", "laspy")])
def test_a_file_is_read_nearly_as_fast_as_by_the_plain_library(kind: str, library: str, tmp_path: Path) -> None:
    file, small = tmp_path / f"large.{kind}", tmp_path / f"small.{kind}"
    for path, points in ((file, POINTS), (small, SMALL)):
        writer_of(kind).write(path, [hall(points, color=True)], NoProgress())
    theirs, ours = used(library, file, small), used("tieline", file, small)
    for name, each in ((library, theirs), ("tieline", ours)):
        rate = POINTS / each["seconds"] / 1e6
        print(
            f"{kind}, {POINTS / 1e6:.0f} M points, {name}: {each['seconds']:.2f} s, {rate:.1f} M points/s, processor "
            f"{each['processor_s']:.2f} s, {each['bytes'] / 2**20:.0f} MiB"
        )
    speed = theirs["seconds"] / ours["seconds"]
    print(f"speed beside {library}: {speed:.2f}, by processor time {theirs['processor_s'] / ours['processor_s']:.2f}")
    assert speed >= LEAST_OF_LIBRARY
