"""Nothing depends on which of two scans is called the target: each step and its swapped twin, side by side."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.line_adjustment import LineAdjustment, adjust_lines
from algorithms.adjustment.observations.plane_plane import PlanePlane
from algorithms.features.scan_features import ScanFeatures, SurfaceSample
from algorithms.geometry.lines import Lines, bases_of
from algorithms.geometry.planes import Planes
from algorithms.geometry.poses import PoseEstimate
from algorithms.matching.correspondences import corresponding_planes
from algorithms.matching.directions import comes_first
from algorithms.matching.surface_fit import surface_pose_covariance
from algorithms.registration.surface_estimate import estimate_by_surfaces
from algorithms.registration.surface_options import SurfaceOptions
from tests.unit.service.use_cases.steps.test_feature_store import some_features

POSE = RigidTransform.from_components([2.0, -1.0, 0.5], Rotation.from_rotvec([0.3, -0.8, 1.2]))
VOXEL_M, NOISE_M, BUMP_M = 0.15, 0.002, 0.004


def planes_of(normals: np.ndarray, centroids: np.ndarray, boundary: np.ndarray | None = None) -> Planes:
    n = len(normals)
    corners = np.zeros((0, 2)) if boundary is None else np.tile(boundary, (n, 1))
    return Planes(
        normals=normals,
        centroids=centroids,
        bases=bases_of(normals),
        covariances=np.tile(np.diag([1e-4, 1e-4, 1e-6]), (n, 1, 1)),
        noise_std_m=np.full(n, 0.002),
        point_counts=np.full(n, 1000),
        areas_m2=np.ones(n),
        boundary=corners,
        boundary_splits=np.linspace(0, len(corners), n + 1).astype(np.int64),
    )


def rough_planes(seed: int) -> tuple[Planes, Planes]:
    """Give nine walls of a cave seen from two frames: tilted by a degree, other pieces, one moved by 0.3 m."""
    rng = np.random.default_rng(seed)
    normals = np.repeat(np.eye(3), 3, axis=0) + 0.01 * rng.normal(size=(9, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    centroids = rng.uniform(-6.0, 6.0, (9, 3))
    aside = rng.uniform(-3.0, 3.0, (9, 3))
    aside -= np.einsum("ni,ni->n", aside, normals)[:, None] * normals
    tilted = normals + 0.01 * rng.normal(size=(9, 3))
    tilted /= np.linalg.norm(tilted, axis=1, keepdims=True)
    off = 0.002 * rng.normal(size=9)
    off[4] += 0.3
    target = planes_of(POSE.rotation.apply(tilted), POSE.apply(centroids + aside + off[:, None] * normals))
    return target, planes_of(normals, centroids)


def adjusted(target: Planes, source: Planes, start: RigidTransform, *, from_source: bool) -> LineAdjustment:
    pairs = np.repeat(np.arange(9, dtype=np.int64)[:, None], 2, axis=1)
    return adjust_lines(
        Lines.empty(), Lines.empty(), np.empty((0, 2), dtype=np.int64), start,
        planes=PlanePlane(target, source, pairs), from_source=from_source,
    )  # fmt: skip


def wall_of(scan_pose: RigidTransform, seed: int) -> ScanFeatures:
    """See three uneven walls of a room, half a metre of bumps in common, in the frame of an instrument."""
    rng = np.random.default_rng(seed)
    starts = 0.037 * seed, 0.053 * seed
    grid = np.meshgrid(np.arange(starts[0], 5.0 - 0.3 * seed, VOXEL_M), np.arange(starts[1], 4.0, VOXEL_M))
    u, v = (each.ravel() for each in grid)
    points, normals = [], []
    for axis in range(3):
        sheet = np.zeros((len(u), 3))
        sheet[:, [k for k in range(3) if k != axis]] = np.column_stack([u, v])
        sheet[:, axis] = BUMP_M * np.sin(3.0 * u + axis + seed) * np.sin(2.0 * v) + NOISE_M * rng.normal(size=len(u))
        points.append(sheet)
        normals.append(np.tile(np.eye(3)[axis], (len(u), 1)))
    back = scan_pose.inv()
    surface = SurfaceSample(
        back.apply(np.concatenate(points)),
        back.rotation.apply(np.concatenate(normals)),
        np.full(3 * len(u), -1, dtype=np.int32),
        VOXEL_M,
    )
    return replace(some_features(), surface=surface, sensor_m=None, seen=None, noise_std_m=NOISE_M)


def same_covariance(there: PoseEstimate, back: PoseEstimate) -> None:
    np.testing.assert_allclose(
        back.inverse().target_from_source.as_matrix(), there.target_from_source.as_matrix(), atol=1e-9
    )
    scale = np.sqrt(np.diag(there.covariance))
    # in standard deviations: only rounding is left
    np.testing.assert_allclose(
        back.inverse().covariance / np.outer(scale, scale), there.covariance / np.outer(scale, scale), atol=1e-6
    )


def test_of_two_scans_one_comes_first_whatever_they_are_called() -> None:
    larger, smaller = wall_of(RigidTransform.identity(), 0), wall_of(POSE, 1)
    assert comes_first(larger, smaller)
    assert not comes_first(smaller, larger)


def test_of_equally_large_scans_one_comes_first_too() -> None:
    one, other = wall_of(RigidTransform.identity(), 0), wall_of(POSE, 0)
    assert comes_first(one, other) != comes_first(other, one)


def test_surfaces_give_the_inverse_pose_with_the_same_covariance_when_swapped() -> None:
    target, source = wall_of(RigidTransform.identity(), 0), wall_of(POSE, 1)
    there = estimate_by_surfaces(target, source, POSE, SurfaceOptions())
    back = estimate_by_surfaces(source, target, POSE.inv(), SurfaceOptions())
    same_covariance(there.pose, back.pose)
    np.testing.assert_allclose(POSE.inv().apply(there.centre_m), back.centre_m, atol=0.02)
    assert (there.neighbourhoods, there.neighbourhood_m) == (back.neighbourhoods, back.neighbourhood_m)


def test_the_covariance_of_the_surfaces_best_fit_is_the_same_when_swapped() -> None:
    target, source = wall_of(RigidTransform.identity(), 0), wall_of(POSE, 1)
    there = PoseEstimate(POSE, surface_pose_covariance(target, source, POSE))
    back = PoseEstimate(POSE.inv(), surface_pose_covariance(source, target, POSE.inv()))
    same_covariance(there, back)


def test_an_adjustment_from_the_source_is_the_inverse_of_the_swapped_one() -> None:
    for seed in range(5):
        target, source = rough_planes(seed)
        there = adjusted(target, source, POSE, from_source=True)
        back = adjusted(source, target, POSE.inv(), from_source=False)
        same_covariance(there.pose_a_posteriori, back.pose_a_posteriori)
        np.testing.assert_array_equal(there.planes.states, back.planes.states)
        assert there.redundancy == back.redundancy
        np.testing.assert_allclose(there.planes.statistics, back.planes.statistics, rtol=1e-6)


def test_hidden_errors_of_an_adjustment_are_as_large_when_swapped() -> None:
    target, source = rough_planes(0)
    there = adjusted(target, source, POSE, from_source=True)
    back = adjusted(source, target, POSE.inv(), from_source=False)
    sizes = [np.linalg.norm(each.undetected[:, 3:], axis=1) for each in (there, back)]
    np.testing.assert_allclose(sizes[0], sizes[1], rtol=1e-6)
    assert sizes[0].max() > 0.0


def test_an_adjustment_from_the_source_reports_in_the_target() -> None:
    target, source = rough_planes(1)
    there = adjusted(target, source, POSE, from_source=True)
    moved = there.pose.target_from_source.apply(source.centroids)
    assert there.removals[0].target_number == 4
    # the moved source plane passes the target's centroid along the target's normal
    turned = there.pose.target_from_source.rotation.apply(source.normals)
    heights = np.einsum("ni,ni->n", turned, moved - target.centroids) / np.einsum("ni,ni->n", turned, target.normals)
    np.testing.assert_allclose(there.planes.offsets_m, heights, atol=1e-9)


def test_planes_correspond_alike_when_swapped() -> None:
    normals, square = np.array([[0.0, 0.0, 1.0]]), np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    turn = RigidTransform.from_rotation(Rotation.from_euler("z", 45, degrees=True))
    counts = []
    for shift in np.arange(0.0, 2.4, 0.05):
        pose = RigidTransform.from_translation([shift, 0.3, 0.0]) * turn
        target, source = (
            replace(wall_of(POSE, seed), planes=planes_of(normals, np.zeros((1, 3)), size * square))
            for seed, size in enumerate((1.0, 0.8))
        )
        there = corresponding_planes(target, source, pose, max_angle_rad=0.02, max_distance_m=0.05)
        back = corresponding_planes(source, target, pose.inv(), max_angle_rad=0.02, max_distance_m=0.05)
        np.testing.assert_array_equal(there, back[:, ::-1])
        counts.append(len(there))
    assert 0 < sum(counts) < len(counts)
