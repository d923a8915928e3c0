"""Core points a minute of M3C2, beside py4dgeo where it is installed."""

import time

import numpy as np
import pytest

from algorithms.deviations.joint_poses import exact_poses
from algorithms.deviations.m3c2 import m3c2
from algorithms.deviations.options import M3C2Options

pytestmark = pytest.mark.benchmark

POINTS, CORES = 2_000_000, 200_000
SIDE_M = 20.0
OPTIONS = M3C2Options(cylinder_radius_m=0.05, max_distance_m=0.25, normal_radii_m=(0.1,), waviness_std_m=0.0)
"""39 points in a cylinder, 157 in a sphere."""
CORES_OF_PEER = 20_000


def hills(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    u, v = rng.uniform(0.0, SIDE_M, (2, POINTS))
    return np.column_stack([u, v, np.sin(u) * np.cos(0.7 * v) + rng.normal(0.0, 0.003, POINTS)])


def test_a_million_core_points_take_less_than_a_minute() -> None:
    first, second = hills(1), hills(2)
    rng = np.random.default_rng(3)
    m3c2(first[:5000], second[:5000], first[:100], exact_poses(), OPTIONS, rng=rng)  # compiled before
    cores = first[rng.choice(POINTS, CORES, replace=False)]
    started = time.perf_counter()
    found = m3c2(first, second, cores, exact_poses(), OPTIONS, rng=rng)
    seconds = time.perf_counter() - started
    rate = CORES / seconds * 60.0
    print(f"\n{CORES} core points on 2 x {POINTS} points in {seconds:.1f} s: {rate / 1e6:.2f} M core points a minute")
    assert found.measured.mean() > 0.99
    _beside_peer(first, second, cores[:CORES_OF_PEER], found.distances_m[:CORES_OF_PEER], rate)
    assert rate > 1e6


def _beside_peer(first: np.ndarray, second: np.ndarray, cores: np.ndarray, ours: np.ndarray, rate: float) -> None:
    py4dgeo = pytest.importorskip("py4dgeo")
    epochs = py4dgeo.Epoch(first), py4dgeo.Epoch(second)
    started = time.perf_counter()
    peer = py4dgeo.M3C2(epochs=epochs, corepoints=cores, normal_radii=[0.1], cyl_radius=0.05, max_distance=0.25)
    distances, _ = peer.run()
    seconds = time.perf_counter() - started
    theirs = len(cores) / seconds * 60.0
    print(f"py4dgeo: {theirs / 1e6:.2f} M core points a minute (trees included); ratio {rate / theirs:.1f}")
    assert np.nanmax(np.abs(distances - ours)) < 1e-6
