"""What is to be thought of a pose that lines, planes and surfaces gave, together or alone."""

import numpy as np

from algorithms.adjustment.principal_motions import principal_motions
from algorithms.adjustment.snooping import CorrespondenceState
from algorithms.adjustment.testing import noncentrality
from algorithms.geometry.pose_parameters import shift_of_origin
from algorithms.matching.coarse_registration import CoarseRegistration
from algorithms.quality.acceptance import AcceptanceStatus, Verdict, Verification
from algorithms.registration.base import FinalPose, FineRegistration, PairStatus, RegistrationProblem, TargetFit
from algorithms.registration.final_pose import PARAMETERS, Joined
from algorithms.registration.neighbourhood_covariance import LEAST_NEIGHBOURHOODS
from algorithms.registration.pair_verdict import (
    LEAST_REDUNDANCY,
    WORST_STD_M,
    agreement_doubts,
    allowed_m,
    misfit_doubts,
    remarks_on,
)
from algorithms.registration.surface_estimate import WEAK_TESTIMONY

FAR_SHARE = 0.9
"""Within the distance from what is common that this share of a scan's surface keeps, the pose must be known..."""
FAR_NOISES = 5.0
"""...to `WORST_STD_M`, or to so many standard deviations of single points where they are noisy."""

LEAST_SUPPORT_OF_WEAK = 0.2
"""So much of the surface must lie on surface where less than `WEAK_TESTIMONY` of it determines a motion: a sliver of a
sliver may be the error of a scanner (in streets by one out of adjustment such poses lay 0.3 m off)."""


def status_of_final(
    problem: RegistrationProblem,
    coarse: CoarseRegistration,
    final: FinalPose,
    verdict: Verdict,
    *,
    fine: FineRegistration | None,
    doubts: tuple[str, ...],
    hidden_m: float,
    targets: TargetFit | None = None,
) -> tuple[PairStatus, tuple[str, ...]]:
    """Join what surfaces, runner-up, tests and geometry say; the most severe decides.

    Parameters
    ----------
    problem
        Features of both scans.
    coarse
        The search.
    final
        The pose.
    verdict
        Of the surfaces in that pose.
    fine
        The lines and planes in it; None: it rests on surfaces alone.
    doubts
        What is known already.
    hidden_m
        How far an error that no test finds may shift the pose [m].
    targets
        Survey targets in it; None: there are none.
    """
    reasons = [final.reason, *verdict.reasons, *coarse.remarks, *remarks_on(problem, fine)]
    if verdict.status is AcceptanceStatus.REJECTED:
        return PairStatus.REJECTED, tuple(reasons)
    rank = PARAMETERS - final.reduced.null_space.shape[1]
    if rank < PARAMETERS:
        free = "; ".join(final.free_directions)
        return PairStatus.DEGENERATE, (
            f"features and surfaces determine only {rank} of 6 parameters, free: {free}. {final.advice}",
            *reasons,
            *doubts,
        )
    told = targets is not None and targets.is_controlled
    if verdict.status is AcceptanceStatus.AMBIGUOUS or (coarse.ambiguous and not told):
        return PairStatus.AMBIGUOUS, tuple(dict.fromkeys([*reasons, *coarse.reasons, *doubts]))
    found = [*doubts, *_doubts(final, fine, hidden_m, allowed_m(problem), targets), *_doubts_far_off(problem, final)]
    if fine is not None:
        found += [*misfit_doubts([fine]), *agreement_doubts(fine)]
    if problem.priors is not None:
        found += problem.priors.contradictions(final.reduced)
    if verdict.status is AcceptanceStatus.DOUBTFUL or found:
        return PairStatus.DOUBTFUL, (*reasons, *found)
    return PairStatus.ACCEPTED, tuple(reasons)


def _doubts(
    final: FinalPose, fine: FineRegistration | None, hidden_m: float, limit_m: float, targets: TargetFit | None
) -> list[str]:
    """Say what keeps a determined pose from being accepted."""
    doubts = []
    surfaces = final.surfaces
    if surfaces is not None and not surfaces.converged:
        doubts.append("the surfaces did not settle")
    if fine is not None and not fine.adjustment.converged:
        doubts.append("the adjustment did not settle")
    spare = 0 if fine is None else fine.adjustment.redundancy
    common = 0 if surfaces is None else surfaces.neighbourhoods
    if targets is not None and final.without_targets is None:
        doubts += _doubts_of_targets(targets, limit_m)
    elif spare < LEAST_REDUNDANCY and common < LEAST_NEIGHBOURHOODS and (targets is None or not targets.is_controlled):
        doubts.append(
            f"lines and planes have {spare} conditions more than parameters, and the surfaces {common} neighbourhoods "
            f"in common: errors could hide ({LEAST_REDUNDANCY} or {LEAST_NEIGHBOURHOODS} would be needed)"
        )
    if hidden_m > limit_m:
        doubts.append(
            f"an error that no test could find would shift the pose by {hidden_m * 1e3:.0f} mm "
            f"({limit_m * 1e3:.0f} mm would be allowed): too little controls it"
        )
    doubts += [
        f"the {motion.text} is hardly determined (standard deviation {motion.std_m * 1e3:.0f} mm, "
        f"{limit_m * 1e3:.0f} mm would be allowed)"
        for motion in principal_motions(final.reduced, final.centred.centroid, final.centred.radius_m)
        if motion.std_m > limit_m
    ]
    return doubts


