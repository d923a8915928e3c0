"""Derivatives of every observation type against numerical differentiation, and what a problem stacks from them."""

from collections.abc import Callable
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.observations import Observation, PairObservation
from algorithms.adjustment.observations.feature_tracks import FeatureTracks
from algorithms.adjustment.observations.levelling import Levelling
from algorithms.adjustment.observations.line_line import LineLine
from algorithms.adjustment.observations.plane_plane import PlanePlane
from algorithms.adjustment.observations.point_plane import PointPlane
from algorithms.adjustment.observations.point_point import PointPoint
from algorithms.adjustment.observations.polar import Polar, PolarComponent
from algorithms.adjustment.observations.relative_poses import RelativePoses
from algorithms.adjustment.pair_adjustment import rank_of
from algorithms.adjustment.pair_problem import PairProblem, by_station
from algorithms.adjustment.problem import Problem
from algorithms.adjustment.rank import UserOrigins
from algorithms.adjustment.solver import solve
from algorithms.adjustment.unknowns import UnknownKind, Unknowns
from algorithms.adjustment.weights import whitening_of
from algorithms.errors import InvalidInputError
from algorithms.geometry.line_motion import moved_lines
from algorithms.geometry.lines import Lines, bases_of, lines_from_arrays
from algorithms.geometry.planes import Planes
from algorithms.geometry.point_sets import PointSet

STEP = 1e-6
PAIRS = np.array([[0, 0], [1, 1], [2, 2], [3, 3]], dtype=np.int64)
POSE = RigidTransform.from_components([1.0, -2.0, 0.5], Rotation.from_rotvec([0.4, -1.1, 0.7]))
NOTHING_HELD = np.zeros((6, 0))


def lines_of(rng: np.random.Generator, n: int) -> Lines:
    roots = rng.normal(size=(n, 4, 4)) * 1e-3
    covariances = roots @ np.swapaxes(roots, 1, 2) + 1e-6 * np.eye(4)
    return lines_from_arrays(
        rng.normal(size=(n, 3)) * 3, rng.normal(size=(n, 3)), covariances, np.tile([-1.0, 1.0], (n, 1))
    )


def planes_of(rng: np.random.Generator, n: int) -> Planes:
    normals = rng.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Planes(
        normals=normals,
        centroids=rng.normal(size=(n, 3)) * 3,
        bases=bases_of(normals),
        covariances=np.tile(np.diag([1e-6, 2e-6, 4e-6]), (n, 1, 1)),
        noise_std_m=np.full(n, 0.002),
        point_counts=np.full(n, 100, dtype=np.int64),
        areas_m2=np.ones(n),
        boundary=np.empty((0, 2)),
        boundary_splits=np.zeros(n + 1, dtype=np.int64),
    )


def moved_planes(planes: Planes, pose: RigidTransform) -> Planes:
    rotation = pose.rotation.as_matrix()
    return replace(
        planes,
        normals=planes.normals @ rotation.T,
        centroids=pose.apply(planes.centroids),
        bases=rotation @ planes.bases,
    )


def disturbed_lines(lines: Lines, errors: np.ndarray) -> Lines:
    """Give lines with errors (a1, a2, b1, b2); the bases are turned along."""
    directions = lines.directions + np.einsum("nij,nj->ni", lines.bases, errors[:, :2])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return replace(
        lines,
        directions=directions,
        anchors=lines.anchors + np.einsum("nij,nj->ni", lines.bases, errors[:, 2:]),
        bases=lines.bases - lines.directions[:, :, None] * errors[:, None, :2],
    )


def disturbed_planes(planes: Planes, errors: np.ndarray) -> Planes:
    normals = planes.normals + np.einsum("nij,nj->ni", planes.bases, errors[:, :2])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return replace(
        planes,
        normals=normals,
        centroids=planes.centroids + planes.normals * errors[:, 2:],
        bases=planes.bases - planes.normals[:, :, None] * errors[:, None, :2],
    )


