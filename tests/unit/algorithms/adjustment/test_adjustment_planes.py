"""Planes beside lines in the adjustment, and the variance factor of rough walls."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.line_adjustment import AdjustmentOptions, adjust_lines
from algorithms.adjustment.observations.plane_plane import PlanePlane
from algorithms.geometry.line_motion import moved_lines
from algorithms.geometry.lines import Lines, bases_of, lines_from_arrays
from algorithms.geometry.planes import Planes

POSE = RigidTransform.from_components([2.0, -1.0, 0.5], Rotation.from_rotvec([0.3, -0.8, 1.2]))


def same(n: int) -> np.ndarray:
    return np.repeat(np.arange(n, dtype=np.int64)[:, None], 2, axis=1)


def box_planes(normals: np.ndarray, centroids: np.ndarray, std: float) -> Planes:
    n = len(normals)
    return Planes(
        normals=normals,
        centroids=centroids,
        bases=bases_of(normals),
        covariances=np.tile(np.diag([1e-6, 1e-6, std**2]), (n, 1, 1)),
        noise_std_m=np.full(n, 0.002),
        point_counts=np.full(n, 1000),
        areas_m2=np.ones(n),
        boundary=np.zeros((0, 2)),
        boundary_splits=np.zeros(n + 1, dtype=np.int64),
    )


def plane_pair(rng: np.random.Generator, errors_m: np.ndarray) -> PlanePlane:
    """Nine planes in three directions seen from two frames; the target's are shifted along their normals."""
    normals = np.repeat(np.eye(3), 3, axis=0)
    centroids = rng.uniform(-3, 3, size=(9, 3))
    target = box_planes(POSE.rotation.apply(normals), POSE.apply(centroids), 1e-3)
    moved = replace(target, centroids=target.centroids + errors_m[:, None] * target.normals)
    return PlanePlane(moved, box_planes(normals, centroids, 1e-3), same(9))


def test_planes_alone_determine_the_pose() -> None:
    pairs = plane_pair(np.random.default_rng(1), np.zeros(9))
    result = adjust_lines(Lines.empty(), Lines.empty(), same(0), POSE, planes=pairs)
    np.testing.assert_allclose(result.pose.target_from_source.as_matrix(), POSE.as_matrix(), atol=1e-9)
    assert result.rank == 6


def test_no_matching_plane_beside_lines_changes_nothing() -> None:
    rng = np.random.default_rng(2)
    lines = lines_from_arrays(
        rng.uniform(-3, 3, size=(6, 3)),
        rng.normal(size=(6, 3)),
        np.tile(np.eye(4) * 1e-6, (6, 1, 1)),
        np.tile([-1.0, 1.0], (6, 1)),
    )
    none = PlanePlane(
        box_planes(np.eye(3), np.zeros((3, 3)), 1e-3), box_planes(np.eye(3), np.zeros((3, 3)), 1e-3), same(0)
    )
    result = adjust_lines(moved_lines(lines, POSE), lines, same(6), POSE, planes=none)
    assert (result.rank, len(result.planes.states)) == (6, 0)


def test_a_plane_that_was_moved_is_named() -> None:
    errors = np.random.default_rng(3).normal(size=9) * 1e-3
    errors[4] = 0.05
    result = adjust_lines(
        Lines.empty(), Lines.empty(), same(0), POSE, planes=plane_pair(np.random.default_rng(1), errors)
    )
    assert [(removal.kind, removal.target_number) for removal in result.removals] == [("plane", 4)]


def test_rough_walls_enlarge_the_variance_instead_of_being_called_outliers() -> None:
    rng = np.random.default_rng(4)
    errors = rng.normal(size=9) * 8e-3  # eight times what the covariance says
    pairs = plane_pair(np.random.default_rng(1), errors)
    strict = adjust_lines(
        Lines.empty(), Lines.empty(), same(0), POSE, planes=pairs, options=AdjustmentOptions(robust_variance=False)
    )
    robust = adjust_lines(Lines.empty(), Lines.empty(), same(0), POSE, planes=pairs)
    assert len(robust.removals) < len(strict.removals)
    assert robust.test_variance_factor > 1.0
    assert robust.variance_factor > strict.variance_factor
