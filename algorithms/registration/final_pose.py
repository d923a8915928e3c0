"""The final pose from lines, planes and surfaces together."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.principal_motions import principal_motions
from algorithms.adjustment.rank import CentredFrame
from algorithms.adjustment.snooping import CorrespondenceState
from algorithms.arrays import Array, Flags, Matrix6, Vector3
from algorithms.errors import TooFewCorrespondencesError
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.lines import LineSource
from algorithms.geometry.poses import PoseEstimate
from algorithms.matching.open_shifts import shift_by_planes
from algorithms.registration.base import FinalPose, FineRegistration, PosePart, RegistrationProblem
from algorithms.registration.neighbourhood_covariance import LEAST_NEIGHBOURHOODS
from algorithms.registration.pose_fusion import (
    Consistency,
    FusionFrame,
    Information,
    consistency,
    information_of_difference,
    joint_covariance,
    share_of_first,
)
from algorithms.registration.rigidity import Rigidity
from algorithms.registration.rounding_covariance import common_shift_covariance
from algorithms.registration.surface_estimate import SurfaceEstimate, estimate_by_surfaces
from algorithms.registration.surface_options import SurfaceOptions

CONTRADICTION_ALPHA = 0.001
"""Probability with which two good estimates of a pose are taken to contradict each other."""
AXIS_RADII = 1.3
"""Surface so near to a matched axis, in radii, belongs to its cylinder."""
LEAST_SHARE = 0.01
"""An estimate with less of the information is not named as one that gave the pose."""
UNEVEN_WALLS = 4.0
"""Factor on the variances that lines and planes give a pose, beside surfaces and alone: two scans see different pieces
of a wall, which is not plane. In 36 registrations of a car park and a yard with references their errors were 1.8 and
1.9 times what they promise (rms), those of the surfaces 1.3 and 1.0 times."""
PARAMETERS = 6
MOST_TURN_PER_M, MOST_TURN_BESIDE_PLANES = 1e-4, 5e-4
"""An open motion that turns by less beside a shift of a metre is a shift [rad/m]; where ground far off stands in for
what the scans do not share, centimetres matter less."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """Lines and planes beside surfaces."""

    test: Consistency
    apart_m: float
    """How far the two poses are from each other where both determine them: shift of the surface's centre and turn, as
    the shift it causes at the rms distance, together [m]."""


def compared(fine: FineRegistration, surfaces: SurfaceEstimate) -> Comparison:
    """Test the pose of lines and planes against that of all surfaces.

    Parameters
    ----------
    fine
        Adjusted lines and planes.
    surfaces
        The estimate by surfaces.
    """
    frame = frame_of(surfaces)
    ours, theirs = frame.information(fine.adjustment.pose_a_posteriori), frame.information(surfaces.pose)
    seen = np.linalg.svd(information_of_difference(ours, theirs))
    apart = seen[0][:, seen[1] > 1e-12 * seen[1][0]].T @ (ours.motion_m - theirs.motion_m)
    return Comparison(consistency(ours, theirs, CONTRADICTION_ALPHA), float(np.linalg.norm(apart)))


def frame_of(surfaces: SurfaceEstimate) -> FusionFrame:
    """Tell motions from the pose of the surfaces, at their centre."""
    return FusionFrame(surfaces.pose.target_from_source, CentredFrame(surfaces.centre_m, surfaces.radius_m))


def of_surfaces(
    problem: RegistrationProblem, surfaces: SurfaceEstimate, reason: str, *, held: FineRegistration | None = None
) -> FinalPose:
    """Take the pose of the surfaces alone.

    Parameters
    ----------
    problem
        Features of both scans.
    surfaces
        The estimate.
    reason
        Why it stands alone, in words.
    held
        Lines and planes that contradict it without being refuted: the covariance holds their pose too.
    """
    part, frame = PosePart("surfaces", 1.0), frame_of(surfaces)
    pose = surfaces.pose
    if held is not None:
        information = frame.information(held.adjustment.pose_a_posteriori)
        pose = frame.holding_both(pose, information, frame.information(pose))
    return _final(problem, pose, frame.centred, "surfaces", reason, (part,), 0.0, surfaces)


def widened(problem: RegistrationProblem, final: FinalPose, tested: Rigidity) -> FinalPose:
    """Let the covariance hold what a deformation of the scans leaves open.

    Parameters
    ----------
    problem
        Features of both scans.
    final
        The pose.
    tested
        Whether the scans differ by more than a motion.
    """
    reduced = tested.widened(final.reduced)
    pose = reduced.moved_to_origins(problem.target.origin_m, problem.source.origin_m)
    return replace(final, reduced=reduced, pose=pose)


def open_shift(pose: PoseEstimate, most_turn_per_m: float = MOST_TURN_PER_M) -> Vector3 | None:
    """Give the unit direction of the one motion that a pose leaves open if it is a shift, target frame (3,).

    Parameters
    ----------
    pose
        The pose.
    most_turn_per_m
        With so much turn beside a metre it is no shift [rad/m].
    """
    if pose.null_space.shape[1] != 1:
        return None
    turn, shift = np.split(pose.null_space[:, 0], 2)
    length = float(np.linalg.norm(shift))
    return None if float(np.linalg.norm(turn)) > most_turn_per_m * length else np.asarray(shift / length)


def with_open_shift(problem: RegistrationProblem, final: FinalPose) -> FinalPose:
    """Put a pose that leaves a shift open where planes that both scans see in different places are one.

    The shift stays undetermined: the covariance says nothing of it. Approximate poses of both stations tell more than
    this assumption: with them the pose stays as it is.

    Parameters
    ----------
    problem
        Features of both scans.
    final
        The pose.
    """
    direction = open_shift(final.reduced, MOST_TURN_BESIDE_PLANES)
    if direction is None or (problem.priors is not None and problem.priors.target_from_source is not None):
        return final
    found = shift_by_planes(problem.target, problem.source, final.reduced.target_from_source, direction)
    if found is None:
        return final
    moved = RigidTransform.from_translation(found.shift_m * direction) * final.reduced.target_from_source
    reduced = replace(final.reduced, target_from_source=moved)
    reason = (
        f"{final.reason}; the shift that they leave open is set as if planes that the scans see in different places "
        f"were one (pairs: {found.planes}; standard deviation {found.std_m * 1e3:.0f} mm if so, which nothing shows)"
    )
    pose = reduced.moved_to_origins(problem.target.origin_m, problem.source.origin_m)
    return replace(final, reduced=reduced, pose=pose, reason=reason)


def of_features(
    problem: RegistrationProblem, fine: FineRegistration, label: str, reason: str, *, pose: PoseEstimate | None = None
) -> FinalPose:
    """Take the pose of lines and planes alone; walls that are not plane make it as uncertain as beside surfaces.

    Parameters
    ----------
    problem
        Features of both scans.
    fine
        Adjusted lines and planes.
    label
        What they are, such as lines+planes.
    reason
        Why they stand alone, in words.
    pose
        Between the reduced frames, by another estimator from the same lines; None: that of the adjustment.
    """
    adjustment = fine.adjustment
    estimate = (adjustment.pose_a_posteriori if pose is None else pose).with_covariance_scaled(UNEVEN_WALLS)
    centred = CentredFrame(adjustment.centroid_m, adjustment.radius_m)
    return _final(problem, estimate, centred, label, reason, (PosePart(label, 1.0),), 1.0, None)


@dataclass(frozen=True, eq=False)
class Joined:
    """A pose from features and surfaces, and how errors of the features come through to it."""

    final: FinalPose
    gain: Matrix6
    """(6, 6) change of the joined pose by a change of that of the features, motions as of `FusionFrame`."""
    parallel: Matrix6
    """(6, 6) inverse of the covariance of the difference of features and surfaces [1/m²]."""


def joined(
    problem: RegistrationProblem,
    fine: FineRegistration,
    surfaces: SurfaceEstimate,
    comparison: Comparison,
    label: str,
    *,
    torn: bool = False,
) -> Joined:
    """Join lines and planes with surfaces: both rest on the same scans, so of the two only a mixture counts.

    The surfaces of a plane are its points once more, looked at place by place where the planes compare averages over
    two different pieces of an uneven wall; how the errors of both are correlated nobody knows (`share_of_first`). Where
    features and surfaces contradict each other, the covariance holds both.

    Parameters
    ----------
    problem
        Features of both scans.
    fine, surfaces, comparison
        The two estimates, and how they compare.
    label
        What the features are, such as lines+planes.
    torn
        One of the two errs, and nothing tells which.
    """
    frame = frame_of(surfaces)
    candidates = frame.information(fine.adjustment.pose_a_posteriori), frame.information(surfaces.pose)
    factor = 1.0 if torn else comparison.test.factor
    features = candidates[0].with_covariance_scaled(factor * UNEVEN_WALLS)
    all_surfaces = candidates[1].with_covariance_scaled(factor) if _is_dependable(surfaces) else Information.nothing()
    share = share_of_first(features.matrix, all_surfaces.matrix)
    weighed = ((share, features), (1.0 - share, all_surfaces))
    estimate, covariance = frame.estimate(weighed), joint_covariance(weighed)
    if torn:
        estimate = frame.holding_both(estimate, *candidates)
    rank = PARAMETERS - estimate.null_space.shape[1]
    shares = [weight * float(np.trace(covariance @ part.matrix)) / max(rank, 1) for weight, part in weighed]
    names = label.replace("+", " and "), "surfaces"
    parts = tuple(
        PosePart(name, value) for value, name in sorted(zip(shares, names, strict=True), reverse=True) if value > 0.0
    )
    words = ", ".join(f"{part.name} {part.share:.0%}" for part in parts)
    agreement = "they agree"
    if torn:
        agreement = "one of them errs, and nothing tells which, so the standard deviations hold both"
    elif factor != 1.0:
        agreement = f"they differ by more than chance, so all variances are {factor:.1f} times larger"
    reason = f"{words} of the information; {agreement} (features and surfaces {in_words(comparison)})"
    carrying = zip((label, "surfaces"), shares, strict=True)
    estimator = "+".join(name for name, value in carrying if value >= LEAST_SHARE)
    final = _final(problem, estimate, frame.centred, estimator, reason, parts, shares[0], surfaces)
    difference = information_of_difference(
        *(part.with_covariance_scaled(comparison.test.factor) for part in candidates)
    )
    return Joined(final, share * covariance @ features.matrix, difference)


def refuted_by_own_surfaces(
    problem: RegistrationProblem, fine: FineRegistration, surfaces: SurfaceEstimate, options: SurfaceOptions
) -> str | None:
    """Say that the surfaces of the matched features themselves do not bear the features' pose out; None if they may.

    The surfaces of the matched planes are all that the features know. From the features' pose on they are laid on each
    other place by place. The features are refuted where this contradicts their pose, but agrees with the other
    surfaces, which are independent data.

    Parameters
    ----------
    problem
        Features of both scans.
    fine
        Adjusted lines and planes that contradict the surfaces.
    surfaces
        The estimate by all surfaces.
    options
        Of the surfaces.
    """
    used = _in_matched_features(problem, fine)
    frame, pose = frame_of(surfaces), fine.adjustment.pose_a_posteriori
    features = frame.information(pose)
    own = _part(problem, pose.target_from_source, frame, options, (~used[0], ~used[1]))
    others = _part(problem, surfaces.pose.target_from_source, frame, options, used)
    against = consistency(own, features, CONTRADICTION_ALPHA)
    beside = consistency(own, others, CONTRADICTION_ALPHA)
    apart = consistency(others, features, CONTRADICTION_ALPHA)
    if not against.contradicts or not apart.contradicts or beside.contradicts:
        return None
    return (
        "the very surfaces of the matched planes do not bear that out (test value "
        f"{against.statistic:.0f}, limit {against.critical:.0f}) and agree with all other surfaces (test value "
        f"{beside.statistic:.0f}, limit {beside.critical:.0f})"
    )


def in_words(comparison: Comparison) -> str:
    """Say how two estimates compare."""
    test = comparison.test
    if test.degrees == 0:
        return "nothing is determined by both"
    return f"{comparison.apart_m * 1e3:.1f} mm apart, test value {test.statistic:.0f}, limit {test.critical:.0f}"


def _part(
    problem: RegistrationProblem,
    start: RigidTransform,
    frame: FusionFrame,
    options: SurfaceOptions,
    left_out: tuple[Array, Array],
) -> Information:
    """Estimate by a part of the surfaces; nothing where too little is left to know its covariance by."""
    try:
        found = estimate_by_surfaces(problem.target, problem.source, start, options, left_out=left_out)
    except TooFewCorrespondencesError:
        return Information.nothing()
    return frame.information(found.pose) if _is_dependable(found) else Information.nothing()


def _is_dependable(surfaces: SurfaceEstimate) -> bool:
    """Say whether an estimate by surfaces settled, and rests on enough to know its covariance by."""
    return surfaces.converged and surfaces.neighbourhoods >= LEAST_NEIGHBOURHOODS


def _in_matched_features(problem: RegistrationProblem, fine: FineRegistration) -> tuple[Array, Array]:
    """Say which surface points of target and source belong to features that the adjustment used."""
    lines, planes = (
        pairs[states != int(CorrespondenceState.REMOVED)]
        for pairs, states in (
            (fine.lines, fine.adjustment.lines.states),
            (fine.planes, fine.adjustment.planes.states),
        )
    )
    found = [
        _in_features(features, lines[:, side], planes[:, side])
        for side, features in enumerate((problem.target, problem.source))
    ]
    return found[0], found[1]


def _in_features(features: ScanFeatures, lines: Array, planes: Array) -> Flags:
    """Say which points of an index lie on given planes, on planes that given lines are made of, or around axes."""
    index, own = features.index, features.lines
    of_planes = lines[(own.parents[lines] >= 0).all(axis=1)]
    numbers = np.union1d(planes, own.parents[of_planes].ravel())
    inside = np.isin(features.surface.plane_labels[index.numbers], numbers)
    axes = lines[own.sources[lines] == int(LineSource.CYLINDER_AXIS)]
    for line, cylinder in zip(axes.tolist(), own.parents[axes, 0].tolist(), strict=True):
        arms = index.points - own.anchors[line]
        along = arms @ own.directions[line]
        radius = AXIS_RADII * features.cylinders.radii_m[cylinder]
        across = np.linalg.norm(arms - along[:, None] * own.directions[line], axis=1)
        low, high = own.extents[line]
        inside |= (across < radius) & (along > low - radius) & (along < high + radius)
    return np.asarray(inside)


def _final(
    problem: RegistrationProblem,
    reduced: PoseEstimate,
    centred: CentredFrame,
    estimator: str,
    reason: str,
    parts: tuple[PosePart, ...],
    feature_share: float,
    surfaces: SurfaceEstimate | None,
) -> FinalPose:
    """Carry a pose to the files' coordinates, and put what is free in words."""
    common = common_shift_covariance(problem.target, problem.source, reduced.rotation)
    reduced = replace(reduced, covariance=reduced.covariance + common)
    free = reduced.null_space.shape[1]
    directions = PoseEstimate(reduced.target_from_source, reduced.null_space @ reduced.null_space.T)
    words = principal_motions(directions, centred.centroid, centred.radius_m)[:free]
    return FinalPose(
        pose=reduced.moved_to_origins(problem.target.origin_m, problem.source.origin_m),
        reduced=reduced,
        centred=centred,
        centre_m=centred.centroid + problem.target.origin_m,
        estimator=estimator,
        reason=reason,
        parts=parts,
        feature_share=feature_share,
        surfaces=surfaces,
        free_directions=tuple(motion.text for motion in words),
        advice="add surfaces that stand across these motions, or lines that cross them" if free else "",
    )
