"""Targets are recognised by their distances, or said not to be."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Generator, Points
from algorithms.geometry.point_sets import PointSet
from algorithms.targets.naming import match_points

STD_M = 0.001


def _seen(points: Points, rng: Generator) -> tuple[PointSet, RigidTransform]:
    pose = RigidTransform.from_components(rng.uniform(-20.0, 20.0, 3), Rotation.random(rng=rng))
    return PointSet.with_std(pose.apply(points) + rng.normal(0.0, STD_M, points.shape), STD_M), pose


@pytest.mark.parametrize("seed", range(12))
def test_five_of_twenty_are_recognised_among_eight_decoys(seed: int) -> None:
    rng = np.random.default_rng(seed)
    known = rng.uniform([0.0, 0.0, 0.0], [30.0, 20.0, 4.0], (20, 3))
    chosen = rng.permutation(20)[:5]
    decoys = rng.uniform([0.0, 0.0, 0.0], [30.0, 20.0, 4.0], (8, 3))
    second, pose = _seen(np.vstack([known[chosen], decoys]), rng)
    match = match_points(PointSet.with_std(known, STD_M), second)
    assert sorted(map(tuple, match.pairs.tolist())) == sorted((int(n), k) for k, n in enumerate(chosen))
    assert match.first_from_second is not None
    np.testing.assert_allclose((match.first_from_second * pose).as_matrix(), np.eye(4), atol=0.01)


def test_a_square_is_not_determined() -> None:
    square = np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0], [5.0, 5.0, 0.0], [0.0, 5.0, 0.0]])
    second, _ = _seen(square, np.random.default_rng(1))
    match = match_points(PointSet.with_std(square, STD_M), second)
    assert len(match.pairs) == 0
    assert "regularly" in match.reason


def test_two_points_or_nothing_in_common_are_not_determined() -> None:
    rng = np.random.default_rng(2)
    known = PointSet.with_std(rng.uniform(0.0, 20.0, (6, 3)), STD_M)
    assert match_points(known, PointSet.with_std(np.eye(3)[:2], STD_M)).first_from_second is None
    strangers, _ = _seen(rng.uniform(0.0, 20.0, (6, 3)), rng)
    assert len(match_points(known, strangers).pairs) == 0


def test_three_points_of_poor_accuracy_are_not_believed() -> None:
    rng = np.random.default_rng(3)
    known = rng.uniform(0.0, 20.0, (30, 3))
    second, _ = _seen(np.vstack([known[:3], rng.uniform(0.0, 20.0, (10, 3))]), rng)
    loose = PointSet.with_std(second.coordinates, 0.05)
    match = match_points(PointSet.with_std(known, 0.05), loose)
    assert len(match.pairs) == 0
