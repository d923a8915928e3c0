"""Stored features come back bit for bit."""

from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from algorithms.features.scan_features import ScanFeatures, SurfaceSample, Symmetries
from algorithms.geometry.cylinders import Cylinders
from algorithms.geometry.lines import Lines, lines_from_arrays
from algorithms.geometry.planes import Planes
from algorithms.scans.instrument_errors import Sweep, TimeSource
from algorithms.scans.surface_index import surface_owners
from service.names.feature_keys import feature_key
from service.use_cases.steps.feature_store import load_features, load_members, save_features


def some_features() -> ScanFeatures:
    rng = np.random.default_rng(1)
    axes = lines_from_arrays(
        rng.normal(size=(2, 3)), rng.normal(size=(2, 3)), np.tile(np.eye(4), (2, 1, 1)), np.ones((2, 2))
    )
    planes = Planes(
        normals=np.eye(3),
        centroids=rng.normal(size=(3, 3)),
        bases=rng.normal(size=(3, 3, 2)),
        covariances=np.tile(np.eye(3), (3, 1, 1)),
        noise_std_m=np.full(3, 0.002),
        point_counts=np.array([4, 5, 6]),
        areas_m2=np.ones(3),
        boundary=rng.normal(size=(9, 2)),
        boundary_splits=np.array([0, 3, 6, 9]),
    )
    cylinders = Cylinders(
        axes=axes,
        radii_m=np.array([0.1, 0.2]),
        radius_std_m=np.array([0.001, 0.001]),
        convex=np.array([True, False]),
        arcs_rad=np.ones(2),
        noise_std_m=np.ones(2),
        point_counts=np.array([10, 20]),
    )
    points, normals = rng.normal(size=(2, 4, 3))
    owners = surface_owners(points, normals, 0.1)
    surface = SurfaceSample(points, normals, np.arange(4, dtype=np.int32), 0.1, owners)
    return ScanFeatures(
        lines=Lines.empty(),
        planes=planes,
        cylinders=cylinders,
        surface=surface,
        seen=None,
        origin_m=np.array([500_000.0, 5_300_000.0, 0.0]),
        sensor_m=None,
        point_count=1234,
        noise_std_m=0.002,
    )


def same(a: Any, b: Any) -> bool:
    if is_dataclass(a):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    if a is None or b is None:
        return a is b
    return bool(np.array_equal(a, b)) and np.asarray(a).dtype == np.asarray(b).dtype


def test_features_come_back_bit_for_bit(tmp_path: Path) -> None:
    features = some_features()
    save_features(tmp_path / "f.npz", features)
    assert same(load_features(tmp_path / "f.npz"), features)


def test_members_come_back_as_of_the_whole(tmp_path: Path) -> None:
    features = some_features()
    save_features(tmp_path / "f.npz", features)
    names = ("planes", "surface.points", "origin_m", "seen", "point_count")
    found = load_members(tmp_path / "f.npz", *names)
    assert same(found[0], features.planes)
    np.testing.assert_array_equal(found[1], features.surface.points)
    np.testing.assert_array_equal(found[2], features.origin_m)
    assert found[3:] == [None, 1234]


@pytest.mark.parametrize("duration_s", [None, 184.5])
def test_when_the_scanner_looked_where_comes_back(tmp_path: Path, duration_s: float | None) -> None:
    sweep = Sweep(0.5, -6.0, (0.0, 0.3, 1.0), (0.0, 0.6, 1.0), TimeSource.TIME_STAMPS.value, duration_s)
    save_features(tmp_path / "f.npz", replace(some_features(), sweep=sweep))
    assert load_features(tmp_path / "f.npz").sweep == sweep


@pytest.mark.parametrize("count", [0, 2])
def test_symmetries_come_back_with_their_limits(tmp_path: Path, count: int) -> None:
    features = replace(some_features(), symmetries=Symmetries(np.tile(np.eye(4), (count, 1, 1)), 0.03, 0.15))
    save_features(tmp_path / "f.npz", features)
    assert same(load_features(tmp_path / "f.npz"), features)


def test_other_options_give_another_key() -> None:
    assert feature_key("ab", 0, {"voxel_size_m": 0.1}) != feature_key("ab", 0, {"voxel_size_m": 0.2})
