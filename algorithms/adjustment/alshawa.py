"""Alshawa's registration by linear features: rotation first, then translation (Lichtenstein 2011, eqs. 2.1 to 2.4).

Two conditions for each pair of lines project directions, and then positions, along the Z axis into a plane. Lines
without a difference in Z make them singular, and half of a building's lines are level. Here every pair is projected
along the axis of the target frame in which its target line extends most: the same equations with the axes exchanged,
never singular, and the printed ones where that axis is Z. Of the ends 1 and 2 the one farther from A is called 2, since
2.3 and 2.4 divide by that distance. The rotation is small-angled, so both steps need a start and are repeated until
they settle.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.line_estimate import EstimatorStep, LineEstimate
from algorithms.adjustment.observations.line_line import LineLine
from algorithms.adjustment.residual_covariance import NOTHING_SHARED, SharedErrors, residual_covariance
from algorithms.arrays import Array, IndexPairs, Matrix, Matrix3, Matrix6, Points, Scalars, Vector, Vector3
from algorithms.errors import DegenerateGeometryError, TooFewCorrespondencesError
from algorithms.geometry.lines import Lines
from algorithms.geometry.poses import PoseEstimate
from algorithms.geometry.rotations import cross_matrices

SETTLED_STEP = 1e-12
"""Steps (rad, or metres over the lines' extent) below this are rounding."""
MAX_ROUNDS = 50
SMALLEST_COSINE = 0.05
"""A source line that hardly extends along its divisor axis is no match of its target line; it must stay finite."""
SINGULAR_SHARE = 1e-12

Axes = Int64[Array, "n 3"]
"""(n, 3) axis numbers: the two that carry conditions, and the divisor."""
Projections = Float64[Array, "n 2 3"]


@dataclass(frozen=True, eq=False)
class Segments:
    """Ends of corresponding pieces."""

    a: Points
    """(n, 3) A: first end of the target piece [m]."""
    b: Points
    """(n, 3) B: its other end [m]."""
    one: Points
    """(n, 3) 1: end of the source piece nearer to A [m]."""
    two: Points
    """(n, 3) 2: its other end [m]."""
    axes: Axes


@dataclass(frozen=True, eq=False)
class Step:
    """One linear least-squares problem, solved repeatedly (MATH 3.2)."""

    design: Matrix
    """(2n, 3)."""
    residuals: Vector
    """(2n,) F at the solution [m]."""
    iterations: int
    last_step: float
    converged: bool

    @property
    def sigma0(self) -> float | None:
        """Standard deviation of unit weight [m]; None without redundancy."""
        redundancy = len(self.residuals) - 3
        return float(np.sqrt(self.residuals @ self.residuals / redundancy)) if redundancy > 0 else None

    @property
    def claimed_covariance(self) -> Matrix3:
        """(3, 3) s0² (AᵀA)⁻¹."""
        return np.asarray((self.sigma0 or 0.0) ** 2 * np.linalg.inv(self.design.T @ self.design))


def adjust_alshawa(
    target: Lines,
    source: Lines,
    pairs: IndexPairs,
    start: RigidTransform,
    shared: SharedErrors = NOTHING_SHARED,
) -> LineEstimate:
    """Estimate a pose in Alshawa's two steps, with the covariance that the lines' noise gives it.

    What the estimator says of itself is the usual figure of each of its two Gauss-Markov adjustments alone: the
    translation's does not know that the rotation has an error.

    Parameters
    ----------
    target, source
        Lines of both scans; their extents are the pieces whose ends enter.
    pairs
        (n, 2) numbers of target line and source line.
    start
        Start value, target from source, good to some degrees.
    shared
        What several lines have in common; left out, lines count as independent.

    Raises
    ------
    TooFewCorrespondencesError
        Below two pairs.
    DegenerateGeometryError
        When a normal matrix is singular (exactly parallel lines). With noise it is regular: the rigorous adjustment
        tells that such a pose is worthless.
    """
    if len(pairs) < 2:
        raise TooFewCorrespondencesError(len(pairs), 2)
    ours, theirs = target[pairs[:, 0]], source[pairs[:, 1]]
    segments = _segments(ours, theirs, start)
    turn, rotation = _rotation_step(segments, start.rotation)
    centre = theirs.anchors.mean(axis=0)
    first = start.apply(centre) - rotation.apply(centre)
    shift, translation = _translation_step(segments, rotation, first)
    pose = RigidTransform.from_components(translation, rotation)
    noise = residual_covariance(target, source, pairs, pose, shared)
    gain = _gain(LineLine(ours, theirs, np.stack([np.arange(len(pairs))] * 2, axis=1)), segments, pose)
    return LineEstimate(
        pose=PoseEstimate(pose, gain @ noise @ gain.T),
        claimed=PoseEstimate(pose, _claimed(turn, shift)),
        steps=(_described("rotation", turn), _described("translation", shift)),
        declared=np.zeros(len(pairs), dtype=bool),
        remarks=_remarks(segments),
    )


def _segments(ours: Lines, theirs: Lines, start: RigidTransform) -> Segments:
    """Name the ends and choose the divisor axis of each pair."""
    a, b = ours.end_points
    first, last = theirs.end_points
    moved = start.rotation.apply(theirs.directions)
    along = [np.abs(np.einsum("ij,ij->i", start.apply(end) - a, moved)) for end in (first, last)]
    exchange = (along[0] > along[1])[:, None]
    divisor = np.argmax(np.abs(ours.directions), axis=1)
    axes = np.stack([(divisor + 1) % 3, (divisor + 2) % 3, divisor], axis=1)
    return Segments(a, b, np.where(exchange, last, first), np.where(exchange, first, last), axes)


def _rotation_step(segments: Segments, start: Rotation) -> tuple[Step, Rotation]:
    """Solve 2.1 and 2.2 for small (ω, φ, κ), turn by them, and so on.

    F = D - D_k m / m_k with D = B - A, m the moved source direction and k the divisor axis; dm = w x m.
    """
    wanted = segments.b - segments.a
    rotation, rounds, last, converged = start, 0, np.inf, False
    while True:
        moved = rotation.apply(segments.two - segments.one)
        moved = moved * np.where(np.einsum("ij,ij->i", moved, wanted) < 0.0, -1.0, 1.0)[:, None]
        divisor = _divisors(moved, segments.axes)
        ratio = _at(wanted, segments.axes[:, 2]) / divisor
        residuals = _components(wanted, segments.axes) - ratio[:, None] * _components(moved, segments.axes)
        projected = _projections(moved / divisor[:, None], segments.axes)
        design = (ratio[:, None, None] * projected @ cross_matrices(moved)).reshape(-1, 3)
        if converged or rounds == MAX_ROUNDS:
            return Step(design, residuals.ravel(), rounds, last, converged), rotation
        step = _solved(design, residuals.ravel())
        rotation = Rotation.from_rotvec(step) * rotation
        rounds, converged, last = rounds + 1, *_settled(step, 1.0)


def _translation_step(segments: Segments, rotation: Rotation, start: Vector3) -> tuple[Step, Vector3]:
    """Solve 2.3 and 2.4 for (XT, YT, ZT): F = p1 - p1_k p2 / p2_k with p = R x + T - A; linearised and repeated."""
    one, two = (rotation.apply(end) - segments.a for end in (segments.one, segments.two))
    size = max(float(np.abs(one).max()), float(np.abs(two).max()), 1.0)
    translation, rounds, last, converged = start, 0, np.inf, False
    while True:
        p1, p2 = one + translation, two + translation
        divisor = _divisors(p2, segments.axes)
        ratio = _at(p1, segments.axes[:, 2]) / divisor
        residuals = _components(p1, segments.axes) - ratio[:, None] * _components(p2, segments.axes)
        projected = _projections(p2 / divisor[:, None], segments.axes)
        design = ((1.0 - ratio)[:, None, None] * projected).reshape(-1, 3)
        if converged or rounds == MAX_ROUNDS:
            return Step(design, residuals.ravel(), rounds, last, converged), translation
        step = _solved(design, residuals.ravel())
        translation = translation + step
        rounds, converged, last = rounds + 1, *_settled(step, size)


def _gain(lines: LineLine, segments: Segments, pose: RigidTransform) -> Matrix:
    """Give K of dx = K r, (6, 4n), with the residuals r of `LineLine`.

    For lines that nearly coincide the rotation step's F is -l P E r_tilt (l the target piece's length, P the projection
    along the line into the plane across the divisor axis), the translation step's (1 - ρ) P E r_offset at A, ρ = p1_k /
    p2_k. The rotation's error moves the offsets that the translation step sees.
    """
    target = lines.target
    n = len(lines)
    jacobians = lines.linearised(pose).pose_jacobians
    projected = _projections(target.directions / _at(target.directions, segments.axes[:, 2])[:, None], segments.axes)
    across = projected @ target.bases
    tilts, offsets = np.zeros((n, 2, 4)), np.zeros((n, 2, 4))
    tilts[:, :, :2] = target.lengths[:, None, None] * across
    p1, p2 = (_at(pose.apply(end) - segments.a, segments.axes[:, 2]) for end in (segments.one, segments.two))
    offsets[:, :, 2:] = (1.0 - p1 / p2)[:, None, None] * across
    offsets[:, :, :2] = target.extents[:, :1, None] * offsets[:, :, 2:]  # the tilt carried from the anchor to A
    by_turn = _least_squares(tilts @ jacobians[:, :, :3], tilts)
    by_tilt = (offsets @ jacobians[:, :, :3]).reshape(-1, 3) @ by_turn
    design = offsets @ jacobians[:, :, 3:]
    direct = _least_squares(design, offsets)
    rows = design.reshape(-1, 3)
    through_turn = -np.linalg.solve(rows.T @ rows, rows.T @ by_tilt)
    return np.vstack([by_turn, direct + through_turn])


def _least_squares(design: Array, blocks: Array) -> Matrix:
    """Give -(AᵀA)⁻¹ Aᵀ M, (3, 4n), for A (n, 2, 3) and M block diagonal with blocks (n, 2, 4)."""
    rows = design.reshape(-1, 3)
    right_side = np.einsum("nij,nik->jnk", design, blocks).reshape(3, -1)
    return np.asarray(-np.linalg.solve(rows.T @ rows, right_side))


def _solved(design: Matrix, residuals: Vector) -> Vector3:
    """Give -(AᵀA)⁻¹ Aᵀ F.

    Raises
    ------
    DegenerateGeometryError
        When the normal matrix is singular.
    """
    normal = design.T @ design
    values = np.linalg.eigvalsh(normal)
    missing = int((values <= SINGULAR_SHARE * values[-1]).sum())
    if missing:
        raise DegenerateGeometryError(6 - missing, [], None, "Add a line in another direction.")
    return np.asarray(-np.linalg.solve(normal, design.T @ residuals))


def _settled(step: Vector3, size: float) -> tuple[bool, float]:
    length = float(np.linalg.norm(step))
    return length < SETTLED_STEP * size, length


def _claimed(turn: Step, shift: Step) -> Matrix6:
    covariance = np.zeros((6, 6))
    covariance[:3, :3], covariance[3:, 3:] = turn.claimed_covariance, shift.claimed_covariance
    return covariance


def _described(name: str, step: Step) -> EstimatorStep:
    return EstimatorStep(name, len(step.residuals), 3, step.sigma0, step.iterations, step.last_step, step.converged)


def _remarks(segments: Segments) -> tuple[str, ...]:
    others = int((segments.axes[:, 2] != 2).sum())
    if others == 0:
        return ()
    total = len(segments.axes)
    return (f"{others} of {total} lines extend less along Z than along X or Y: projected along that axis instead",)


def _at(vectors: Points, columns: Array) -> Scalars:
    return np.asarray(vectors[np.arange(len(vectors)), columns])


def _divisors(vectors: Points, axes: Axes) -> Scalars:
    """Give the components to divide by, kept away from zero."""
    values = _at(vectors, axes[:, 2])
    least = SMALLEST_COSINE * np.linalg.norm(vectors, axis=1)
    return np.asarray(np.where(values < 0.0, -1.0, 1.0) * np.maximum(np.abs(values), least))


def _components(vectors: Points, axes: Axes) -> Array:
    """Give the two components that carry conditions, (n, 2)."""
    return np.take_along_axis(vectors, axes[:, :2], axis=1)


def _projections(directions: Points, axes: Axes) -> Projections:
    """Give v -> v_i - v_k d_i for the two axes i, (n, 2, 3); directions scaled so that d_k = 1."""
    every = np.arange(len(axes))
    projections = np.zeros((len(axes), 2, 3))
    for row in (0, 1):
        projections[every, row, axes[:, row]] = 1.0
        projections[every, row, axes[:, 2]] -= directions[every, axes[:, row]]
    return projections
