"""The work of the method `targets`, and how targets join what else two scans have."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.errors import DegenerateGeometryError, TooFewCorrespondencesError
from algorithms.geometry.poses import PoseEstimate
from algorithms.matching.coarse_registration import CoarseRegistration
from algorithms.matching.options import MatchingOptions
from algorithms.matching.priors import PairPriors, StationPrior
from algorithms.progress import Progress
from algorithms.registration.base import FinalPose, PairResult, PairStatus, PosePart, RegistrationProblem, TargetFit
from algorithms.registration.final_pose import CONTRADICTION_ALPHA
from algorithms.registration.pose_fusion import FusionFrame, consistency, information_of_difference, joint_covariance
from algorithms.registration.target_fit import fitted_targets
from algorithms.registration.targets import TargetsMethod
from algorithms.registration.verdict import Answer, judged

NOISES_APART = 2.0
"""Up to so many standard deviations of single points targets and surfaces may differ significantly: so far off are
uneven surfaces. Their covariances are enlarged then, and it is said; farther apart the pose is doubtful."""


def register_by_targets(problem: RegistrationProblem, method: TargetsMethod, progress: Progress) -> PairResult:
    """Register two stations by their targets; every failure becomes a result with its status and reasons.

    Parameters
    ----------
    problem
        Both stations with their targets.
    method
        Options.
    progress
        Is told the steps.
    """
    progress.report(0.2, "matching")
    try:
        fit = fitted_targets(problem)
    except TooFewCorrespondencesError as error:
        return PairResult.without_pose(PairStatus.REJECTED, str(error))
    except DegenerateGeometryError as error:
        return replace(
            PairResult.without_pose(PairStatus.DEGENERATE, str(error)),
            free_directions=error.free_directions,
            advice=error.advice,
        )
    progress.report(0.8, "verification")
    return judged_by_targets(problem, fit, method.matching, fit_in_words(fit))


def targets_in_common(problem: RegistrationProblem) -> tuple[TargetFit | None, tuple[str, ...]]:
    """Adjust the targets of two stations where both have some; else say why they take no part.

    Parameters
    ----------
    problem
        Both stations.
    """
    if problem.target_points is None or problem.source_points is None:
        return None, ()
    try:
        return fitted_targets(problem), ()
    except (TooFewCorrespondencesError, DegenerateGeometryError) as error:
        return None, (f"targets take no part: {error}",)


def started_by_targets(problem: RegistrationProblem, fit: TargetFit) -> RegistrationProblem:
    """Let the search start from the pose of the targets, unless somebody chose another start.

    Parameters
    ----------
    problem
        Both stations.
    fit
        Their targets, which control each other.
    """
    known = problem.priors
    if known is not None and known.chosen_by is not None:
        return problem
    names = ("target", "source") if known is None else (known.target.name, known.source.name)
    origin = PoseEstimate(RigidTransform.identity(), np.zeros((6, 6)))
    levelled = (None, None) if known is None else (known.target.levelled_std_rad, known.source.levelled_std_rad)
    priors = PairPriors(
        StationPrior(names[0], levelled[0], origin), StationPrior(names[1], levelled[1], fit.pose), "the targets"
    )
    return replace(problem, priors=priors)


def judged_by_targets(
    problem: RegistrationProblem, fit: TargetFit, matching: MatchingOptions, reason: str
) -> PairResult:
    """Judge the pose that targets give alone.

    Parameters
    ----------
    problem
        Both stations.
    fit
        Their targets.
    matching
        Options of the verdict.
    reason
        Why they stand alone, in words.
    """
    final = FinalPose(
        pose=fit.pose.moved_to_origins(problem.target.origin_m, problem.source.origin_m),
        reduced=fit.pose,
        centred=fit.centred,
        centre_m=fit.centred.centroid + problem.target.origin_m,
        estimator="targets",
        reason=reason,
        parts=(PosePart("targets", 1.0),),
        feature_share=0.0,
        surfaces=None,
    )
    return judged(problem, unsearched(fit), Answer(final, None, 0.0, doubts_of(fit), targets=fit), matching)


def unsearched(fit: TargetFit) -> CoarseRegistration:
    """Say that no other pose was looked for."""
    return CoarseRegistration(
        target_from_source=fit.pose.target_from_source,
        support=int(fit.used.sum()),
        score=0.0,
        support_share=0.0,
        violation_share=0.0,
        overlap=0.0,
        runner_up=None,
        runner_up_score=0.0,
        runner_up_support=0,
        hypotheses_tested=1,
        free_space_known=True,
        ambiguous=False,
        reasons=(),
    )


def fit_in_words(fit: TargetFit) -> str:
    """Say which targets took part."""
    rms = float(np.sqrt(np.mean(np.sum(fit.residuals_m[fit.used] ** 2, axis=1))))
    words = f"{int(fit.used.sum())} of {len(fit.used)} common targets, rms {rms * 1e3:.1f} mm ({fit.reason})"
    left_out = [name for name, used in zip(fit.names, fit.used, strict=True) if not used]
    return words + (f"; left out as gross errors: {', '.join(left_out)}" if left_out else "")


def doubts_of(fit: TargetFit) -> tuple[str, ...]:
    """Say what speaks against the pose of targets."""
    failing = fit.used & (fit.tests.p_values < CONTRADICTION_ALPHA)
    if not failing.any():
        return ()
    names = ", ".join(name for name, fails in zip(fit.names, failing, strict=True) if fails)
    return (f"the targets contradict each other, and too few are left to say which is wrong: {names}",)


def with_targets(problem: RegistrationProblem, answer: Answer, fit: TargetFit) -> Answer:
    """Join targets with a pose of lines, planes and surfaces: independent data, tested against each other.

    Where they contradict each other by more than the scans' noise, the covariance holds both and the pose is doubtful.

    Parameters
    ----------
    problem
        Both stations.
    answer
        What lines, planes and surfaces give.
    fit
        What targets give.
    """
    final = answer.final
    frame = FusionFrame(final.reduced.target_from_source, final.centred)
    scans, targets = frame.information(final.reduced), frame.information(fit.pose)
    test = consistency(scans, targets, CONTRADICTION_ALPHA)
    seen = np.linalg.svd(information_of_difference(scans, targets))
    apart_m = float(np.linalg.norm(seen[0][:, seen[1] > 1e-12 * seen[1][0]].T @ (scans.motion_m - targets.motion_m)))
    figures = f"{apart_m * 1e3:.1f} mm apart, test value {test.statistic:.0f}, limit {test.critical:.0f}"
    scans, targets = (each.with_covariance_scaled(test.factor) for each in (scans, targets))
    parts = ((1.0, scans), (1.0, targets))
    estimate, covariance = frame.estimate(parts), joint_covariance(parts)
    noise_m = max(problem.target.noise_std_m, problem.source.noise_std_m)
    doubts = (*answer.doubts, *doubts_of(fit))
    agreement = "they agree"
    if test.contradicts and apart_m > NOISES_APART * noise_m:
        estimate = frame.holding_both(estimate, scans, targets)
        agreement = "they contradict each other, so the standard deviations hold both"
        contradiction = (
            f"targets and {final.estimator} contradict each other ({figures}): a target was moved or has a wrong name, "
            "or the scans lie in a wrong place"
        )
        doubts = (*doubts, contradiction)
    elif test.contradicts:
        agreement = f"they differ by more than chance, so all variances are {test.factor:.1f} times larger"
    rank = max(6 - estimate.null_space.shape[1], 1)
    share = float(np.trace(covariance @ targets.matrix)) / rank
    own = [PosePart(part.name, part.share * (1.0 - share)) for part in final.parts]
    reason = (
        f"targets give {share:.0%} of the information: {fit_in_words(fit)}; {agreement} (targets and "
        f"{final.estimator} {figures}); {final.reason}"
    )
    joined = replace(
        final,
        pose=estimate.moved_to_origins(problem.target.origin_m, problem.source.origin_m),
        reduced=estimate,
        estimator=f"{final.estimator}+targets",
        reason=reason,
        parts=tuple(sorted((*own, PosePart("targets", share)), key=lambda part: -part.share)),
        free_directions=() if estimate.null_space.shape[1] == 0 else final.free_directions,
        advice="" if estimate.null_space.shape[1] == 0 else final.advice,
        without_targets=final.reduced,
    )
    return replace(answer, final=joined, doubts=doubts, targets=fit, hidden_m=answer.hidden_m * (1.0 - share))