def line_line(rng: np.random.Generator, noise: float) -> LineLine:
    source = lines_of(rng, 4)
    target = disturbed_lines(moved_lines(source, POSE), noise * rng.normal(size=(4, 4)))
    # Anchors elsewhere on the lines: the scans see different pieces. One direction is reversed.
    target = replace(target, anchors=target.anchors + target.directions * rng.normal(size=(4, 1)))
    signs = np.array([[1.0], [-1.0], [1.0], [1.0]])
    bases = source.bases * np.array([[1.0, 1.0], [-1.0, 1.0], [1.0, 1.0], [1.0, 1.0]])[:, None, :]
    return LineLine(target, replace(source, directions=source.directions * signs, bases=bases), PAIRS)


def plane_plane(rng: np.random.Generator, noise: float) -> PlanePlane:
    source = planes_of(rng, 4)
    target = disturbed_planes(moved_planes(source, POSE), noise * rng.normal(size=(4, 3)))
    along = np.einsum("nij,nj->ni", target.bases, rng.normal(size=(4, 2)))
    return PlanePlane(replace(target, centroids=target.centroids + along), source, PAIRS)


def disturbed_points(points: PointSet, errors: np.ndarray) -> PointSet:
    return replace(points, coordinates=points.coordinates + errors)


def disturbed_verticals(verticals: np.ndarray, errors: np.ndarray) -> np.ndarray:
    turned = verticals + np.einsum("nij,nj->ni", bases_of(verticals), errors)
    return np.asarray(turned / np.linalg.norm(turned, axis=1, keepdims=True))


def point_point(rng: np.random.Generator, noise: float) -> PointPoint:
    source = PointSet.with_std(rng.normal(size=(4, 3)) * 3, 0.002)
    target = PointSet.with_std(POSE.apply(source.coordinates), 0.003)
    return PointPoint(disturbed_points(target, noise * rng.normal(size=(4, 3))), source, PAIRS)


def point_plane(rng: np.random.Generator, noise: float) -> PointPlane:
    target = planes_of(rng, 4)
    on_planes = target.centroids + np.einsum("nij,nj->ni", target.bases, rng.normal(size=(4, 2)))
    source = PointSet.with_std(POSE.inv().apply(on_planes), 0.002)
    return PointPlane(disturbed_planes(target, noise * rng.normal(size=(4, 3))), source, PAIRS)


def levelling(rng: np.random.Generator, noise: float) -> Levelling:
    source = planes_of(rng, 4).normals
    target = disturbed_verticals(POSE.rotation.apply(source), noise * rng.normal(size=(4, 2)))
    return Levelling(target, source, np.full(4, 1e-4), np.full(4, 2e-4))


def polar(rng: np.random.Generator, noise: float) -> Polar:
    components = np.array([0, 1, 2, 0, 1, 2], dtype=np.int32)
    stations, points = np.repeat(np.arange(2, dtype=np.int64), 3), np.array([0, 0, 0, 1, 1, 1], dtype=np.int64)
    exact = Polar(stations, points, components, np.zeros(6), np.full(6, 1e-3))
    computed = exact.equations(NETWORK).residuals[:, 0]
    return replace(exact, values=computed + noise * rng.normal(size=6))


def feature_tracks(rng: np.random.Generator, noise: float) -> FeatureTracks:
    differences = plane_plane(rng, noise)
    stations = np.tile(np.array([0, 1], dtype=np.int64), (4, 1))
    return FeatureTracks(stations, differences, (differences.target.covariances, differences.source.covariances))


def relative_poses(rng: np.random.Generator, noise: float) -> RelativePoses:
    observed = RigidTransform.concatenate([changed_pose(noise * rng.normal(size=6)) for _ in range(4)])
    zeros, ones = np.zeros(4, dtype=np.int64), np.ones(4, dtype=np.int64)
    return RelativePoses(zeros, ones, observed, np.tile(np.eye(6), (4, 1, 1)))


