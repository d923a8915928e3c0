"""The work of the methods `auto` and `icp-plane`: the best estimate that the features and surfaces of two scans allow.

Lines and planes are adjusted first, and compared with the surfaces, which see much that belongs to no plane. Where they
agree, both make the pose together. Where they contradict each other, correspondences are found anew near the surfaces'
pose, then planes alone are tried. Where that does not help either, the very surfaces of the matched planes are asked:
they are all that the features know. Where these, laid on each other place by place from the features' pose on, do not
stay there but come to where the other surfaces, which are independent data, have the scan, the features err (planes
that are not plane, wrong partners) and the surfaces stand alone. Else the covariance holds both, and the pose is
coarse. Where there are surfaces, an adjustment of features that does not settle is left out, and the reason says so.
"""

from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.options import AdjustmentOptions
from algorithms.errors import DegenerateGeometryError, TooFewCorrespondencesError
from algorithms.matching.coarse_registration import CoarseRegistration
from algorithms.matching.options import MatchingOptions
from algorithms.progress import Progress
from algorithms.registration.auto import AutoMethod
from algorithms.registration.base import FineRegistration, PairResult, PairStatus, RegistrationProblem, TargetFit
from algorithms.registration.final_pose import (
    Comparison,
    compared,
    in_words,
    joined,
    of_features,
    of_surfaces,
    refuted_by_own_surfaces,
    with_open_shift,
)
from algorithms.registration.final_verdict import hidden_shift_m
from algorithms.registration.icp_plane import IcpPlaneMethod
from algorithms.registration.line_registration import FeatureUse, adjusted_features
from algorithms.registration.pair_verdict import (
    allowed_m,
    largest_hidden_shift_m,
    misfit_doubts,
    searched,
)
from algorithms.registration.surface_estimate import SurfaceEstimate, estimate_by_surfaces
from algorithms.registration.surface_options import SurfaceOptions
from algorithms.registration.target_registration import (
    fit_in_words,
    judged_by_targets,
    started_by_targets,
    targets_in_common,
    with_targets,
)
from algorithms.registration.verdict import Answer, judged
from algorithms.scans.point_blocks import side_by_side

NOISES_APART = 2.0
"""Poses of features and surfaces that are less than so many standard deviations of single points apart do not
contradict each other, however significant it is: so far off are uneven surfaces. Farther apart one of them errs; while
that is within what is asked of a pose (`allowed_m`), the standard deviations hold both."""
MOST_CONTRADICTION = 3.0
"""So many times the limit may the test value be where features and surfaces differ by more than chance. Farther beyond
the variances of either are no measure of its errors, and neither enlarged ones nor such that hold both may be signed:
one large plane is off, or the scans differ by more than a motion where they hardly show it. In a car park, a yard, a
hall and a street with references the value was at most 1.6 times the limit, in scans stretched by 0.2 and 1 % in
height, with one floor in common, 20 and 3.3 times."""
NEAR = ((0.02, 0.05),) * 3
"""Gates for correspondences found anew near the surfaces' pose."""


@dataclass(frozen=True, eq=False)
class _Attempt:
    """Features that were adjusted, and how they compare with the surfaces."""

    label: str
    fine: FineRegistration
    comparison: Comparison | None
    """None without surfaces to compare with."""

    @property
    def contradicts(self) -> bool:
        """Say whether features and surfaces differ by more than chance."""
        return self.comparison is not None and self.comparison.test.contradicts


def register_automatically(problem: RegistrationProblem, method: AutoMethod, progress: Progress) -> PairResult:
    """Register two scans by what they have; every failure becomes a result with its status and reasons.

    Parameters
    ----------
    problem
        Features of both scans.
    method
        Options.
    progress
        Is told the steps.
    """
    progress.report(0.0, "matching")
    fit, why = targets_in_common(problem)
    if fit is not None and fit.is_controlled:
        problem = started_by_targets(problem, fit)
    coarse = searched(problem, method.matching)
    if isinstance(coarse, PairResult):
        if fit is None:
            return replace(coarse, reasons=(*coarse.reasons, *why))
        return judged_by_targets(problem, fit, method.matching, f"{fit_in_words(fit)}; {coarse.reasons[0]}")
    result = estimated_and_judged(
        problem, coarse, method.matching, method.adjustment, method.surfaces, progress, targets=fit
    )
    return replace(result, reasons=(*result.reasons, *why))


