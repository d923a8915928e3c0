"""Speed and memory of feature extraction on a simulated scan of five million points."""

import dataclasses
import subprocess
import sys
import textwrap
import time

import numpy as np
import pytest

from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.progress import NoProgress
from algorithms.simulation.pipe_hall import pipe_hall_scene
from algorithms.simulation.scanner import scanner_with_step
from algorithms.simulation.scanning import scan_scene

pytestmark = pytest.mark.benchmark

STEP_RAD = float(np.deg2rad(0.1))
"""3600 x 1500 pixels: 5.3 million points in the pipe hall."""


@pytest.fixture(scope="module")
def structured():
    scene = pipe_hall_scene()
    scan = scan_scene(scene, scene.stations[0], scanner_with_step(STEP_RAD), np.random.default_rng(1))
    small = scan_scene(scene, scene.stations[0], scanner_with_step(10 * STEP_RAD), np.random.default_rng(1))
    for warm in (small, dataclasses.replace(small, grid=None)):
        extract_features(warm, FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0))
    return scan


def report(name, scan):
    """Extract features, print points per second of wall and of processor time, and give the latter."""
    wall, processor = time.perf_counter(), time.process_time()
    features = extract_features(scan, FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0))
    wall, processor = time.perf_counter() - wall, time.process_time() - processor
    print(
        f"\n{name}: {len(scan)} points, {len(features.planes)} planes, {len(features.lines)} lines, "
        f"{len(features.cylinders)} cylinders; wall {wall:.2f} s = {len(scan) / wall / 1e6:.2f} M points/s, "
        f"processor {processor:.2f} s = {len(scan) / processor / 1e6:.2f} M points/s"
    )
    return len(scan) / processor


def test_a_structured_scan_takes_less_than_a_second_per_million_points(structured):
    assert report("structured", structured) > 1e6


def test_a_shuffled_cloud_takes_less_than_a_second_per_million_points(structured):
    order = np.random.default_rng(2).permutation(len(structured))
    shuffled = dataclasses.replace(structured, points=structured.points[order], grid=None, intensity=None, color=None)
    assert report("shuffled", shuffled) > 1e6


def test_memory_stays_within_three_times_the_coordinates():
    """Measured in a process of its own, as the increase of the peak over the loaded scan."""
    script = f"""
        import resource
        import numpy as np
        from algorithms.features.extraction import extract_features
        from algorithms.features.options import FeatureOptions
        from algorithms.progress import NoProgress
        from algorithms.simulation.pipe_hall import pipe_hall_scene
        from algorithms.simulation.scanner import scanner_with_step
        from algorithms.simulation.scanning import scan_scene
        scene = pipe_hall_scene()
        def scan(step):
            return scan_scene(scene, scene.stations[0], scanner_with_step(step), np.random.default_rng(1))
        def extract(scan):
            extract_features(scan, FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0))
        def now():
            return int(open("/proc/self/statm").read().split()[1]) * resource.getpagesize()
        extract(scan(10 * {STEP_RAD}))
        big = scan({STEP_RAD})
        open("/proc/self/clear_refs", "w").write("5")  # forget the peak of the simulation
        before = now()
        extract(big)
        peak = [l for l in open("/proc/self/status") if l.startswith("VmHWM")][0]
        print((int(peak.split()[1]) * 1024 - before) / big.points.nbytes)
    """
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(script)], capture_output=True, text=True, check=True)
    ratio = float(done.stdout)
    print(f"\nextra memory at the peak: {ratio:.2f} times the coordinates")
    assert ratio < 3.0