BASE = RigidTransform.from_components([2.0, 3.0, -1.0], Rotation.from_rotvec([-0.3, 0.5, 1.9]))
NETWORK = Unknowns(
    RigidTransform.concatenate([BASE, BASE * POSE]),
    np.array([[3.0, -2.0, 1.0], [-4.0, 1.0, 2.0]]),
    np.zeros(2, dtype=bool),
    np.zeros(2, dtype=bool),
)

FACTORIES: dict[type, tuple[Callable, Callable | None, Callable | None]] = {
    LineLine: (line_line, disturbed_lines, disturbed_lines),
    PlanePlane: (plane_plane, disturbed_planes, disturbed_planes),
    PointPoint: (point_point, disturbed_points, disturbed_points),
    PointPlane: (point_plane, disturbed_planes, disturbed_points),
    Levelling: (levelling, disturbed_verticals, disturbed_verticals),
    Polar: (polar, None, None),
    FeatureTracks: (feature_tracks, None, None),
    RelativePoses: (relative_poses, None, None),
}
TYPES = get_args(PairObservation)
ALL_TYPES = (*TYPES, Polar, FeatureTracks, RelativePoses)


def difference_quotient(residuals: Callable[[np.ndarray], np.ndarray], size: int) -> np.ndarray:
    columns = [
        (residuals(STEP * np.eye(size)[k]) - residuals(-STEP * np.eye(size)[k])) / (2 * STEP) for k in range(size)
    ]
    return np.stack(columns, axis=-1)


def changed_pose(delta: np.ndarray) -> RigidTransform:
    return RigidTransform.from_components(
        np.asarray(POSE.translation) + delta[3:], Rotation.from_rotvec(delta[:3]) * POSE.rotation
    )


def test_every_observation_type_has_a_jacobian_test():
    assert {*TYPES, *(set(get_args(Observation)) - set(TYPES))} == set(FACTORIES)


@pytest.mark.parametrize("kind", ALL_TYPES)
def test_derivatives_by_all_unknowns_of_a_network_agree_with_numerical_differentiation(kind):
    observation = FACTORIES[kind][0](np.random.default_rng(12), 0.05)
    numerical = difference_quotient(lambda step: observation.equations(NETWORK.moved(step)).residuals, NETWORK.count)
    analytic = np.zeros_like(numerical)
    for derivative in observation.equations(NETWORK).derivatives:
        first = NETWORK.first_columns(derivative.kind, derivative.numbers)
        for block, column in enumerate(first):
            analytic[block, :, column : column + derivative.jacobians.shape[2]] += derivative.jacobians[block]
    np.testing.assert_allclose(analytic, numerical, atol=1e-8)


def tracks_of_points(rng: np.random.Generator) -> FeatureTracks:
    differences = point_point(rng, 0.05)
    stations = np.tile(np.array([0, 1], dtype=np.int64), (4, 1))
    return FeatureTracks(stations, differences, (differences.target.covariances, differences.source.covariances))


def test_tracks_of_points_answer_to_poses_as_their_derivatives_say():
    tracks = tracks_of_points(np.random.default_rng(21))
    numerical = difference_quotient(lambda step: tracks.equations(NETWORK.moved(step)).residuals, NETWORK.count)
    for derivative in tracks.equations(NETWORK).derivatives:
        column = int(NETWORK.first_columns(derivative.kind, derivative.numbers)[0])
        np.testing.assert_allclose(derivative.jacobians, numerical[:, :, column : column + 6], atol=1e-8)


@pytest.mark.parametrize("side", ["target", "source"])
def test_tracks_of_points_answer_to_errors_in_the_axes_of_their_stations(side: str):
    tracks = tracks_of_points(np.random.default_rng(22))
    differences = tracks.differences

    def residuals(error: np.ndarray) -> np.ndarray:
        moved = disturbed_points(getattr(differences, side), np.tile(error, (4, 1)))
        return replace(tracks, differences=replace(differences, **{side: moved})).equations(NETWORK).residuals

    jacobians = tracks.equations(NETWORK).noise_jacobians[0 if side == "target" else 1]
    np.testing.assert_allclose(jacobians, difference_quotient(residuals, 3), atol=1e-8)