def _doubts_of_targets(targets: TargetFit, limit_m: float) -> list[str]:
    """Say where an error in one of the targets that carry a pose alone could hide."""
    if not targets.is_controlled:
        doubt = (
            f"an error in one of {int(targets.used.sum())} common targets would not show, whatever its size: four that "
            "do not lie in one plane, or more, control each other"
        )
        return [doubt]
    if targets.hidden_m > limit_m:
        doubt = (
            f"an error in a target that no test could find would shift the pose by {targets.hidden_m * 1e3:.0f} mm "
            f"({limit_m * 1e3:.0f} mm would be allowed)"
        )
        return [doubt]
    return []


def _doubts_far_off(problem: RegistrationProblem, final: FinalPose) -> list[str]:
    """Say where a small common part carries a large scan badly: turns grow with the distance from it.

    Asked of the scan that reaches less far, so the answer does not depend on which of the two is the target.
    """
    source_points = final.reduced.target_from_source.apply(problem.source.index.points)
    reach_m = min(
        float(np.quantile(np.linalg.norm(points - final.centred.centroid, axis=1), FAR_SHARE))
        for points in (problem.target.index.points, source_points)
    )
    noise_m = max(problem.target.noise_std_m, problem.source.noise_std_m)
    limit_m = max(WORST_STD_M, FAR_NOISES * noise_m)
    worst = principal_motions(final.reduced, final.centred.centroid, reach_m)[0]
    if worst.std_m <= limit_m:
        return []
    doubt = (
        f"what the scans have in common carries the rest of them badly: {reach_m:.0f} m from it the {worst.text} is "
        f"known to {worst.std_m * 1e3:.0f} mm (standard deviation, {limit_m * 1e3:.0f} mm would be allowed)"
    )
    return [doubt]


def doubts_of_slivers(final: FinalPose, verification: Verification) -> tuple[str, ...]:
    """Say where little of the surface lies on surface, and hardly any of that determines a motion.

    Parameters
    ----------
    final
        The pose; where features carry most of it nothing is said.
    verification
        Of the surfaces in it.
    """
    surfaces = final.surfaces
    if surfaces is None or final.feature_share > 0.5 or surfaces.least_testimony >= WEAK_TESTIMONY:
        return ()
    if verification.support_share >= LEAST_SUPPORT_OF_WEAK:
        return ()
    doubt = (
        f"only {verification.support_share:.0%} of the surface fits, and of that only {surfaces.least_testimony:.1%} "
        f"stands across one motion: too little controls it ({LEAST_SUPPORT_OF_WEAK:.0%} or {WEAK_TESTIMONY:.0%} would "
        "be needed)"
    )
    return (doubt,)


def hidden_shift_m(fine: FineRegistration, whole: Joined) -> float:
    """Give the largest shift of the joined pose by an error in one line or plane that no test finds [m] (MATH 4.3).

    What an error moves the features' pose by comes through only with the features' share of the information; and as
    the two poses are tested against each other, an error that moves that of the features by more than this test finds
    does not stay undetected, whether the features control it or not.

    Parameters
    ----------
    fine
        Adjusted lines and planes.
    whole
        They and the surfaces.
    """
    adjustment = fine.adjustment
    frame = whole.final.centred
    power = noncentrality(adjustment.options.alpha_single, adjustment.options.power)
    reports = [
        (report, report.states != CorrespondenceState.REMOVED) for report in (adjustment.lines, adjustment.planes)
    ]
    motions = adjustment.undetected
    arm = frame.centroid - adjustment.centroid_m
    moved = np.hstack([motions[:, :3] * frame.radius_m, shift_of_origin(motions[:, :3], motions[:, 3:], arm)])
    found = np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", moved, whole.parallel, moved), 1e-30))
    moved *= np.minimum(1.0, power / found)[:, None]
    shifts = np.linalg.norm(moved @ whole.gain[3:].T, axis=1)
    largest = float(shifts.max(initial=0.0))
    if all(report.controlled[used].all() for report, used in reports):
        return largest
    return max(largest, _of_any_error(whole, power))


def _of_any_error(whole: Joined, power: float) -> float:
    """Give the largest shift by any error in the features that the test of the two poses against each other misses."""
    values, vectors = np.linalg.eigh(whole.parallel)
    tested = values > 1e-9 * max(float(values[-1]), 1.0)
    untested = whole.gain[3:] @ vectors[:, ~tested]
    if untested.size and np.abs(untested).max() > 1e-6:
        return np.inf
    roots = vectors[:, tested] / np.sqrt(values[tested])
    return power * float(np.linalg.norm(whole.gain[3:] @ roots, ord=2))
