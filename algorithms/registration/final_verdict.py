"""What is to be thought of a pose that lines, planes and surfaces gave, together or alone."""

import numpy as np

from algorithms.adjustment.snooping import CorrespondenceState
from algorithms.adjustment.testing import noncentrality
from algorithms.geometry.pose_parameters import shift_of_origin
from algorithms.matching.coarse_registration import CoarseRegistration
from algorithms.quality.acceptance import AcceptanceStatus, Verdict, Verification
from algorithms.registration.base import (
    FinalPose,
    FineRegistration,
    PairStatus,
    Precision,
    RegistrationProblem,
    TargetFit,
)
from algorithms.registration.final_pose import PARAMETERS, Joined
from algorithms.registration.neighbourhood_covariance import LEAST_NEIGHBOURHOODS
from algorithms.registration.pair_verdict import (
    LEAST_REDUNDANCY,
    agreement_doubts,
    misfit_doubts,
    remarks_on,
)
from algorithms.registration.surface_estimate import WEAK_TESTIMONY

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
    precision: Precision | None,
    targets: TargetFit | None = None,
) -> tuple[PairStatus, tuple[str, ...]]:
    """Join what surfaces, runner-up, tests and geometry say; the most severe decides.

    What the precision lacks makes a pose coarse, never doubtful.

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
        What is known against its place.
    precision
        How well it is known; None: it leaves motions free.
    targets
        Survey targets in it; None: there are none.
    """
    reasons = [final.reason, *verdict.reasons, *coarse.remarks, *remarks_on(problem, fine)]
    findings = () if precision is None else precision.findings
    if verdict.status is AcceptanceStatus.REJECTED:
        return PairStatus.REJECTED, tuple(reasons)
    if precision is None:
        rank = PARAMETERS - final.reduced.null_space.shape[1]
        free = "; ".join(final.free_directions)
        return PairStatus.DEGENERATE, (
            f"features and surfaces determine only {rank} of 6 parameters, free: {free}. {final.advice}",
            *reasons,
            *doubts,
        )
    told = targets is not None and targets.is_controlled
    if verdict.status is AcceptanceStatus.AMBIGUOUS or (coarse.ambiguous and not told):
        return PairStatus.AMBIGUOUS, tuple(dict.fromkeys([*reasons, *coarse.reasons, *doubts, *findings]))
    found = [*doubts, *_doubts(final, fine, targets)]
    if fine is not None:
        found += [*misfit_doubts([fine]), *agreement_doubts(fine)]
    if problem.priors is not None:
        found += problem.priors.contradictions(final.reduced)
    if verdict.status is AcceptanceStatus.DOUBTFUL or found:
        return PairStatus.DOUBTFUL, (*reasons, *found, *findings)
    return PairStatus.COARSE if findings else PairStatus.ACCEPTED, (*reasons, *findings)


def _doubts(final: FinalPose, fine: FineRegistration | None, targets: TargetFit | None) -> list[str]:
    """List what keeps a determined pose from being trusted."""
    doubts = []
    surfaces = final.surfaces
    if surfaces is not None and not surfaces.converged:
        doubts.append("the surfaces did not settle")
    if fine is not None and not fine.adjustment.converged:
        doubts.append("the adjustment did not settle")
    spare = 0 if fine is None else fine.adjustment.redundancy
    common = 0 if surfaces is None else surfaces.neighbourhoods
    controlled = targets is not None and targets.is_controlled
    if targets is not None and final.without_targets is None:
        if not controlled:
            doubts.append(
                f"an error in one of {int(targets.used.sum())} common targets would not show, whatever its size: four "
                "that do not lie in one plane, or more, control each other"
            )
    elif spare < LEAST_REDUNDANCY and common < LEAST_NEIGHBOURHOODS and not controlled:
        doubts.append(
            f"lines and planes have {spare} conditions more than parameters, and the surfaces {common} neighbourhoods "
            f"in common: errors could hide ({LEAST_REDUNDANCY} or {LEAST_NEIGHBOURHOODS} would be needed)"
        )
    return doubts


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