@pytest.mark.parametrize("kind", ALL_TYPES)
def test_a_problem_stacks_the_derivatives_of_free_unknowns_only(kind):
    observation = FACTORIES[kind][0](np.random.default_rng(13), 0.05)
    fixed = replace(NETWORK, pose_is_fixed=np.array([True, False]), point_is_fixed=np.array([False, True]))
    whole = Problem((observation,)).linearised(NETWORK).jacobian.toarray()
    part = Problem((observation,)).linearised(fixed).jacobian.toarray()
    np.testing.assert_array_equal(part, whole[:, [*range(6, 12), *range(12, 15)]])


def test_first_columns_count_free_blocks_only():
    unknowns = replace(NETWORK, pose_is_fixed=np.array([True, False]), point_is_fixed=np.array([True, False]))
    both = np.array([0, 1], dtype=np.int64)
    assert unknowns.first_columns(UnknownKind.POSE, both).tolist() == [-1, 0]
    assert unknowns.first_columns(UnknownKind.POINT, both).tolist() == [-1, 6]
    assert unknowns.count == 9


def test_a_horizontal_angle_across_the_half_turn_has_a_small_residual():
    at = replace(NETWORK, poses=RigidTransform.identity(2), points=np.array([[-5.0, 0.001, 0.0], [1.0, 0.0, 0.0]]))
    one = np.zeros(1, dtype=np.int64)
    observed = Polar(one, one, np.array([PolarComponent.HORIZONTAL], dtype=np.int32), np.array([-np.pi]), np.ones(1))
    np.testing.assert_allclose(observed.equations(at).residuals, -0.0002, atol=1e-8)


@pytest.mark.parametrize("kind", TYPES)
def test_pose_jacobian_agrees_with_numerical_differentiation(kind):
    observation = FACTORIES[kind][0](np.random.default_rng(1), 0.05)
    numerical = difference_quotient(lambda d: observation.linearised(changed_pose(d)).residuals, 6)
    np.testing.assert_allclose(observation.linearised(POSE).pose_jacobians, numerical, atol=1e-8)


@pytest.mark.parametrize("kind", TYPES)
def test_source_jacobian_agrees_with_numerical_differentiation(kind):
    create, _, disturb = FACTORIES[kind]
    observation = create(np.random.default_rng(2), 0.05)

    def residuals(error: np.ndarray) -> np.ndarray:
        errors = np.tile(error, (4, 1))
        return replace(observation, source=disturb(observation.source, errors)).linearised(POSE).residuals

    jacobians = observation.linearised(POSE).source_jacobians
    np.testing.assert_allclose(jacobians, difference_quotient(residuals, jacobians.shape[2]), atol=1e-8)


@pytest.mark.parametrize("kind", TYPES)
def test_target_jacobian_agrees_with_numerical_differentiation_where_features_coincide(kind):
    create, disturb, _ = FACTORIES[kind]
    observation = create(np.random.default_rng(3), 0.0)  # it is meant up to products of errors

    def residuals(error: np.ndarray) -> np.ndarray:
        errors = np.tile(error, (4, 1))
        return replace(observation, target=disturb(observation.target, errors)).linearised(POSE).residuals

    jacobians = observation.linearised(POSE).target_jacobians
    np.testing.assert_allclose(jacobians, difference_quotient(residuals, jacobians.shape[2]), atol=1e-8)


@pytest.mark.parametrize("kind", TYPES)
def test_residuals_vanish_where_features_coincide(kind):
    observation = FACTORIES[kind][0](np.random.default_rng(4), 0.0)
    np.testing.assert_allclose(observation.linearised(POSE).residuals, 0.0, atol=1e-13)


