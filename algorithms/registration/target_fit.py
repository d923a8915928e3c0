"""The pose of two stations from survey targets that both see: closed form, adjustment, gross errors (MATH 6.7)."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.hybrid.closed_forms import robust_similarity, spread_in_plane
from algorithms.adjustment.hybrid.tied_results import TiedAdjustment
from algorithms.adjustment.hybrid.tied_stations import (
    OPTIONS,
    KnownPoints,
    SeenPoints,
    TiedStations,
    adjust_tied_stations,
)
from algorithms.adjustment.rank import CentredFrame
from algorithms.adjustment.testing import GlobalVerdict, global_test
from algorithms.arrays import Array, Points
from algorithms.errors import DegenerateGeometryError, TooFewCorrespondencesError
from algorithms.geometry.poses import PoseEstimate
from algorithms.geometry.rotations import cross_matrices
from algorithms.registration.base import RegistrationProblem, TargetFit
from algorithms.targets.common_points import CommonPoints, TargetSet, common_points

LEAST_COMMON = 3
ALPHA_GLOBAL = 0.05


def fitted_targets(problem: RegistrationProblem) -> TargetFit:
    """Adjust the pose to the targets that both stations see, and leave gross errors out one at a time.

    Parameters
    ----------
    problem
        Both stations' targets.

    Raises
    ------
    TooFewCorrespondencesError
        Fewer than three are in common, or not enough agree.
    DegenerateGeometryError
        They lie on one line.
    """
    target, source = problem.target_points or TargetSet.none(), problem.source_points or TargetSet.none()
    common = common_points(target, source)
    if len(common) < LEAST_COMMON:
        raise TooFewCorrespondencesError(len(common), LEAST_COMMON, f"targets in common ({common.reason})")
    ours, theirs = target.points[common.pairs[:, 0]], source.points[common.pairs[:, 1]]
    if not spread_in_plane(ours.coordinates):
        raise _on_one_line()
    _, rotation, shift = robust_similarity(theirs.coordinates, ours.coordinates)
    start = RigidTransform.from_components(shift, Rotation.from_matrix(rotation))
    n = len(common)
    numbers = np.arange(n)
    seen = SeenPoints(
        np.repeat([0, 1], n),
        np.concatenate([numbers, numbers]),
        np.vstack([ours.coordinates, theirs.coordinates]),
        np.concatenate([ours.covariances, theirs.covariances]),
    )
    # of 2n observations at most n - 3 are left out: three targets remain
    options = replace(OPTIONS, max_removed_share=(n - LEAST_COMMON) / (2.0 * n))
    found = adjust_tied_stations(TiedStations(seen, KnownPoints.none()), [RigidTransform.identity(), start], options)
    used = found.seen.used[:n] & found.seen.used[n:]
    if int(used.sum()) < LEAST_COMMON:
        raise TooFewCorrespondencesError(int(used.sum()), LEAST_COMMON, "targets that agree")
    if not spread_in_plane(ours.coordinates[used]):
        raise _on_one_line()
    return _fit(common, _names(target, source, common), ours.coordinates, theirs.coordinates, found, seen, used)


def _on_one_line() -> DegenerateGeometryError:
    return DegenerateGeometryError(
        5, ("rotation about the line on which all common targets lie",), advice="add a target beside that line"
    )


def _names(target: TargetSet, source: TargetSet, common: CommonPoints) -> tuple[str, ...]:
    return tuple(target.names[i] or source.names[k] or f"{i + 1}/{k + 1}" for i, k in common.pairs.tolist())


def _fit(
    common: CommonPoints,
    names: tuple[str, ...],
    ours: Points,
    theirs: Points,
    found: TiedAdjustment,
    seen: SeenPoints,
    used: Array,
) -> TargetFit:
    n = len(common)
    test = global_test(found.omega, found.redundancy, ALPHA_GLOBAL)
    factor = found.omega / found.redundancy if test.verdict is GlobalVerdict.TOO_LARGE else 1.0
    pose = found.poses[1]
    centre = ours[used].mean(axis=0)
    radius = float(np.sqrt(np.mean(np.sum((ours[used] - centre) ** 2, axis=1))))
    tests = found.seen
    of_source = tests.selected(slice(n, None))
    # an error across the plane of three targets turns the pose and leaves no residual, whatever its components show
    hidden = _hidden_m(pose, theirs, seen.covariances[:n], seen.covariances[n:], of_source.detectable_m, used, centre)
    return TargetFit(
        names=names,
        pairs=common.pairs,
        residuals_m=pose.apply(theirs) - ours,
        tests=of_source,
        used=used,
        pose=PoseEstimate(pose, found.pose_covariance(1) * factor),
        centred=CentredFrame(centre, radius),
        omega=found.omega,
        redundancy=found.redundancy,
        hidden_m=hidden if (of_source.degrees[used] == 3).all() else float(np.inf),
        reason=common.reason,
    )


def _hidden_m(
    pose: RigidTransform, theirs: Points, first: Array, second: Array, detectable: Points, used: Array, centre: Array
) -> float:
    """Give the largest shift of the centre by an error of the smallest size that is found (MATH 4.3).

    dx = N⁻¹ J_kᵀ W_k R e_c ∇ with W = (C2 + R C1 Rᵀ)⁻¹, for every component c of every measurement k.
    """
    turn = pose.rotation.as_matrix()
    arms = pose.apply(theirs[used]) - centre
    jacobians = np.concatenate([-cross_matrices(arms), np.broadcast_to(np.eye(3), (len(arms), 3, 3))], axis=2)
    seen = np.where(np.isfinite(detectable[used]), detectable[used], 0.0)
    weights = np.linalg.inv(first[used] + turn @ second[used] @ turn.T)
    normal = np.einsum("nji,njk,nkl->il", jacobians, weights, jacobians)
    right = np.einsum("nji,njk,kc,nc->inc", jacobians, weights, turn, seen).reshape(6, -1)
    return float(np.linalg.norm(np.linalg.solve(normal, right)[3:], axis=0).max())