def estimated_and_judged(
    problem: RegistrationProblem,
    coarse: CoarseRegistration,
    matching: MatchingOptions,
    adjustment: AdjustmentOptions,
    surface: SurfaceOptions,
    progress: Progress,
    *,
    targets: TargetFit | None = None,
) -> PairResult:
    """Estimate from a pose on by what the scans have there, and judge the result.

    Parameters
    ----------
    problem
        Features of both scans.
    coarse
        The pose, and what else could be.
    matching, adjustment, surface
        Options.
    progress
        Is told the steps.
    targets
        Survey targets in common, which join the rest; None: there are none.
    """
    progress.report(0.6, "adjustment")
    surfaces, first = side_by_side(
        lambda: _by_surfaces(problem, coarse, surface),
        lambda: _adjusted(problem, FeatureUse(), adjustment, coarse.target_from_source),
    )
    attempts, remarks = _attempts(problem, coarse, adjustment, surfaces, first)
    answer = _answer(problem, surfaces, attempts, remarks, surface)
    if answer is None and targets is not None:
        return judged_by_targets(problem, targets, matching, "; ".join([fit_in_words(targets), *remarks]))
    if answer is not None and targets is not None:
        answer = with_targets(problem, answer, targets)
    if answer is None:
        reason = f"a pose was found, but nothing to determine it by: {'; '.join(remarks)}"
        return PairResult(PairStatus.REJECTED, (reason,), coarse, None, None)
    progress.report(0.9, "verification")
    return judged(problem, coarse, replace(answer, final=with_open_shift(problem, answer.final)), matching)


def register_by_surfaces(problem: RegistrationProblem, method: IcpPlaneMethod, progress: Progress) -> PairResult:
    """Register two scans by their surfaces alone, from the answer of the search.

    Parameters
    ----------
    problem
        Features of both scans; lines and planes serve the search only.
    method
        Options.
    progress
        Is told the steps.
    """
    progress.report(0.0, "matching")
    coarse = searched(problem, method.matching)
    if isinstance(coarse, PairResult):
        return coarse
    progress.report(0.6, "adjustment")
    try:
        surfaces = estimate_by_surfaces(problem.target, problem.source, coarse.target_from_source, method.surfaces)
    except TooFewCorrespondencesError as error:
        reason = f"a pose was found, but too little surface lies on surface: {error}"
        return PairResult(PairStatus.REJECTED, (reason,), coarse, None, None)
    progress.report(0.9, "verification")
    final = of_surfaces(problem, surfaces, f"the method uses surfaces alone: {surfaces.in_words()}")
    return judged(problem, coarse, Answer(final, None, surfaces.hidden_shift_m), method.matching)


def _by_surfaces(
    problem: RegistrationProblem, coarse: CoarseRegistration, options: SurfaceOptions
) -> SurfaceEstimate | None:
    try:
        return estimate_by_surfaces(problem.target, problem.source, coarse.target_from_source, options)
    except TooFewCorrespondencesError:
        return None


def _adjusted(
    problem: RegistrationProblem, use: FeatureUse, options: AdjustmentOptions, start: RigidTransform
) -> FineRegistration | str:
    """Adjust features from a pose on, or say why they do not determine one."""
    try:
        return adjusted_features(problem, use, options, start)
    except (DegenerateGeometryError, TooFewCorrespondencesError) as error:
        return str(error)


def _attempts(
    problem: RegistrationProblem,
    coarse: CoarseRegistration,
    options: AdjustmentOptions,
    surfaces: SurfaceEstimate | None,
    first: FineRegistration | str,
) -> tuple[list[_Attempt], list[str]]:
    """Adjust features in one way after the other until one does not contradict the surfaces; say why others failed.

    What came of the first way, all lines and planes from the pose of the search on, is known.
    """
    if surfaces is None:
        others, start = [FeatureUse(lines=False)], coarse.target_from_source
    else:
        others = [FeatureUse(gates=NEAR), FeatureUse(lines=False, gates=NEAR)]
        start = surfaces.pose.target_from_source
    later = ((use, _adjusted(problem, use, options, start)) for use in others)
    tried, remarks = [], []
    for use, fine in chain([(FeatureUse(), first)], later):
        label = "lines+planes" if use.lines else "planes"
        if isinstance(fine, str):
            remarks.append(f"{label}: {fine}")
            continue
        if surfaces is not None and not fine.adjustment.converged:
            remarks.append(f"{label}: the adjustment does not settle")
            continue
        tried.append(_Attempt(label, fine, None if surfaces is None else compared(fine, surfaces)))
        if not tried[-1].contradicts:
            break
        if tried[-1].comparison is not None:
            anew = ", found anew near the surfaces' pose," if use.gates is NEAR else ""
            remarks.append(f"{label}{anew} contradict the surfaces ({in_words(tried[-1].comparison)})")
    return tried, list(dict.fromkeys(remarks))