@pytest.mark.parametrize("kind", TYPES)
def test_local_origins_change_no_residual(kind):
    observation = FACTORIES[kind][0](np.random.default_rng(5), 0.05)
    target_origin, source_origin = np.array([3.0, -1.0, 2.0]), np.array([-5.0, 0.5, 1.0])
    reduced_pose = RigidTransform.from_components(POSE.apply(source_origin) - target_origin, POSE.rotation)
    reduced = observation.about(target_origin, source_origin).linearised(reduced_pose)
    np.testing.assert_allclose(reduced.residuals, observation.linearised(POSE).residuals, atol=1e-13)


def test_lines_at_right_angles_stay_finite():
    z, x = np.array([[0.0, 0.0, 1.0]]), np.array([[1.0, 0.0, 0.0]])
    covariance, extent = np.eye(4)[None] * 1e-6, np.array([[-1.0, 1.0]])
    target = lines_from_arrays(np.zeros((1, 3)), z, covariance, extent)
    source = lines_from_arrays(np.ones((1, 3)), x, covariance, extent)
    part = LineLine(target, source, np.zeros((1, 2), dtype=np.int64)).linearised(RigidTransform.identity())
    assert np.isfinite(part.residuals).all()
    assert np.isfinite(part.pose_jacobians).all()


def test_planes_alone_give_the_exact_pose():
    observation = plane_plane(np.random.default_rng(6), 0.0)
    solution = solve(PairProblem((observation,)), Unknowns.of_pair(changed_pose(np.full(6, 0.05))), NOTHING_HELD, 20)
    assert solution.converged
    assert solution.redundancy == 3 * 4 - 6
    np.testing.assert_allclose(solution.pose.as_matrix(), POSE.as_matrix(), atol=1e-10)


def test_planes_and_lines_together_determine_more_than_lines_alone():
    rng = np.random.default_rng(7)
    lines, planes = line_line(rng, 0.0), plane_plane(rng, 0.0)
    alone = solve(PairProblem((lines,)), Unknowns.of_pair(POSE), NOTHING_HELD, 20)
    together = solve(PairProblem((lines, planes)), Unknowns.of_pair(POSE), NOTHING_HELD, 20)
    assert together.redundancy == 4 * 4 + 3 * 4 - 6
    gain = np.linalg.eigvalsh(alone.cofactors - together.cofactors)
    assert gain.min() > -1e-15
    assert gain.max() > 0.0


@pytest.mark.parametrize("held", [[0.6, 0.0, 0.8, 0.0, 0.0, 0.0], [0.3, -0.2, 0.1, 0.0, 1.0, 0.0]])
def test_what_was_held_is_never_called_determined(held):
    problem = PairProblem((line_line(np.random.default_rng(7), 0.0),))
    origins = UserOrigins(np.zeros(3), np.zeros(3))
    free = solve(problem, Unknowns.of_pair(POSE), NOTHING_HELD, 20)
    assert rank_of(problem, free, origins).rank == 6
    report = rank_of(problem, solve(problem, Unknowns.of_pair(POSE), np.array(held)[:, None], 20), origins)
    assert report.rank == 5
    assert report.null_space.shape == (6, 1)
    assert ("rotation" in report.free_directions[0]) == (held[3:] == [0.0, 0.0, 0.0])


def test_a_plane_counted_twice_adds_no_information():
    rng = np.random.default_rng(8)
    planes = plane_plane(rng, 0.0)
    twice = replace(planes, pairs=np.vstack([PAIRS, PAIRS[:1]]))
    target, source = planes.target.covariances, planes.source.covariances
    once = solve(PairProblem((planes,), by_station(target, source)), Unknowns.of_pair(POSE), NOTHING_HELD, 20)
    double = solve(PairProblem((twice,), by_station(target, source)), Unknowns.of_pair(POSE), NOTHING_HELD, 20)
    assert double.redundancy == once.redundancy
    np.testing.assert_allclose(double.cofactors, once.cofactors, rtol=1e-7, atol=1e-18)


