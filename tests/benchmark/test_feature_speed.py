"""Speed and memory of feature extraction, by stages, on simulated scans of five and of fifty million points.

Wall time means something only on an idle machine. So the tests judge what it would be on two idle cores: the processor
time of the main thread, and half of that of the threads that work together while it waits. Everything is measured in
processes of their own, as the service runs it: tests check the shapes of all arrays at every call.
"""

import dataclasses
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

from algorithms.simulation.pipe_hall import pipe_hall_scene
from algorithms.simulation.scanner import scanner_with_step
from algorithms.simulation.scanning import scan_scene

pytestmark = pytest.mark.benchmark

STEP_RAD = float(np.deg2rad(0.1))
"""3600 x 1500 pixels: 5.3 million points in the pipe hall."""
FEATURES = "planes, lines, cylinders"
STAGES = {"planes": "lines", "planes, lines": "cylinders", FEATURES: "surface", "with surface and sight": "end"}
"""What is found, and the mark at which it is; last come the thinned surface and what was seen in each direction."""
LARGE = (4200, 12000)
"""Rows and columns of the large scan: 50.4 million points."""


def pipe_hall(step_rad):
    scene = pipe_hall_scene()
    return scan_scene(scene, scene.stations[0], scanner_with_step(step_rad), np.random.default_rng(1))


def without_grid(scan):
    """Give the scan as a cloud in random order."""
    order = np.random.default_rng(2).permutation(len(scan))
    return dataclasses.replace(scan, points=scan.points[order], grid=None, intensity=None, color=None)


@dataclasses.dataclass
class Rates:
    """Points per second on two idle cores by what is found, and what is printed of them."""

    found: dict[str, float]
    text: str

    def of(self, stage):
        print(f"\n{self.text}")
        return self.found[stage]


def rates(kind, repeats=8):
    """Take the time of all stages, of the fastest of several runs."""
    *figures, points, planes, lines, cylinders = run_alone(
        f"""
        import dataclasses, sys
        from benchmark.test_feature_speed import STAGES, pipe_hall, without_grid
        from tests.measures.feature_stages import timed_features
        as_wanted = without_grid if sys.argv[1] == "shuffled" else lambda scan: scan
        scan = as_wanted(pipe_hall({STEP_RAD}))
        timed_features(as_wanted(pipe_hall(10 * {STEP_RAD})))
        timed_features(dataclasses.replace(without_grid(scan), points=scan.points[::4].copy()))
        runs = [timed_features(scan) for _ in range({repeats})]
        features = runs[0][0]
        times = [min(clock.until(mark)[k] for _, clock in runs) for mark in STAGES.values() for k in range(3)]
        print(*times, len(scan), len(features.planes), len(features.lines), len(features.cylinders))
        """,
        kind,
    )
    text = [f"{kind}: {points:.0f} points, {planes:.0f} planes, {lines:.0f} lines, {cylinders:.0f} cylinders"]
    found = {}
    for number, stage in enumerate(STAGES):
        wall, processor, idle = figures[3 * number : 3 * number + 3]
        found[stage] = points / idle
        text.append(
            f"  {stage:25s} wall {wall:5.2f} s, processor {processor:5.2f} s, "
            f"on two idle cores {idle:5.2f} s = {found[stage] / 1e6:5.1f} M points/s"
        )
    return Rates(found, "\n".join(text))


@pytest.fixture(scope="module")
def structured_rates():
    return rates("structured")


@pytest.fixture(scope="module")
def shuffled_rates():
    return rates("shuffled")


def test_planes_of_a_structured_scan_are_found_at_fifteen_million_points_a_second(structured_rates):
    assert structured_rates.of("planes") >= 15e6


def test_planes_of_a_shuffled_cloud_are_found_at_twelve_million_points_a_second(shuffled_rates):
    assert shuffled_rates.of("planes") >= 12e6


