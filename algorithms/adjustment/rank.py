"""What the geometry determines, what it leaves free, and what only weakly (MATH 5.1 to 5.3)."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.pair_problem import PairProblem
from algorithms.adjustment.problem import LinearSystem
from algorithms.arrays import Array, Matrix, Matrix3, Matrix6, Points, Vector3
from algorithms.geometry.rotations import cross_matrix

NOT_ESTIMABLE_RATIO = 10.0
"""Information below this multiple of what noise alone pretends is no information (MATH 5.2)."""

WEAK_RATIO = 1000.0
"""Up to this multiple the standard deviations are right but large: worth a warning (MATH 5.2)."""

WEAK_STD_RATIO = 20.0
"""A principal standard deviation above this multiple of the median one is called weak."""

ROUNDING_SHARE = 1e-13
"""Information below this share of the largest is rounding."""


@dataclass(frozen=True, eq=False)
class RankReport:
    """Which motions the correspondences leave free (MATH 5.1 to 5.3)."""

    rank: int
    """Number of pose parameters that are determined, of 6."""
    null_space: Matrix
    """(6, 6 - rank) free directions (rotation vector [rad], translation [m]) in the frames of the problem."""
    held: Matrix
    """(6, 6 - rank) columns b of the conditions bᵀ(w, dt) = 0 that keep the free motions at their start values: a free
    shift v is held as v.dt = 0 at the origin of the user's source frame (MATH 5.2), a free turn about u as u.w = 0."""
    free_directions: tuple[str, ...]
    """The same in words."""
    advice: str
    """What to add to make the pose determined; empty at full rank."""
    shift_information: float
    """Information on that translation [1/m²]."""
    ghost_information: float
    """Information that noise of directions alone would pretend along it [1/m²]."""

    @property
    def ratio(self) -> float:
        """Real over pretended information: below 10 not estimable, 10 to 1000 weak, usually above 1e5."""
        return self.shift_information / self.ghost_information if self.ghost_information > 0.0 else np.inf


@dataclass(frozen=True)
class WeakDirection:
    """A motion that is determined, but much worse than the others."""

    description: str
    """The motion in words."""
    std_m: float
    """Its standard deviation, rotations as the shift they cause at the features' rms distance [m]."""
    advice: str
    """What would help."""


@dataclass(frozen=True, eq=False)
class CentredFrame:
    """Centred, scaled parameters x' = (Lc w, dp): the shift p of the features' centroid and arc lengths (MATH 5.1)."""

    centroid: Vector3
    """(3,) centroid p of the target features [m]."""
    radius_m: float
    """Lc, rms distance of the features from the centroid [m]."""

    def to_pose(self, pose: RigidTransform) -> Matrix6:
        """Give K with (w, dt) = K x'."""
        conversion = np.zeros((6, 6))
        conversion[:3, :3] = np.eye(3) / self.radius_m
        conversion[3:, :3] = cross_matrix(self.centroid - np.asarray(pose.translation)) / self.radius_m
        conversion[3:, 3:] = np.eye(3)
        return conversion


def centred_frame(points: Points) -> CentredFrame:
    """Find centroid and rms radius of features (MATH 5.1)."""
    centroid = points.mean(axis=0)
    radius = float(np.sqrt(((points - centroid) ** 2).sum(axis=1).mean()))
    return CentredFrame(centroid, radius if radius > 0.0 else 1.0)


@dataclass(frozen=True, eq=False)
class UserOrigins:
    """Where the origins of the problem's reduced frames lie in the frames the user knows."""

    target_m: Vector3
    source_m: Vector3


def analyse_rank(
    problem: PairProblem,
    system: LinearSystem,
    normal_matrix: Matrix6,
    pose: RigidTransform,
    origins: UserOrigins,
    *,
    least_free: tuple[int, int] = (0, 0),
) -> RankReport:
    """Find the motions that the observations leave free, also when noise makes the normal matrix look regular.

    Noisy parallel lines give a regular normal matrix and a meaningless shift along them. So the information on the
    principal shifts and turns is compared with what noise of the observed directions alone would pretend (MATH 5.2).

    Parameters
    ----------
    problem, system
        Correspondences, and their residuals and covariances at the pose.
    normal_matrix
        (6, 6) Jᵀ P J.
    pose
        Pose between the problem's frames.
    origins
        Origins of the problem's frames, for descriptions and for the point at which a free shift is held.
    least_free
        So many shifts and turns, those with least information, are free whatever they are compared with.
    """
    parts = list(zip(problem.observations, system.covariances, strict=True))
    information = sum((part.translation_information(c).sum(axis=0) for part, c in parts), start=np.zeros((3, 3)))
    values, vectors = np.linalg.eigh(information)
    ghosts = [sum(part.ghost_shift_information(c, vectors[:, k]) for part, c in parts) for k in range(3)]
    free = _not_estimable(values, ghosts) | (np.arange(3) < least_free[0])
    shifts = vectors[:, free]
    frame = centred_frame(problem.target_points())
    conversion = frame.to_pose(pose)
    turns = _free_turns(problem, conversion.T @ normal_matrix @ conversion, frame, shifts, least_free[1])
    null_space = np.hstack([np.vstack([np.zeros_like(shifts), shifts]), conversion @ turns])
    words = [f"translation along {_triple(shift)} of the target frame" for shift in shifts.T]
    words += [_turn_in_words(turn, frame, origins.target_m) for turn in turns.T]
    lever = pose.rotation.apply(origins.source_m)  # dt = dt(problem) - w x lever in the user's frames
    held_shifts = np.vstack([-np.cross(lever, shifts, axisb=0, axisc=0), shifts])
    return RankReport(
        rank=6 - null_space.shape[1],
        null_space=null_space,
        held=np.hstack([held_shifts, np.vstack([turns[:3], np.zeros_like(turns[:3])])]),
        free_directions=tuple(words),
        advice=_advice_for(shifts, turns),
        shift_information=float(values[0]),
        ghost_information=float(ghosts[0]),
    )


