"""Many clouds at once from pairs of points (Hofer and Pottmann 2004, equations 15 to 19, sign of 16 corrected)."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Points, Scalars
from algorithms.closest_points.motions import helical_motion
from algorithms.errors import DegenerateGeometryError, InvalidInputError
from algorithms.geometry.rotations import velocity_design

LEAST_SHARE = 1e-10
"""Eigenvalues below this share of the largest belong to motions that nothing fixes."""


@dataclass(frozen=True, eq=False)
class CloudPairs:
    """Corresponding points of two clouds: closest ones of an iteration, or the same detail found in photos."""

    first: int
    """Number of the cloud that `points` are in."""
    second: int
    points: Points
    """(n, 3) in the first cloud's own frame [m]."""
    others: Points
    """(n, 3) in the second's [m]."""
    weights: Scalars
    """(n,) confidence above 0: surfaces have up to 1, the same details of two photos may count for more."""
    normals: Points | None = None
    """(n, 3) unit normals in the second's frame, where only the distance along them counts; None: every direction."""


@dataclass(frozen=True, eq=False)
class SimultaneousPoses:
    """Poses of all clouds."""

    world_from_cloud: tuple[RigidTransform, ...]
    misfits_m: tuple[float, ...]
    """Weighted rms distance of the pairs before each step [m]."""
    steps_m: tuple[float, ...]
    """Largest rms displacement of a cloud's points by each step [m]."""
    converged: bool


def orient_simultaneously(
    pairs: Sequence[CloudPairs],
    starts: Sequence[RigidTransform],
    *,
    fixed: Collection[int],
    max_iterations: int = 50,
    least_step_m: float = 1e-9,
) -> SimultaneousPoses:
    """Move all clouds but the fixed ones until their pairs of points lie on each other.

    Each step solves one linear system of six unknowns a cloud, and moves every cloud by the helical motion of its
    velocity field.

    Parameters
    ----------
    pairs
        Of any two clouds.
    starts
        World from cloud.
    fixed
        Numbers of the clouds that stay, at least one.
    max_iterations, least_step_m
        When to stop.

    Raises
    ------
    InvalidInputError
        When no cloud is fixed.
    DegenerateGeometryError
        When the pairs leave a motion of a cloud free.
    """
    if not fixed:
        raise InvalidInputError("fixed", "no cloud is fixed", "name at least one")
    # about the middle of all points, so that far coordinates lose no digits
    middle = np.concatenate([starts[each.first].apply(each.points) for each in pairs]).mean(axis=0)
    poses = [RigidTransform.from_translation(-middle) * start for start in starts]
    free = [k for k in range(len(starts)) if k not in fixed]
    place = {cloud: number for number, cloud in enumerate(free)}
    misfits: list[float] = []
    lengths: list[float] = []
    while len(misfits) < max_iterations and (not lengths or lengths[-1] >= least_step_m):
        matrix, right, misfit = _normal_equations(pairs, poses, place)
        misfits.append(misfit)
        values, vectors = np.linalg.eigh(matrix)
        if len(values) and values[0] < LEAST_SHARE * values[-1]:
            lost = int(np.count_nonzero(values < LEAST_SHARE * values[-1]))
            raise DegenerateGeometryError(
                len(values) - lost,
                [f"{lost} motions of the clouds"],
                advice="add pairs of points, or fix more clouds",
                parameters=len(values),
            )
        motions = (vectors @ ((vectors.T @ right) / values)).reshape(-1, 6)
        steps = [helical_motion(motion[:3], motion[3:]) for motion in motions]
        lengths.append(_longest(pairs, poses, steps, place))
        for cloud, step in zip(free, steps, strict=True):
            poses[cloud] = step * poses[cloud]
    back = RigidTransform.from_translation(middle)
    poses = [starts[k] if k in fixed else back * pose for k, pose in enumerate(poses)]
    return SimultaneousPoses(tuple(poses), tuple(misfits), tuple(lengths), bool(lengths and lengths[-1] < least_step_m))


def _normal_equations(
    pairs: Sequence[CloudPairs], poses: Sequence[RigidTransform], place: dict[int, int]
) -> tuple[Array, Array, float]:
    """Sum the squared distances after the velocities of both clouds: |x - y + v_j(x) - v_k(y)|^2."""
    matrix, right = np.zeros((6 * len(place), 6 * len(place))), np.zeros(6 * len(place))
    total, weight = 0.0, 0.0
    for each in pairs:
        x, y = poses[each.first].apply(each.points), poses[each.second].apply(each.others)
        weight += float(each.weights.sum())
        for direction in _directions(each, poses[each.second], x.shape):
            gap = np.einsum("ij,ij->i", x - y, direction)
            total += float(each.weights @ gap**2)
            designs = [
                (place[cloud], sign * velocity_design(points, direction))
                for cloud, points, sign in ((each.first, x, 1.0), (each.second, y, -1.0))
                if cloud in place
            ]
            for i, ours in designs:
                right[6 * i : 6 * i + 6] -= ours.T @ (each.weights * gap)
                for j, theirs in designs:
                    matrix[6 * i : 6 * i + 6, 6 * j : 6 * j + 6] += (ours * each.weights[:, None]).T @ theirs
    return matrix, right, float(np.sqrt(total / max(weight, 1e-300)))


def _directions(pairs: CloudPairs, pose: RigidTransform, shape: tuple[int, ...]) -> list[Array]:
    """Give the directions along which the distances of pairs count."""
    if pairs.normals is not None:
        return [np.asarray(pose.rotation.apply(pairs.normals))]
    return [np.broadcast_to(axis, shape) for axis in np.eye(3)]


def _longest(
    pairs: Sequence[CloudPairs], poses: Sequence[RigidTransform], steps: list[RigidTransform], place: dict[int, int]
) -> float:
    longest = 0.0
    for each in pairs:
        for cloud, points in ((each.first, each.points), (each.second, each.others)):
            if cloud in place:
                here = poses[cloud].apply(points)
                moved = steps[place[cloud]].apply(here) - here
                longest = max(longest, float(np.sqrt(np.mean(np.sum(moved**2, axis=1)))))
    return longest
