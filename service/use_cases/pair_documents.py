"""What came out for two stations, as clients read it."""

import math
from collections.abc import Sequence

import numpy as np

from algorithms.adjustment.external_reliability import largest_effect
from algorithms.adjustment.line_adjustment import LineAdjustment
from algorithms.adjustment.snooping import CorrespondenceState
from algorithms.adjustment.testing import GlobalVerdict
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.angles import GON_PER_RAD
from algorithms.geometry.lines import LineSource
from algorithms.matching.coarse_registration import CoarseRegistration
from algorithms.quality.acceptance import Verification
from algorithms.registration.base import FineRegistration, PairResult
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
    PlaneCorrespondence,
    WeakDirection,
)
from service.use_cases.pose_documents import matrix_rows, pose_document
from service.use_cases.run_lines_report import line_name, plane_name

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
    fine = result.fine
    return Pair(
        target=target,
        source=source,
        status=result.status.value,
        reasons=list(result.reasons),
        target_from_source=None
        if fine is None
        else pose_document(
            fine.pose,
            target=target,
            source=source,
            centroid_m=fine.centroid_m,
            a_posteriori=fine.adjustment.variance_factor > 1.0,
        ),
        coarse=None if result.coarse is None else _coarse(result.coarse),
        adjustment=None if fine is None else _adjustment(fine),
        correspondences=[] if fine is None else _correspondences(fine, target_features, target, source),
        plane_correspondences=[] if fine is None else _plane_correspondences(fine, target, source),
        outliers=[] if fine is None else _outliers(fine.adjustment, target, source),
        accuracy=None if fine is None else _accuracy(fine),
        weak_directions=_free(result.free_directions, result.advice) if fine is None else _weak(fine.adjustment),
        overlap=None if result.verification is None else _overlap(result.verification),
        timings_s=timings_s,
    )


def _coarse(coarse: CoarseRegistration) -> Coarse:
    return Coarse(
        target_from_source=matrix_rows(coarse.target_from_source),
        support=coarse.support,
        score=coarse.score,
        runner_up_score=None if coarse.runner_up is None else coarse.runner_up_score,
        runner_up_support=None if coarse.runner_up is None else coarse.runner_up_support,
        runner_up_target_from_source=None if coarse.runner_up is None else matrix_rows(coarse.runner_up),
        hypotheses_tested=coarse.hypotheses_tested,
    )


def _adjustment(fine: FineRegistration) -> Adjustment:
    adjustment, test = fine.adjustment, fine.adjustment.global_test
    return Adjustment(
        model="gauss-helmert-lines-planes" if len(fine.planes) else "gauss-helmert-lines",
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
            passed=test.verdict is GlobalVerdict.ACCEPTED,
        ),
        test_variance_factor=adjustment.test_variance_factor,
        largest_external_effects=_largest_effects(fine),
    )


def _largest_effects(fine: FineRegistration) -> dict[str, float]:
    lines, planes = fine.adjustment.lines, fine.adjustment.planes
    motions = np.vstack([lines.effects.reshape(-1, 6), planes.effects.reshape(-1, 6)])
    global_ = np.concatenate([lines.global_effects.ravel(), planes.global_effects.ravel()])
    largest = largest_effect(motions, global_, fine.pose.target_from_source, fine.centroid_m)
    scale = [GON_PER_RAD, GON_PER_RAD, GON_PER_RAD, 1.0, 1.0, 1.0]
    names = ("omega_gon", "phi_gon", "kappa_gon", "tx_m", "ty_m", "tz_m")
    return {name: float(value) for name, value in zip(names, largest.parameters * scale, strict=True)}


def _correspondences(
    fine: FineRegistration, target_features: ScanFeatures, target: str, source: str
) -> list[Correspondence]:
    report = fine.adjustment.lines
    out = []
    for k, (i, j) in enumerate(fine.lines):
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
                state=STATE_NAMES[CorrespondenceState(int(report.states[k]))],
            )
        )
    return out


def _plane_correspondences(fine: FineRegistration, target: str, source: str) -> list[PlaneCorrespondence]:
    report = fine.adjustment.planes
    return [
        PlaneCorrespondence(
            target_plane=f"{target}/{plane_name(int(i))}",
            source_plane=f"{source}/{plane_name(int(j))}",
            angle_gon=float(report.angles_rad[k]) * GON_PER_RAD,
            distance_m=abs(float(report.offsets_m[k])),
            statistic=float(report.statistics[k]),
            degrees_of_freedom=float(report.degrees[k]),
            state=STATE_NAMES[CorrespondenceState(int(report.states[k]))],
        )
        for k, (i, j) in enumerate(fine.planes)
    ]


def _outliers(adjustment: LineAdjustment, target: str, source: str) -> list[Outlier]:
    names = {"line": line_name, "plane": plane_name}
    return [
        Outlier(
            line=f"{target}/{names[removal.kind](removal.target_number)} – "
            f"{source}/{names[removal.kind](removal.source_number)}",
            kind=removal.kind,
            step=removal.step,
            statistic=removal.statistic,
            change=removal.change.value,
            why=removal.reason,
        )
        for removal in adjustment.removals
    ]


def _accuracy(fine: FineRegistration) -> Accuracy:
    rotation = [s for s in fine.pose.omega_phi_kappa_std_rad if s is not None]
    shift = [s for s in fine.pose.translation_std_m if s is not None]
    report = fine.adjustment.lines
    used = report.states != int(CorrespondenceState.REMOVED)
    return Accuracy(
        mean_std_rotation_gon=sum(rotation) / 3.0 * GON_PER_RAD if len(rotation) == 3 else None,
        mean_std_translation_m=sum(shift) / 3.0 if len(shift) == 3 else None,
        max_angle_gon=float(report.angles_rad[used].max()) * GON_PER_RAD if used.any() else None,
        max_distance_m=float(np.linalg.norm(report.offsets_m[used], axis=1).max()) if used.any() else None,
    )


def _free(directions: Sequence[str], advice: str) -> list[WeakDirection]:
    return [WeakDirection(text=text, std_m=None, advice=advice) for text in directions]


def _weak(adjustment: LineAdjustment) -> list[WeakDirection]:
    free = _free(adjustment.free_directions, adjustment.advice)
    scale = math.sqrt(adjustment.variance_factor)  # as the standard deviations of the pose beside it
    return free + [WeakDirection(text=w.description, std_m=w.std_m * scale, advice=w.advice) for w in adjustment.weak]


def _overlap(verification: Verification) -> Overlap:
    return Overlap(
        fraction_0_5m=verification.overlap_half_metre,
        fraction_0_1m=verification.overlap_decimetre,
        rms_m=verification.rms_m if verification.overlap_decimetre > 0.0 else None,
        free_space_violations=verification.violation_share if verification.free_space_known else None,
    )
