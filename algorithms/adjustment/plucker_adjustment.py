"""The fine registration of M. Lichtenstein's dissertation (RWTH Aachen 2011), eqs. 4.51 to 4.72, misprints corrected.

Every pair of lines gives six equations, its Plücker coordinates, with unit weights; unknown are ω, φ, κ, tx, ty, tz;
the redundancy is counted as 6n - 6. A line has only four freedoms, unit vectors and metres stand side by side, and the
answer depends on where the target's origin lies: this model is here to be compared with, not to be believed. Its pose
comes with the covariance that the lines' noise really gives it; what it says of itself stands beside (MATH 3.2, 10).

Corrected (MATH 9): the second row of the moved direction uses r23 (4.67), the sign of v follows 4.65 (l = L2 - f(x),
v = A dx - l), S(t)R has cos ω sin κ in its second row (4.62), and ω, φ, κ follow by atan2 (instead of 4.38 to 4.43).
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.line_estimate import EstimatorStep, LineEstimate
from algorithms.adjustment.residual_covariance import NOTHING_SHARED, SharedErrors, residual_covariance
from algorithms.arrays import Array, IndexPairs, Matrix, Matrix6, Vector
from algorithms.errors import DegenerateGeometryError, TooFewCorrespondencesError
from algorithms.geometry.angles import angles_from_rotation, rotation_from_angles, rotation_vector_rates
from algorithms.geometry.line_motion import matched_signs, moved_lines
from algorithms.geometry.lines import Lines
from algorithms.geometry.plucker import plucker_coordinates, plucker_jacobians
from algorithms.geometry.poses import PoseEstimate
from algorithms.geometry.rotations import cross_matrices, cross_matrix

STEP_LIMIT = 1e-14
"""The dissertation stops where |Δx| (radians and metres together) falls below this."""
ROUNDING_STEP = 1e-9
"""A step below this that is no smaller than the one before is rounding: `STEP_LIMIT` is not reachable there."""
MAX_ROUNDS = 50
NV_LIMIT = 1.96
"""Normal quantile at 97.5 % above which the dissertation declares an outlier. Five of a hundred good components exceed
it: it is no limit for snooping (MATH 4.2)."""
SINGULAR_SHARE = 1e-12
"""Share of the largest eigenvalue of the scaled normal matrix below which it counts as singular."""
STEEP_COSINE = 0.1
"""Below this |cos φ| the target axes are turned before the angles are counted: at φ = ±100 gon ω and κ are one."""
TURNED_AXES = RigidTransform.from_rotation(Rotation.from_euler("y", 0.25 * np.pi))

PluckerRows = Float64[Array, "n 6"]
"""n lines (d, L0) in Plücker coordinates."""
Parameters = Float64[Array, "6"]
"""ω, φ, κ [rad] and tx, ty, tz [m], or something of each."""


@dataclass(frozen=True, eq=False)
class PluckerSolution:
    """The adjustment as the dissertation prints it, from n pairs of lines (4.51 to 4.72; MATH 3.2)."""

    target_from_source: RigidTransform
    unknowns: Parameters
    design: Matrix
    """(6n, 6) A, derivatives by (ω, φ, κ, tx, ty, tz)."""
    pose_design: Matrix
    """(6n, 6) the same by (rotation vector on the left, t)."""
    residuals: PluckerRows
    """v = -l at the end, six for each pair: three without unit, three in metres."""
    cofactors: Matrix6
    """(AᵀA)⁻¹ of (ω, φ, κ, tx, ty, tz)."""
    sigma0: float | None
    """√(vᵀv / (6n - 6)); None for n = 1."""
    iterations: int
    last_step: float
    """|Δx| of the last round."""
    converged: bool

    @property
    def parameter_std(self) -> Parameters:
        """(6,) its standard deviations of ω, φ, κ [rad] and t [m], s0 √q."""
        return np.asarray((self.sigma0 or 0.0) * np.sqrt(np.diag(self.cofactors)))

    @property
    def claimed_covariance(self) -> Matrix6:
        """(6, 6) s0² (AᵀA)⁻¹ of (rotation vector on the left, t)."""
        to_vector = _rates(self.unknowns)
        return np.asarray((self.sigma0 or 0.0) ** 2 * to_vector @ self.cofactors @ to_vector.T)

    @property
    def normalised(self) -> PluckerRows:
        """(n, 6) NV = |v| / s_v with s_v = s0 √q_vv (3.11); 0 where nothing controls a component."""
        q = 1.0 - np.einsum("ij,jk,ik->i", self.design, self.cofactors, self.design)
        scale = (self.sigma0 or 0.0) * np.sqrt(np.maximum(q, 0.0)).reshape(-1, 6)
        controlled = (q.reshape(-1, 6) > 1e-9) & (scale > 0.0)
        return np.where(controlled, np.abs(self.residuals) / np.where(controlled, scale, 1.0), 0.0)


def plucker_solution(target: PluckerRows, source: PluckerRows, start: RigidTransform) -> PluckerSolution:
    """Adjust as printed: x_i = x_(i-1) + (AᵀA)⁻¹ Aᵀ l until |Δx| < 1e-14 (4.51, 4.52, 4.58 to 4.70).

    Signs of directions are taken as they are: one reversed line ruins the answer (MATH 10).

    Parameters
    ----------
    target, source
        n pairs of lines, pair k to pair k, with unit directions.
    start
        Start value, target from source.

    Raises
    ------
    DegenerateGeometryError
        When the normal matrix is singular. Noise makes it regular for parallel lines: their pose is worthless all the
        same, and the rigorous adjustment says so.
    """
    angles = angles_from_rotation(start.rotation)
    unknowns = np.concatenate([angles, np.asarray(start.translation)])
    last = np.inf
    rounds, converged = 0, False
    while not converged and rounds < MAX_ROUNDS:
        rounds += 1
        design, left = _linearised(target, source, unknowns)[:2]
        normal = design.T @ design
        _require_regular(normal)
        step = np.linalg.solve(normal, design.T @ left)
        unknowns = unknowns + step
        size = float(np.linalg.norm(step))
        converged = size < STEP_LIMIT or (size < ROUNDING_STEP and size >= last)
        last = size
    design, left, pose_design = _linearised(target, source, unknowns)
    redundancy = 6 * len(target) - 6
    return PluckerSolution(
        target_from_source=_pose(unknowns),
        unknowns=unknowns,
        design=design,
        pose_design=pose_design,
        residuals=-left.reshape(-1, 6),
        cofactors=np.linalg.inv(design.T @ design),
        sigma0=float(np.sqrt(left @ left / redundancy)) if redundancy > 0 else None,
        iterations=rounds,
        last_step=last,
        converged=converged,
    )


def adjust_plucker(
    target: Lines,
    source: Lines,
    pairs: IndexPairs,
    start: RigidTransform,
    shared: SharedErrors = NOTHING_SHARED,
) -> LineEstimate:
    """Estimate a pose by the dissertation's model from lines with matched signs, with its true covariance (MATH 3.2).

    The answer depends on the target's origin: give the lines relative to a local one. Near φ = ±100 gon the target
    axes are turned by 50 gon about y before; with unit weights that changes nothing but the unknowns.

    Parameters
    ----------
    target, source
        Lines of both scans.
    pairs
        (n, 2) numbers of target line and source line.
    start
        Start value, target from source.
    shared
        What several lines have in common; left out, lines count as independent.

    Raises
    ------
    TooFewCorrespondencesError
        Below two pairs.
    DegenerateGeometryError
        When the normal matrix is singular.
    """
    if len(pairs) < 2:
        raise TooFewCorrespondencesError(len(pairs), 2)
    if abs(np.cos(angles_from_rotation(start.rotation)[1])) < STEEP_COSINE:
        turned = adjust_plucker(moved_lines(target, TURNED_AXES), source, pairs, TURNED_AXES * start, shared)
        back = PoseEstimate(TURNED_AXES.inv(), np.zeros((6, 6)))
        return replace(turned, pose=back.after(turned.pose), claimed=back.after(turned.claimed))
    ours, theirs = target[pairs[:, 0]], source[pairs[:, 1]]
    signs = matched_signs(ours, theirs, start.rotation)
    solution = plucker_solution(plucker_coordinates(ours), signs[:, None] * plucker_coordinates(theirs), start)
    pose = solution.target_from_source
    noise = residual_covariance(target, source, pairs, pose, shared)
    gain = _gain(solution, plucker_jacobians(ours))
    return LineEstimate(
        pose=PoseEstimate(pose, gain @ noise @ gain.T),
        claimed=PoseEstimate(pose, solution.claimed_covariance),
        steps=(
            EstimatorStep(
                name="rotation and translation",
                equations=6 * len(pairs),
                unknowns=6,
                sigma0=solution.sigma0,
                iterations=solution.iterations,
                last_step=solution.last_step,
                converged=solution.converged,
            ),
        ),
        declared=np.asarray((solution.normalised > NV_LIMIT).any(axis=1)),
        remarks=_remarks(solution),
    )


def _gain(solution: PluckerSolution, jacobians: Array) -> Matrix:
    """Give K of dx = K r, (6, 4n), r the residuals of `LineLine`.

    For lines that nearly coincide L2 - H L1 = -J r with the target's J of MATH 2.1, and dx = (BᵀB)⁻¹ Bᵀ (L2 - H L1).
    """
    design = solution.pose_design
    by_line = design.reshape(-1, 6, 6)
    right_side = np.einsum("nij,nik->jnk", by_line, jacobians).reshape(6, -1)
    return np.asarray(-np.linalg.solve(design.T @ design, right_side))


def _remarks(solution: PluckerSolution) -> tuple[str, ...]:
    if solution.last_step < STEP_LIMIT:
        return ()
    if solution.converged:
        reached = f"steps stopped shrinking at {solution.last_step:.1e}"
        return (f"{reached}: rounding does not allow the {STEP_LIMIT:.0e} that the dissertation asks for",)
    return (f"not settled after {solution.iterations} rounds (last step {solution.last_step:.1e})",)


def _pose(unknowns: Parameters) -> RigidTransform:
    return RigidTransform.from_components(unknowns[3:], rotation_from_angles(*unknowns[:3]))


def _linearised(target: PluckerRows, source: PluckerRows, unknowns: Parameters) -> tuple[Matrix, Vector, Matrix]:
    """Give A by (ω, φ, κ, t), l = L2 - H L1 (4.58, 4.65), and the design by (rotation vector, t).

    Of f = (R d, t x R d + R L0): δf = (w x R d, t x (w x R d) + w x R L0 + δt x R d), and w = W (dω, dφ, dκ). In
    angles these are the 36 derivatives of the dissertation's appendix.
    """
    rotation = rotation_from_angles(*unknowns[:3]).as_matrix()
    translation = cross_matrix(unknowns[3:])
    directions, moments = source[:, :3] @ rotation.T, source[:, 3:] @ rotation.T
    turned = cross_matrices(directions)
    by_pose = np.zeros((len(source), 6, 6))
    by_pose[:, :3, :3] = by_pose[:, 3:, 3:] = -turned
    by_pose[:, 3:, :3] = -translation @ turned - cross_matrices(moments)
    pose_design = by_pose.reshape(-1, 6)
    moved = np.hstack([directions, moments + directions @ translation.T])
    return pose_design @ _rates(unknowns), (target - moved).ravel(), pose_design


def _rates(unknowns: Parameters) -> Matrix6:
    """Give the derivatives of (rotation vector, t) by (ω, φ, κ, t)."""
    rates = np.eye(6)
    rates[:3, :3] = rotation_vector_rates(float(unknowns[0]), float(unknowns[1]))
    return rates


def _require_regular(normal: Matrix6) -> None:
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), np.finfo(np.float64).tiny))
    values = np.linalg.eigvalsh(normal * np.outer(scale, scale))
    missing = int((values < SINGULAR_SHARE * values[-1]).sum())
    if missing:
        raise DegenerateGeometryError(6 - missing, [], None, "Add a line in another direction.")
