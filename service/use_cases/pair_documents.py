"""What came out for two stations, as clients read it."""

from algorithms.adjustment.snooping import CorrespondenceState
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.lines import LineSource
from algorithms.matching.coarse_registration import CoarseRegistration
from algorithms.quality.acceptance import Verification
from algorithms.registration.base import FineRegistration, PairResult
from schemas.adjustment_figures import RankReport
from schemas.registration_result import Coarse, Overlap, Pair, PhotoLineCounts
from service.use_cases.adjustment_documents import (
    accuracy_document,
    adjustment_document,
    free_directions,
    rank_document,
    rank_document_without_pose,
    weak_direction_documents,
)
from service.use_cases.correspondence_documents import line_correspondences, outliers, plane_correspondences
from service.use_cases.own_figures_documents import own_figures_document
from service.use_cases.pose_documents import matrix_rows, pose_document


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
        adjustment=None if fine is None else adjustment_document(fine),
        correspondences=[] if fine is None else line_correspondences(fine, target_features, target, source),
        plane_correspondences=[] if fine is None else plane_correspondences(fine, target_features, target, source),
        outliers=[] if fine is None else outliers(fine, target, source),
        accuracy=None if fine is None else accuracy_document(fine, result.rigorous or fine.pose, target_features),
        own_figures=own_figures_document(result, target=target, source=source),
        rank_report=_rank(result),
        weak_directions=free_directions(result.free_directions, result.advice)
        if fine is None
        else weak_direction_documents(fine.adjustment),
        overlap=None if result.verification is None else _overlap(result.verification),
        timings_s=timings_s,
    )


def photo_line_counts(
    fine: FineRegistration | None, target: ScanFeatures, source: ScanFeatures
) -> PhotoLineCounts | None:
    """Count the lines of photos that were found, matched, used and removed; None without photos.

    Parameters
    ----------
    fine
        The adjustment; None when it did not come so far.
    target, source
        Features of both stations.
    """
    if target.photo_edges is None and source.photo_edges is None:
        return None
    of_photos = [side.lines.sources == int(LineSource.PHOTO_EDGE) for side in (target, source)]
    matched = removed = 0
    if fine is not None:
        from_photo = of_photos[0][fine.lines[:, 0]] | of_photos[1][fine.lines[:, 1]]
        states = fine.adjustment.lines.states[from_photo]
        matched, removed = int(from_photo.sum()), int((states == int(CorrespondenceState.REMOVED)).sum())
    return PhotoLineCounts(
        target_found=int(of_photos[0].sum()),
        source_found=int(of_photos[1].sum()),
        matched=matched,
        used=matched - removed,
        removed=removed,
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


def _rank(result: PairResult) -> RankReport | None:
    if result.fine is not None:
        return rank_document(result.fine.adjustment, result.fine)
    return rank_document_without_pose(result.free_directions, result.advice) if result.free_directions else None


def _overlap(verification: Verification) -> Overlap:
    return Overlap(
        fraction_0_5m=verification.overlap_half_metre,
        fraction_0_1m=verification.overlap_decimetre,
        rms_m=verification.rms_m if verification.overlap_decimetre > 0.0 else None,
        free_space_violations=verification.violation_share if verification.free_space_known else None,
    )
