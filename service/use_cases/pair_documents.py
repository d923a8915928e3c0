"""What came out for two stations, as clients read it."""

import math

from algorithms.matching.matching import CoarseRegistration
from algorithms.quality.acceptance import Verification

from algorithms.adjustment.line_adjustment import LineAdjustment
from algorithms.adjustment.snooping import Change, CorrespondenceState
from algorithms.adjustment.testing import GlobalVerdict
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.angles import GON_PER_RAD
from algorithms.geometry.lines import LineSource
from algorithms.registration.base import PairResult
from schemas.registration_result import (
    Accuracy,
    Adjustment,
    Coarse,
    Correspondence,
    GlobalTest,
    LineTest,
    Outlier,
    Overlap,
    Pair,
    WeakDirection,
)
from service.use_cases.pose_documents import matrix_rows, pose_document
from service.use_cases.run_lines_report import line_name

STATE_NAMES = {
    CorrespondenceState.USED: "used",
    CorrespondenceState.REMOVED: "removed",
    CorrespondenceState.REINSTATED: "reinstated",
    CorrespondenceState.NOT_CONTROLLED: "not-controlled",
}


def pair_document(
    result: PairResult, target_features: ScanFeatures, *, target: str, source: str, timings_s: dict[str, float]
) -> Pair:
    """Describe the result of one pair.

    Parameters
    ----------
    result
        Of the registration method.
    target_features
        Features of the target scan; they tell what kind each line is.
    target, source
        Names of the stations.
    timings_s
        Seconds of each part.
    """
    adjustment = result.adjustment
    pose = None
    if result.pose is not None:
        pose = pose_document(
            result.pose,
            target=target,
            source=source,
            centroid_m=result.centroid_m,
            a_posteriori=adjustment is not None and adjustment.variance_factor > 1.0,
        )
    return Pair(
        target=target,
        source=source,
        status=result.status.value,
        reasons=list(result.reasons),
        target_from_source=pose,
        coarse=None if result.coarse is None else _coarse(result.coarse),
        adjustment=None if adjustment is None else _adjustment(adjustment),
        correspondences=_correspondences(result, target_features, target, source),
        outliers=_outliers(result, target, source),
        accuracy=None if adjustment is None else _accuracy(result, adjustment),
        weak_directions=[] if adjustment is None else _weak(adjustment),
        overlap=None if result.verification is None else _overlap(result.verification),
        timings_s=timings_s,
    )


def _coarse(coarse: CoarseRegistration) -> Coarse:
    return Coarse(
        target_from_source=matrix_rows(coarse.target_from_source),
        support=coarse.support,
        runner_up_support=coarse.runner_up_support,
        runner_up_target_from_source=None if coarse.runner_up is None else matrix_rows(coarse.runner_up),
        hypotheses_tested=coarse.hypotheses_tested,
    )


def _adjustment(adjustment: LineAdjustment) -> Adjustment:
    test = adjustment.global_test
    return Adjustment(
        model="gauss-helmert-lines",
        observations=adjustment.observation_count,
        independent_observations=adjustment.independent_condition_count,
        unknowns=6,
        rank=adjustment.rank,
        redundancy=adjustment.redundancy,
        sigma0_prior=1.0,
        sigma0=adjustment.sigma0,
        iterations=adjustment.iterations,
        converged=adjustment.converged,
        global_test=None
        if adjustment.redundancy == 0
        else GlobalTest(
            statistic=test.omega,
            lower=test.lower,
            upper=test.upper,
            alpha=test.alpha,
            passed=test.verdict is GlobalVerdict.PASSED,
        ),
    )


def _correspondences(
    result: PairResult, target_features: ScanFeatures, target: str, source: str
) -> list[Correspondence]:
    adjustment = result.adjustment
    if adjustment is None:
        return []
    report = adjustment.lines
    out = []
    for k, (i, j) in enumerate(result.correspondences):
        degrees = float(report.degrees[k])
        out.append(
            Correspondence(
                target_line=f"{target}/{line_name(int(i))}",
                source_line=f"{source}/{line_name(int(j))}",
                source=LineSource(int(target_features.lines.sources[i])).label,
                angle_gon=float(report.angles_rad[k]) * GON_PER_RAD,
                distance_m=float(math.hypot(*report.offsets_m[k])),
                residuals=[float(v) for v in report.residuals[k]],
                normalised=[
                    float(w) if good else None for w, good in zip(report.w[k], report.controlled[k], strict=True)
                ],
                redundancy=float(report.redundancy[k].sum()),
                test=None
                if degrees < 1
                else LineTest(
                    statistic=float(report.statistics[k]),
                    degrees_of_freedom=degrees,
                    critical=float(report.critical[k]),
                ),
                mdb=[
                    float(m) if good else None
                    for m, good in zip(report.detectable[k], report.controlled[k], strict=True)
                ],
                external_effect=None,
                state=STATE_NAMES[CorrespondenceState(int(report.states[k]))],
            )
        )
    return out


def _outliers(result: PairResult, target: str, source: str) -> list[Outlier]:
    if result.adjustment is None:
        return []
    return [
        Outlier(
            line=f"{target}/{line_name(removal.target_line)} – {source}/{line_name(removal.source_line)}",
            step=removal.step,
            statistic=removal.statistic,
            change=removal.change.value,
            why=removal.reason,
        )
        for removal in result.adjustment.removals
        if removal.change in {Change.REMOVED, Change.REINSTATED}
    ]


def _accuracy(result: PairResult, adjustment: LineAdjustment) -> Accuracy:
    pose = result.pose
    rotation = [] if pose is None else [s for s in pose.omega_phi_kappa_std_rad if s is not None]
    shift = [] if pose is None else [s for s in pose.translation_std_m if s is not None]
    used = adjustment.lines.states != int(CorrespondenceState.REMOVED)
    angles, offsets = adjustment.lines.angles_rad[used], adjustment.lines.offsets_m[used]
    return Accuracy(
        mean_std_rotation_gon=sum(rotation) / 3.0 * GON_PER_RAD if len(rotation) == 3 else None,
        mean_std_translation_m=sum(shift) / 3.0 if len(shift) == 3 else None,
        max_angle_gon=float(angles.max()) * GON_PER_RAD,
        max_distance_m=float(math.sqrt((offsets**2).sum(axis=1).max())),
    )


def _weak(adjustment: LineAdjustment) -> list[WeakDirection]:
    free = [WeakDirection(text=text, std_m=None, advice=adjustment.advice) for text in adjustment.free_directions]
    return free + [WeakDirection(text=w.description, std_m=w.std_m, advice=w.advice) for w in adjustment.weak]


def _overlap(verification: Verification) -> Overlap:
    return Overlap(
        fraction_0_5m=verification.overlap_half_metre,
        fraction_0_1m=verification.overlap_decimetre,
        rms_m=verification.rms_m,
        free_space_violations=verification.violation_share,
    )
