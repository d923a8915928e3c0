"""Laws the line adjustment must obey: exactness, equivariance, symmetry, far origins, honest covariances."""

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.line_adjustment import AdjustmentOptions, LineAdjustment, adjust_lines
from algorithms.adjustment.snooping import CorrespondenceState
from algorithms.geometry.covariances import intersection_jacobians, intersection_lines
from algorithms.geometry.line_motion import moved_lines
from algorithms.geometry.lines import Lines, LineSource, bases_of, lines_from_arrays
from algorithms.geometry.poses import PoseEstimate

TILT_STD, OFFSET_STD = 1e-3, 2e-3
KEEP_ALL = AdjustmentOptions(max_removed_share=0.0)


def random_pose(rng: np.random.Generator) -> RigidTransform:
    return RigidTransform.from_components(rng.normal(size=3) * 5, Rotation.random(rng=rng))


def pose_error(pose: RigidTransform, truth: RigidTransform) -> np.ndarray:
    """Left rotation vector and shift that lead from the pose to the truth."""
    turn = (truth.rotation * pose.rotation.inv()).as_rotvec()
    return np.concatenate([turn, np.asarray(truth.translation) - np.asarray(pose.translation)])


def free_lines(rng: np.random.Generator, n: int) -> Lines:
    variances = np.array([TILT_STD, TILT_STD, OFFSET_STD, OFFSET_STD]) ** 2 * rng.uniform(0.5, 2.0, size=(n, 4))
    covariances = variances[:, :, None] * np.eye(4)
    return lines_from_arrays(
        rng.uniform(-4, 4, size=(n, 3)), rng.normal(size=(n, 3)), covariances, np.tile([-1.0, 1.0], (n, 1))
    )


def noisy(lines: Lines, rng: np.random.Generator) -> Lines:
    errors = np.einsum("nij,nj->ni", np.linalg.cholesky(lines.covariances), rng.normal(size=(len(lines), 4)))
    directions = lines.directions + np.einsum("nij,nj->ni", lines.bases, errors[:, :2])
    return lines_from_arrays(
        lines.anchors + np.einsum("nij,nj->ni", lines.bases, errors[:, 2:]),
        directions,
        lines.covariances,
        lines.extents,
        bases=lines.bases - directions[:, :, None] * errors[:, None, :2],
    )


def one_to_one(n: int) -> np.ndarray:
    return np.repeat(np.arange(n, dtype=np.int64)[:, None], 2, axis=1)


def observed_pair(rng: np.random.Generator, n: int) -> tuple[Lines, Lines, RigidTransform]:
    """Simulate the same free lines in target and source."""
    lines, pose = free_lines(rng, n), random_pose(rng)
    return noisy(moved_lines(lines, pose), rng), noisy(lines, rng), pose


class Room:
    """Six planes, twelve edges, and some free lines (pipes), all in a random attitude."""

    def __init__(self, rng: np.random.Generator, pipes: int, tilt_std: float, offset_std: float) -> None:
        axes = np.vstack([np.eye(3), -np.eye(3)])
        centroids = -axes * np.array([3.0, 2.0, 1.5]) + rng.uniform(-0.5, 0.5, size=(6, 3)) * (1 - np.abs(axes))
        turn = Rotation.random(rng=rng)
        i, j = np.triu_indices(6, 1)
        meet = np.abs(np.einsum("ij,ij->i", axes[i], axes[j])) < 0.1
        self.normals, self.centroids = turn.apply(axes), turn.apply(centroids)
        self.pairs = np.stack([i[meet], j[meet]], axis=1).astype(np.int64)
        self.along = rng.uniform(-0.5, 0.5, size=len(self.pairs))
        self.pipes = free_lines(rng, pipes)
        self.tilt_std, self.offset_std = tilt_std, offset_std

    def seen(self, rng: np.random.Generator, pose: RigidTransform) -> tuple[Lines, np.ndarray]:
        """Give the lines with noise from noisy planes, and the plane covariances."""
        normals, centroids = pose.rotation.apply(self.normals), pose.apply(self.centroids)
        std = np.array([self.tilt_std, self.tilt_std, self.offset_std]) * rng.uniform(0.5, 2.0, size=(6, 3))
        covariances = std[:, :, None] ** 2 * np.eye(3)
        bases, errors = bases_of(normals), rng.normal(size=(6, 3)) * std
        centroids = centroids + normals * errors[:, 2:]
        normals = normals + np.einsum("nij,nj->ni", bases, errors[:, :2])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        bases = bases - normals[:, :, None] * np.einsum("ni,nij->nj", normals, bases)[:, None, :]
        i, j = self.pairs.T
        points, directions = intersection_lines(normals[i], centroids[i], normals[j], centroids[j])
        anchors = points + self.along[:, None] * directions
        line_bases, jacobians = intersection_jacobians(
            anchors, directions, normals[i], centroids[i], bases[i], normals[j], centroids[j], bases[j]
        )
        planes = np.zeros((len(i), 6, 6))
        planes[:, :3, :3], planes[:, 3:, 3:] = covariances[i], covariances[j]
        edges = lines_from_arrays(
            anchors,
            directions,
            jacobians @ planes @ np.swapaxes(jacobians, 1, 2),
            np.tile([-1.0, 1.0], (len(i), 1)),
            bases=line_bases,
            parents=self.pairs,
            parent_jacobians=jacobians,
        )
        pipes = noisy(moved_lines(self.pipes, pose), rng)
        pipes = replace(pipes, sources=np.full(len(pipes), LineSource.CYLINDER_AXIS, dtype=np.int32))
        columns = [(getattr(edges, f.name), getattr(pipes, f.name)) for f in fields(Lines)]
        return Lines(*(None if column[0] is None else np.concatenate(column) for column in columns)), covariances


