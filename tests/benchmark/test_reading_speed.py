"""Speed of reading scans beside the plain libraries, of files of ten million points, in processes of their own."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from algorithms.progress import NoProgress
from service.formats.writers import writer_of
from tests.benchmark import large_scan_child, reading_child
from tests.benchmark.test_registered_scans import hall

pytestmark = pytest.mark.benchmark
LEAST_OF_LIBRARY = 0.8
POINTS, SMALL = 10_000_000, 20_000
REPEATS = 3
LARGE, MOST_BYTES = 200_000_000, 2 << 30


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


@pytest.mark.timeout(1800)
def test_two_hundred_million_points_are_inspected_and_used_within_two_gigabytes(tmp_path: Path) -> None:
    file = tmp_path / "large.e57"
    writer_of("e57").write(file, [hall(LARGE, color=False)], NoProgress())
    command = [sys.executable, "-m", large_scan_child.__name__, str(file)]
    found = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    file.unlink()
    print(
        f"E57 of {found['points'] / 1e6:.0f} M points: inspected in {found['inspected_s']:.0f} s, read in part in "
        f"{found['read_s']:.0f} s, {found['planes']} planes in {found['features_s']:.0f} s; peak of the process "
        f"{found['inspection_bytes'] / 2**30:.2f} GiB after inspection, {found['bytes'] / 2**30:.2f} GiB"
        f"; {found['words']}"
    )
    assert found["points"] == LARGE
    assert found["planes"] >= 6
    assert found["bytes"] <= MOST_BYTES
