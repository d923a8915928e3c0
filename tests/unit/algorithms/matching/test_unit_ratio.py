"""Two scans in different units are told by the factor between them."""

from dataclasses import replace

import numpy as np
import pytest

from algorithms.features.scan_features import ScanFeatures, SurfaceSample
from algorithms.geometry.planes import Planes
from algorithms.matching.unit_ratio import unit_ratio_in_words
from tests.unit.algorithms.scans.test_far_points import ROOM
from tests.unit.service.use_cases.steps.test_feature_store import some_features

OFFSETS_M = np.array([0.0, 2.6, 3.1, 5.7, 8.2, 9.9, 13.4, 17.0])


def building(per_metre: float, offsets_m: np.ndarray = OFFSETS_M, count: int = 100_000) -> ScanFeatures:
    """Walls across x at given places, in a unit of which a metre has so many."""
    features = some_features()
    n = len(offsets_m)
    planes = Planes(
        normals=np.tile([1.0, 0.0, 0.0], (n, 1)),
        centroids=per_metre * np.column_stack([offsets_m, np.linspace(0, 4, n), np.linspace(1, 2, n)]),
        bases=np.tile(np.eye(3)[:, 1:], (n, 1, 1)),
        covariances=np.tile(np.eye(3), (n, 1, 1)),
        noise_std_m=np.full(n, 0.002),
        point_counts=np.full(n, 500),
        areas_m2=np.full(n, 9.0 * per_metre**2),
        boundary=np.empty((0, 2)),
        boundary_splits=np.zeros(n + 1, dtype=np.int64),
    )
    points = per_metre * ROOM[:9000]
    surface = SurfaceSample(points, np.zeros_like(points), np.full(9000, -1, dtype=np.int32), 0.1 * per_metre)
    return replace(features, planes=planes, surface=surface, point_count=count)


def words(first: ScanFeatures, second: ScanFeatures) -> str | None:
    return unit_ratio_in_words(first, second, target_name="A", source_name="B")


@pytest.mark.parametrize(("unit", "per_metre"), [("millimetres", 1000.0), ("centimetres", 100.0), ("feet", 3.28084)])
def test_the_scan_in_the_other_unit_is_named_whichever_it_is(unit: str, per_metre: float) -> None:
    there = words(building(per_metre), building(1.0, count=60_000))
    back = words(building(1.0), building(per_metre))
    assert there is not None
    assert back is not None
    assert f"in {unit}" in there
    assert there.index("A") < there.index("B")
    assert back.index("B") < back.index("A")


def test_scans_in_the_same_unit_are_left_in_peace() -> None:
    assert words(building(1.0), building(1.0, count=3_000)) is None
    rng = np.random.default_rng(2)
    others = [np.sort(rng.uniform(0.0, 20.0, 8)) for _ in range(20)]
    assert [words(building(1.0), building(1.0, offsets)) for offsets in others] == [None] * 20