def adjusted_room(rng: np.random.Generator, room: Room, *, shared: bool) -> tuple[LineAdjustment, RigidTransform]:
    pose = random_pose(rng)
    source, source_planes = room.seen(rng, RigidTransform.identity())
    target, target_planes = room.seen(rng, pose)
    result = adjust_lines(
        target,
        source,
        one_to_one(len(source)),
        pose,
        target_plane_covariances=target_planes if shared else None,
        source_plane_covariances=source_planes if shared else None,
        options=KEEP_ALL,
    )
    return result, pose


def normalised_error(estimate: PoseEstimate, truth: RigidTransform) -> float:
    error = pose_error(estimate.target_from_source, truth)
    return float(error @ np.linalg.solve(estimate.covariance, error))


def in_chi_square_band(mean: float, degrees: int, runs: int) -> bool:
    low, high = stats.chi2.ppf([5e-4, 1 - 5e-4], degrees * runs) / runs
    return bool(low < mean < high)


@pytest.mark.parametrize("n", [2, 3, 12])
def test_error_free_lines_give_the_exact_pose_from_a_rough_start(n):
    rng = np.random.default_rng(n)
    lines, pose = free_lines(rng, n), random_pose(rng)
    start = RigidTransform.from_components(
        np.asarray(pose.translation) + 0.5, Rotation.from_rotvec([0.1, -0.15, 0.1]) * pose.rotation
    )
    result = adjust_lines(moved_lines(lines, pose), lines, one_to_one(n), start, options=KEEP_ALL)
    assert result.converged
    assert np.abs(pose_error(result.pose.target_from_source, pose)).max() < 1e-10  # rounding times lever arms
    assert result.omega < 1e-12


def test_moving_the_source_moves_the_answer():
    rng = np.random.default_rng(1)
    target, source, pose = observed_pair(rng, 9)
    motion = random_pose(rng)
    one = adjust_lines(target, source, one_to_one(9), pose).pose
    two = adjust_lines(target, moved_lines(source, motion), one_to_one(9), pose * motion.inv()).pose
    assert np.abs(pose_error(two.target_from_source * motion, one.target_from_source)).max() < 1e-10


def test_moving_the_target_moves_the_answer_and_its_covariance():
    rng = np.random.default_rng(2)
    target, source, pose = observed_pair(rng, 9)
    motion = random_pose(rng)
    one = adjust_lines(target, source, one_to_one(9), pose).pose
    two = adjust_lines(moved_lines(target, motion), source, one_to_one(9), motion * pose).pose
    expected = PoseEstimate(motion, np.zeros((6, 6))).after(one)
    assert np.abs(pose_error(two.target_from_source, expected.target_from_source)).max() < 1e-10
    np.testing.assert_allclose(two.covariance, expected.covariance, rtol=1e-6, atol=1e-14)


@pytest.mark.parametrize("seed", range(2))
def test_swapping_source_and_target_inverts_the_pose(seed):
    target, source, pose = observed_pair(np.random.default_rng(seed), 9)
    forward = adjust_lines(target, source, one_to_one(9), pose, options=KEEP_ALL).pose
    backward = adjust_lines(source, target, one_to_one(9), pose.inv(), options=KEEP_ALL).pose.inverse()
    # Residuals are formed in the target's planes: the two answers differ by products of errors only.
    difference = np.abs(pose_error(backward.target_from_source, forward.target_from_source))
    assert (difference < 0.05 * np.sqrt(np.diag(forward.covariance))).all()
    std = np.sqrt(np.diag(forward.covariance))
    np.testing.assert_allclose(
        backward.covariance / np.outer(std, std), forward.covariance / np.outer(std, std), atol=0.05
    )


def test_a_far_origin_gives_the_answer_of_a_near_one():
    target, source, pose = observed_pair(np.random.default_rng(4), 9)
    shift = np.array([4e5, 3e5, 200.0])
    near = adjust_lines(target, source, one_to_one(9), pose)
    far_start = RigidTransform.from_components(np.asarray(pose.translation) + shift, pose.rotation)
    far = adjust_lines(replace(target, anchors=target.anchors + shift), source, one_to_one(9), far_start)
    assert (far.pose.rotation * near.pose.rotation.inv()).magnitude() < 1e-11
    # 500 km in float64 are resolved to 6e-11 m.
    np.testing.assert_allclose(far.pose.translation_m - shift, near.pose.translation_m, atol=1e-9)
    np.testing.assert_allclose(far.pose.translation_std_m, near.pose.translation_std_m, rtol=1e-6)