def test_lines_and_cylinders_included_a_structured_scan_takes_a_second_per_eight_million_points(structured_rates):
    assert structured_rates.of(FEATURES) >= 8e6


def test_lines_and_cylinders_included_a_shuffled_cloud_takes_a_second_per_eight_million_points(shuffled_rates):
    assert shuffled_rates.of(FEATURES) >= 8e6


def run_alone(script, *arguments):
    """Run a script in a process of its own and give the numbers of its last line."""
    tests = Path(__file__).parent.parent
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script), *map(str, arguments)],
        capture_output=True,
        text=True,
        check=True,
        cwd=tests.parent,
        env={"PYTHONPATH": f"{tests}:{tests.parent}", "OPENBLAS_NUM_THREADS": "1"},
    )
    return [float(value) for value in done.stdout.split("\n")[-2].split()]


def test_memory_stays_within_three_times_the_coordinates():
    """Measured in a process of its own, as the increase of the peak over the loaded scan."""
    (ratio,) = run_alone(
        f"""
        import resource
        from benchmark.test_feature_speed import pipe_hall
        from tests.measures.feature_stages import timed_features
        def now():
            return int(open("/proc/self/statm").read().split()[1]) * resource.getpagesize()
        timed_features(pipe_hall(10 * {STEP_RAD}))
        big = pipe_hall({STEP_RAD})
        open("/proc/self/clear_refs", "w").write("5")  # forget the peak of the simulation
        before = now()
        timed_features(big)
        peak = [l for l in open("/proc/self/status") if l.startswith("VmHWM")][0]
        print((int(peak.split()[1]) * 1024 - before) / big.points.nbytes)
        """
    )
    print(f"\nextra memory at the peak: {ratio:.2f} times the coordinates")
    assert ratio < 3.0


@pytest.mark.parametrize("kind", ["grid", "cloud"])
def test_fifty_million_points_are_read_from_disk_in_passes(tmp_path, kind):
    """The coordinates stay in the file; memory is what the process holds besides mapped files, sampled all the time."""
    rows, columns = LARGE
    planes, lines, cylinders, wall, processor, idle, ratio = run_alone(
        """
        import dataclasses, sys, threading, time
        import numpy as np
        from tests.measures.feature_stages import hall_scan, timed_features
        path, rows, columns, kind = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), sys.argv[4]
        def as_wanted(scan):
            return scan if kind == "grid" else dataclasses.replace(scan, grid=None)
        def held():
            line = [l for l in open("/proc/self/status") if l.startswith("RssAnon")][0]
            return int(line.split()[1]) * 1024
        timed_features(as_wanted(hall_scan(1000, 1200)))
        points = np.lib.format.open_memmap(path, "w+", np.float64, (rows * columns, 3))
        scan = as_wanted(hall_scan(rows, columns, points))
        peak, running = [held()], [True]
        before = peak[0]
        def watch():
            while running[0]:
                peak[0] = max(peak[0], held())
                time.sleep(0.005)
        watcher = threading.Thread(target=watch)
        watcher.start()
        features, clock = timed_features(scan)
        running[0] = False
        watcher.join()
        print(len(features.planes), len(features.lines), len(features.cylinders), *clock.until("end"),
              (peak[0] - before) / points.nbytes)
        """,
        tmp_path / "points.npy", rows, columns, kind,
    )  # fmt: skip
    (tmp_path / "points.npy").unlink()
    count = rows * columns
    print(
        f"\n{kind} of {count} points: {planes:.0f} planes, {lines:.0f} lines, {cylinders:.0f} cylinders; wall "
        f"{wall:.1f} s, processor {processor:.1f} s, on two idle cores "
        f"{idle:.1f} s = {count / idle / 1e6:.1f} M points/s; "
        f"memory {ratio:.2f} times the coordinates"
    )
    assert planes >= 6
    assert cylinders == 6
    assert ratio < 1.0