def weak_directions(
    frame: CentredFrame, pose: RigidTransform, cofactors: Matrix6, report: RankReport
) -> tuple[WeakDirection, ...]:
    """Name the motions whose standard deviation is much larger than the others' (MATH 5.2).

    Parameters
    ----------
    frame, pose
        Of the correspondences, and their pose.
    cofactors
        (6, 6) covariance of the pose.
    report
        Its rank report.
    """
    back = np.linalg.inv(frame.to_pose(pose))
    values, vectors = np.linalg.eigh(back @ cofactors @ back.T)
    std = np.sqrt(np.maximum(values, 0.0))
    determined = std > 1e-9 * std[-1]
    limit = WEAK_STD_RATIO * float(np.median(std[determined]))
    if report.rank == 6 and report.ratio < WEAK_RATIO:
        limit = min(limit, float(std[-1]) * (1.0 - 1e-12))
    found = []
    for k in np.flatnonzero(std > limit)[::-1]:
        turn, shift = vectors[:3, k], vectors[3:, k]
        if np.linalg.norm(shift) >= np.linalg.norm(turn):
            text = f"translation along {_triple(shift)} of the target frame"
            advice = "add a line that crosses this direction"
        else:
            text = f"rotation about {_triple(turn)} through the centroid of the features"
            advice = "add lines farther away from this axis, or with another direction"
        found.append(WeakDirection(text, float(std[k]), advice))
    return tuple(found)


def _not_estimable(values: Array, ghosts: list[float]) -> Array:
    pretended = np.asarray(ghosts, dtype=np.float64)
    return np.asarray((values < NOT_ESTIMABLE_RATIO * pretended) | (values <= ROUNDING_SHARE * values.max()))


def _free_turns(problem: PairProblem, normal_matrix: Matrix6, frame: CentredFrame, shifts: Array, least: int) -> Array:
    """Find free turns in centred parameters, (6, k), each with the shift of the centroid that belongs to it."""
    along = np.linalg.svd(shifts, full_matrices=True)[0][:, shifts.shape[1] :] if shifts.size else np.eye(3)
    by_shift = along.T @ normal_matrix[3:, 3:] @ along
    follow = -along @ np.linalg.solve(by_shift, along.T @ normal_matrix[3:, :3])  # shift that accompanies a turn
    turning = _symmetric(normal_matrix[:3, :3] + normal_matrix[:3, 3:] @ follow)
    values, vectors = np.linalg.eigh(turning)
    ghosts = [
        sum(part.ghost_turn_information(vectors[:, k]) for part in problem.observations) / frame.radius_m**2
        for k in range(3)
    ]
    axes = vectors[:, _not_estimable(values, ghosts) | (np.arange(3) < least)]
    return np.vstack([axes, follow @ axes])


def _symmetric(matrix: Matrix3) -> Matrix3:
    return np.asarray(0.5 * (matrix + matrix.T))


def _turn_in_words(turn: Array, frame: CentredFrame, origin_m: Vector3) -> str:
    axis, shift = turn[:3] / np.linalg.norm(turn[:3]), turn[3:] / np.linalg.norm(turn[:3]) * frame.radius_m
    # dp = axis x (p - q) vanishes on the axis itself: q = p + axis x dp for a shift perpendicular to it.
    point = frame.centroid + np.cross(axis, shift) + origin_m
    return f"rotation about {_triple(axis)} through {_triple(point)} of the target frame"


def _advice_for(shifts: Array, turns: Array) -> str:
    advice = []
    if shifts.shape[1]:
        named = " and ".join(_triple(shift) for shift in shifts.T)
        advice.append(f"add a line not parallel to {named}, or a plane across it")
    if turns.shape[1]:
        advice.append("add a feature away from the axis of rotation")
    return "; ".join(advice)


def _triple(vector: Array) -> str:
    x, y, z = (float(value) + 0.0 for value in np.round(vector, 3))
    return f"({x:.3f}, {y:.3f}, {z:.3f})"