def _answer(
    problem: RegistrationProblem,
    surfaces: SurfaceEstimate | None,
    attempts: list[_Attempt],
    remarks: list[str],
    options: SurfaceOptions,
) -> Answer | None:
    """Make the pose of what agrees."""
    good = next((attempt for attempt in attempts if not attempt.contradicts), None)
    if surfaces is None:
        if good is None:
            return None
        reason = "; ".join(["too little surface lies on surface to use it", *remarks])
        final = of_features(problem, good.fine, good.label, reason)
        return Answer(final, good.fine, largest_hidden_shift_m(good.fine.adjustment))
    findings: tuple[str, ...] = ()
    torn = False
    if good is None and attempts:
        refutation = refuted_by_own_surfaces(problem, attempts[0].fine, surfaces, options)
        if refutation is not None:
            remarks = [*remarks, refutation]
        else:
            good, apart_m = _nearest(attempts)
            noise_m = max(problem.target.noise_std_m, problem.source.noise_std_m)
            torn = apart_m > NOISES_APART * noise_m
            if torn and apart_m > allowed_m(problem):
                good, findings = None, (_contradiction(attempts[0]),)
            elif good.comparison is not None and apart_m > noise_m and _is_far_beyond_chance(good.comparison):
                findings = (_far_beyond_chance(good.comparison),)
    if good is not None and good.comparison is not None:
        if good.comparison.apart_m > allowed_m(problem):
            findings = *findings, _apart(good.comparison, allowed_m(problem))
        whole = joined(problem, good.fine, surfaces, good.comparison, good.label, torn=torn)
        final = replace(whole.final, reason="; ".join([whole.final.reason, *remarks]))
        hidden = max(hidden_shift_m(good.fine, whole), surfaces.hidden_shift_m)
        return Answer(final, good.fine, hidden, findings=findings)
    doubts = tuple(misfit_doubts([attempt.fine for attempt in attempts]))
    why = remarks or ["there are neither lines nor planes to adjust"]
    held = attempts[0].fine if (findings or doubts) and attempts else None
    final = of_surfaces(problem, surfaces, f"{'; '.join(why)}: so the surfaces alone, {surfaces.in_words()}", held=held)
    return Answer(final, None, surfaces.hidden_shift_m, doubts, findings)


def _nearest(attempts: list[_Attempt]) -> tuple[_Attempt, float]:
    """Give the features that are nearest to the surfaces, and how far they are apart [m]."""
    apart = [0.0 if attempt.comparison is None else attempt.comparison.apart_m for attempt in attempts]
    nearest = int(np.argmin(apart))
    return attempts[nearest], apart[nearest]


def _is_far_beyond_chance(comparison: Comparison) -> bool:
    """Say whether features and surfaces differ by so much more than they promise that neither promise holds."""
    return comparison.test.statistic > MOST_CONTRADICTION * comparison.test.critical


def _far_beyond_chance(comparison: Comparison) -> str:
    return (
        f"lines and planes contradict the surfaces far beyond chance ({in_words(comparison)}; "
        f"{MOST_CONTRADICTION:g} times the limit would be allowed): a large plane is off, or the scans differ by more "
        "than a motion, such as another scale of heights, which hardly shows in what they have in common"
    )


def _apart(comparison: Comparison, limit_m: float) -> str:
    return (
        f"lines and planes put the scan {comparison.apart_m * 1e3:.0f} mm from where the surfaces have it, more than "
        f"the {limit_m * 1e3:.0f} mm that are asked of a pose: that their standard deviations are as large is no "
        "agreement"
    )


def _contradiction(attempt: _Attempt) -> str:
    apart = 0.0 if attempt.comparison is None else attempt.comparison.apart_m
    return (
        f"lines and planes put the scan {apart * 1e3:.0f} mm from where the surfaces have it, and nothing tells which "
        "of the two is right"
    )