def test_selecting_blocks_runs_through_all_types():
    rng = np.random.default_rng(9)
    problem = PairProblem((line_line(rng, 0.0), plane_plane(rng, 0.0)))
    keep = np.array([True, False, True, True, False, True, True, False])
    selected = problem.selected(keep)
    assert [len(part) for part in selected.observations] == [3, 2]
    np.testing.assert_array_equal(selected.observations[1].pairs, PAIRS[[1, 2]])


def test_whitening_makes_residuals_independent_with_unit_variance():
    rng = np.random.default_rng(10)
    system = PairProblem((line_line(rng, 0.01), plane_plane(rng, 0.01))).at(POSE)
    covariance = np.zeros((28, 28))
    for row, blocks in zip((0, 16), system.covariances, strict=True):
        for k, block in enumerate(blocks):
            at = row + k * block.shape[0]
            covariance[at : at + block.shape[0], at : at + block.shape[0]] = block
    whitening = whitening_of(system)
    np.testing.assert_allclose(whitening.apply(whitening.apply(covariance).T), np.eye(28), atol=1e-9)


@pytest.mark.parametrize(
    "wrong", [-np.eye(4), np.zeros((4, 4)), np.full((4, 4), np.nan), np.ones((4, 4)) - 2 * np.eye(4)]
)
def test_impossible_covariances_are_refused(wrong):
    rng = np.random.default_rng(11)
    lines = line_line(rng, 0.0)
    bad = np.tile(wrong, (4, 1, 1))
    broken = LineLine(replace(lines.target, covariances=bad), replace(lines.source, covariances=bad), PAIRS)
    with pytest.raises(InvalidInputError, match="covariance"):
        whitening_of(PairProblem((broken,)).at(POSE))


def photo_lines(rng: np.random.Generator, mount: np.ndarray) -> LineLine:
    """Six lines of which the source scan sees four in two photos."""
    source = lines_of(rng, 6)
    jacobians = rng.normal(size=(6, 4, 6))
    photos = np.array([0, 0, 1, 1, -1, -1], dtype=np.int32)
    jacobians[4:] = 0.0
    through = jacobians @ mount[np.maximum(photos, 0)] @ np.swapaxes(jacobians, 1, 2)
    source = replace(source, covariances=source.covariances + through, photos=photos, photo_jacobians=jacobians)
    pairs = np.repeat(np.arange(6, dtype=np.int64)[:, None], 2, axis=1)
    return LineLine(moved_lines(lines_of(rng, 6), POSE), source, pairs)


def test_lines_of_one_photo_share_the_error_of_its_mount_and_lines_of_another_do_not():
    roots = np.random.default_rng(20).normal(size=(2, 6, 6)) * 1e-3
    mount = roots @ np.swapaxes(roots, 1, 2)
    lines = photo_lines(np.random.default_rng(21), mount)
    together = PairProblem((lines,), {}, {1: mount}).at(POSE)
    alone = PairProblem((lines,)).at(POSE)
    joint, source = together.joint_covariance, lines.linearised(POSE).source_jacobians
    assert joint is not None
    assert alone.joint_covariance is None
    by_mount = source @ lines.source.photo_jacobians
    np.testing.assert_allclose(joint[:4, 4:8], by_mount[0] @ mount[0] @ by_mount[1].T, atol=1e-16)
    np.testing.assert_allclose(joint[8:12, 12:16], by_mount[2] @ mount[1] @ by_mount[3].T, atol=1e-16)
    np.testing.assert_allclose(joint[:8, 8:], 0.0, atol=1e-18)
    # what a line has by itself is the same either way
    np.testing.assert_allclose(together.covariances[0], alone.covariances[0], rtol=1e-9, atol=1e-15)
