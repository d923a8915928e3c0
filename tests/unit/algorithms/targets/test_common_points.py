"""Points in common by names and by distances."""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.geometry.point_sets import PointSet
from algorithms.targets.common_points import TargetSet, common_points

MOTION = RigidTransform.from_components([3.0, -2.0, 1.0], Rotation.from_rotvec([0.1, -0.2, 1.3]))
PLACES = np.random.default_rng(4).uniform(-10.0, 10.0, (6, 3))


def target_set(places: np.ndarray, *names: str | None) -> TargetSet:
    return TargetSet(names, PointSet.with_std(places, 0.002))


def test_equal_names_are_the_same_point_in_any_order() -> None:
    first = target_set(PLACES[:4], "a", "b", "c", "d")
    second = target_set(MOTION.inv().apply(PLACES[[3, 1, 0]]), "d", "b", "a")
    found = common_points(first, second)
    assert found.pairs.tolist() == [[0, 2], [1, 1], [3, 0]]
    assert found.by_name == 3


def test_points_without_names_are_recognised_by_their_distances() -> None:
    first = target_set(PLACES, *[None] * 6)
    second = target_set(MOTION.inv().apply(PLACES[[5, 0, 2, 3, 1]]), *[None] * 5)
    assert common_points(first, second).pairs.tolist() == [[0, 1], [1, 4], [2, 2], [3, 3], [5, 0]]


def test_found_points_join_those_that_are_named() -> None:
    first = target_set(PLACES, "a", "b", "c", None, None, None)
    second = target_set(MOTION.inv().apply(PLACES[[0, 1, 2, 4, 5]]), "a", "b", "c", None, None)
    found = common_points(first, second)
    assert found.pairs.tolist() == [[0, 0], [1, 1], [2, 2], [4, 3], [5, 4]]
    assert found.by_name == 3


def test_two_different_names_that_both_know_are_never_one_point() -> None:
    first = target_set(PLACES[:5], "a", "b", None, None, None)
    second = target_set(MOTION.inv().apply(PLACES[[1, 0, 2, 3, 4]]), "a", "b", None, None, None)  # exchanged
    assert common_points(first, second).pairs.tolist() == [[0, 0], [1, 1], [2, 2], [3, 3], [4, 4]]


def test_two_points_without_names_tell_nothing() -> None:
    found = common_points(target_set(PLACES[:2], None, None), target_set(PLACES[:2], None, None))
    assert len(found) == 0
    assert "three in common" in found.reason