def test_reversed_line_directions_change_nothing():
    rng = np.random.default_rng(5)
    target, source, pose = observed_pair(rng, 9)
    flip = rng.random(9) < 0.5
    sign = np.where(flip, -1.0, 1.0)
    # Reversing d keeps (E1, E2, d) right-handed by reversing E1 as well; errors and covariance follow.
    change = np.stack([np.ones(9), sign, sign, np.ones(9)], axis=1)
    flipped = replace(
        source,
        directions=source.directions * sign[:, None],
        bases=source.bases * np.stack([sign, np.ones(9)], axis=1)[:, None, :],
        covariances=source.covariances * change[:, :, None] * change[:, None, :],
    )
    one = adjust_lines(target, source, one_to_one(9), pose)
    two = adjust_lines(target, flipped, one_to_one(9), pose)
    assert np.abs(pose_error(two.pose.target_from_source, one.pose.target_from_source)).max() < 1e-11
    np.testing.assert_allclose(two.pose.covariance, one.pose.covariance, rtol=1e-8, atol=1e-18)


@pytest.mark.slow
def test_covariance_of_independent_lines_is_honest():
    rng, runs = np.random.default_rng(6), 50
    errors, omegas = [], []
    for _ in range(runs):
        target, source, pose = observed_pair(rng, 6)
        result = adjust_lines(target, source, one_to_one(6), pose, options=KEEP_ALL)
        errors.append(normalised_error(result.pose, pose))
        omegas.append(result.omega)
    assert in_chi_square_band(float(np.mean(errors)), 6, runs)
    assert in_chi_square_band(float(np.mean(omegas)), 4 * 6 - 6, runs)


@pytest.mark.slow
@pytest.mark.parametrize("tilt_std", [5e-4, 5e-3])
def test_covariance_of_lines_with_shared_planes_is_honest(tilt_std):
    rng, runs = np.random.default_rng(7), 25
    errors, omegas = [], []
    for _ in range(runs):
        result, pose = adjusted_room(rng, Room(rng, 3, tilt_std, OFFSET_STD), shared=True)
        errors.append(normalised_error(result.pose, pose))
        omegas.append(result.omega)
        # 6 planes give 18 conditions, 3 pipes 12 more; 12 edges alone would claim 48.
        assert result.independent_condition_count == 30
        assert result.redundancy == 24
    assert in_chi_square_band(float(np.mean(errors)), 6, runs)
    assert in_chi_square_band(float(np.mean(omegas)), 24, runs)


@pytest.mark.slow
def test_lines_with_shared_planes_taken_as_independent_promise_too_much():
    rng, runs = np.random.default_rng(8), 20
    errors = []
    for _ in range(runs):
        result, pose = adjusted_room(rng, Room(rng, 3, TILT_STD, OFFSET_STD), shared=False)
        errors.append(normalised_error(result.pose, pose))
    assert np.mean(errors) > 1.5 * 6


@pytest.mark.parametrize("shared", [True, False])
def test_a_wrong_correspondence_is_named_and_removed(shared):
    rng = np.random.default_rng(9)
    room, pose = Room(rng, 3, TILT_STD, OFFSET_STD), random_pose(rng)
    source, source_planes = room.seen(rng, RigidTransform.identity())
    target, target_planes = room.seen(rng, pose)
    anchors = target.anchors.copy()
    anchors[13] += 0.1 * target.bases[13, :, 0]
    moved = replace(target, anchors=anchors)
    planes = {"target_plane_covariances": target_planes, "source_plane_covariances": source_planes}
    result = adjust_lines(moved, source, one_to_one(len(source)), pose, **(planes if shared else {}))
    assert [removal.correspondence for removal in result.removals] == [13]
    assert (result.removals[0].kind, result.removals[0].target_number, result.removals[0].source_number) == (
        "line",
        13,
        13,
    )
    assert result.lines.states[13] == CorrespondenceState.REMOVED
    assert np.linalg.norm(result.lines.offsets_m[13]) == pytest.approx(0.1, abs=0.02)
    assert normalised_error(result.pose, pose) < stats.chi2.isf(1e-4, 6)


@pytest.mark.parametrize("seed", range(2))
def test_a_shaft_of_four_walls_leaves_the_shift_along_it_free(seed):
    rng = np.random.default_rng(seed)
    room = Room(rng, 0, TILT_STD, OFFSET_STD)
    walls = ~np.isin(room.pairs, [2, 5]).any(axis=1)  # without floor and ceiling
    room.pairs, room.along = room.pairs[walls], room.along[walls]
    result, pose = adjusted_room(rng, room, shared=True)
    axis = np.cross(pose.rotation.apply(room.normals[0]), pose.rotation.apply(room.normals[1]))
    assert result.rank == 5
    assert abs(result.pose.null_space[3:, 0] @ axis) == pytest.approx(1.0, abs=1e-4)
    assert result.redundancy == 4 * 3 - 5
