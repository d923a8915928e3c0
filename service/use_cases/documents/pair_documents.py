"""What came out for two stations, as clients read it."""

import numpy as np

import algorithms.registration.base
from algorithms.adjustment.snooping import CorrespondenceState
from algorithms.arrays import Flags, Indices
from algorithms.features.photo_lines.projection_options import SpaceEdgeKind
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.angles import GON_PER_RAD
from algorithms.geometry.lines import LineSource
from algorithms.matching.coarse_registration import CoarseRegistration
from algorithms.quality.acceptance import Verification
from algorithms.registration.base import FineRegistration, PairResult
from schemas.results.adjustment_figures import RankReport, WeakDirection
from schemas.results.precision import Determined, Precision
from schemas.results.registration_result import (
    Coarse,
    Overlap,
    Pair,
    PhotoLineCounts,
    PosePart,
    UnexplainedSurface,
    UnusedPhotoLine,
    WrongMount,
)
from schemas.values.poses import Pose
from service.use_cases.documents.adjustment_documents import (
    accuracy_document,
    adjustment_document,
    free_directions,
    rank_document,
    rank_document_without_pose,
    weak_direction_documents,
)
from service.use_cases.documents.correspondence_documents import line_correspondences, outliers, plane_correspondences
from service.use_cases.documents.feature_names import line_name
from service.use_cases.documents.final_pose_documents import (
    final_rank_document,
    final_weak_directions,
    model_document,
    surface_document,
)
from service.use_cases.documents.own_figures_documents import own_figures_document
from service.use_cases.documents.place_documents import place_document
from service.use_cases.documents.pose_documents import matrix_rows, pose_document


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
    fine, final = result.fine, result.final
    return Pair(
        target=target,
        source=source,
        status=result.status.value,
        reasons=list(result.reasons),
        target_from_source=_pose(result, target, source),
        estimator=None if final is None else final.estimator,
        estimator_reason=None if final is None else final.reason,
        pose_parts=[] if final is None else [PosePart(name=part.name, share=part.share) for part in final.parts],
        surfaces=None if final is None or final.surfaces is None else surface_document(final.surfaces),
        model=None if result.rigidity is None else model_document(result.rigidity),
        place=None if result.place is None else place_document(result.place, target=target, source=source),
        determined=_determined(result),
        precision=None if result.precision is None else _precision(result.precision),
        coarse=None if result.coarse is None else _coarse(result.coarse),
        adjustment=None if fine is None else adjustment_document(fine),
        correspondences=[] if fine is None else line_correspondences(fine, target_features, target, source),
        plane_correspondences=[] if fine is None else plane_correspondences(fine, target_features, target, source),
        outliers=[] if fine is None else outliers(fine, target, source),
        accuracy=None if fine is None else accuracy_document(fine, result.rigorous or fine.pose, target_features),
        own_figures=own_figures_document(result, target=target, source=source),
        rank_report=_rank(result),
        weak_directions=_weak_directions(result),
        overlap=None if result.verification is None else _overlap(result.verification, target, source),
        timings_s=timings_s,
    )


def photo_line_counts(
    fine: FineRegistration | None,
    target_features: ScanFeatures,
    source_features: ScanFeatures,
    *,
    target: str,
    source: str,
) -> PhotoLineCounts | None:
    """Count the lines of photos that were found, matched, used and removed; None without photos.

    Parameters
    ----------
    fine
        The adjustment; None when it did not come so far.
    target_features, source_features
        Features of both stations.
    target, source
        Names of the stations.
    """
    if target_features.photo_edges is None and source_features.photo_edges is None:
        return None
    pairs = np.empty((0, 2), dtype=np.int64) if fine is None else fine.lines
    removed = np.zeros(0, dtype=bool)
    if fine is not None:
        removed = fine.adjustment.lines.states == int(CorrespondenceState.REMOVED)
    of_photos = [side.lines.sources == int(LineSource.PHOTO_EDGE) for side in (target_features, source_features)]
    from_photo = of_photos[0][pairs[:, 0]] | of_photos[1][pairs[:, 1]]
    return PhotoLineCounts(
        target_found=int(of_photos[0].sum()),
        source_found=int(of_photos[1].sum()),
        matched=int(from_photo.sum()),
        used=int((from_photo & ~removed).sum()),
        removed=int((from_photo & removed).sum()),
        unused=[
            *_unused(target, target_features, pairs[:, 0], removed),
            *_unused(source, source_features, pairs[:, 1], removed),
        ],
        wrong_mounts=[] if fine is None else _wrong_mounts(fine, target, source),
    )


def _wrong_mounts(fine: FineRegistration, target: str, source: str) -> list[WrongMount]:
    """List the mounts that contradict the lines."""
    return [
        WrongMount(
            station=(target, source)[mount.photo[0]],
            photo=mount.photo[1],
            rotation_gon=mount.turn_rad * GON_PER_RAD,
            rotation_std_gon=mount.turn_std_rad * GON_PER_RAD,
            translation_m=mount.shift_m,
            statistic=mount.statistic,
            critical=mount.critical,
            global_statistic=mount.omega,
            global_critical=mount.omega_critical,
        )
        for mount in fine.adjustment.mount_errors
    ]


def _unused(station: str, features: ScanFeatures, matched: Indices, removed: Flags) -> list[UnusedPhotoLine]:
    """List the lines of a station's photos that were removed or not matched."""
    photos, edges = features.lines.photos, features.photo_edges
    if photos is None or edges is None:
        return []
    states = np.full(len(features.lines), "unmatched", dtype=object)
    states[matched] = np.where(removed, "removed", "used")
    unused = np.flatnonzero((features.lines.sources == int(LineSource.PHOTO_EDGE)) & (states != "used"))
    return [
        UnusedPhotoLine(
            line=f"{station}/{line_name(k)}",
            photo=int(photos[k]),
            surface=SpaceEdgeKind(int(edges.line_kinds[k])).label,
            state=str(states[k]),
        )
        for k in unused.tolist()
    ]


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


def _pose(result: PairResult, target: str, source: str) -> Pose | None:
    """Describe the pose: that of a method which joins estimates, else that of the adjustment."""
    fine, final = result.fine, result.final
    if final is not None:
        a_posteriori = final.surfaces is not None or (fine is not None and fine.adjustment.variance_factor > 1.0)
        return pose_document(
            final.pose, target=target, source=source, centroid_m=final.centre_m, a_posteriori=a_posteriori
        )
    if fine is None:
        return None
    return pose_document(
        fine.pose,
        target=target,
        source=source,
        centroid_m=fine.centroid_m,
        a_posteriori=fine.adjustment.variance_factor > 1.0,
    )


def _weak_directions(result: PairResult) -> list[WeakDirection]:
    """List what is free and what is badly determined."""
    if result.final is not None:
        return final_weak_directions(result.final)
    if result.fine is not None:
        return weak_direction_documents(result.fine.adjustment)
    return free_directions(result.free_directions, result.advice)


def _determined(result: PairResult) -> Determined | None:
    """Describe what is determined of the pose that is given."""
    report = _rank(result)
    if report is None or report.rank is None:
        return None
    return Determined(rank=report.rank, free=[motion.text for motion in report.null_space], advice=report.advice)


def _precision(found: algorithms.registration.base.Precision) -> Precision:
    return Precision(
        tolerance_m=found.allowed_m,
        tolerance_stated=found.is_stated,
        kept=found.is_kept,
        centre_std_m=found.centre_std_m,
        far_m=found.far_m,
        far_std_m=found.far_std_m,
        std_gon=found.turn_std_rad * GON_PER_RAD,
        undetected_m=found.hidden_m if np.isfinite(found.hidden_m) else None,
        findings=list(found.findings),
    )


def _rank(result: PairResult) -> RankReport | None:
    if result.final is not None:
        return final_rank_document(result.final)
    if result.fine is not None:
        return rank_document(result.fine.adjustment, result.fine)
    return rank_document_without_pose(result.free_directions, result.advice) if result.free_directions else None


def _overlap(verification: Verification, target: str, source: str) -> Overlap:
    return Overlap(
        fraction_0_5m=verification.overlap_half_metre,
        fraction_0_1m=verification.overlap_decimetre,
        rms_m=verification.rms_m if verification.overlap_decimetre > 0.0 else None,
        free_space_violations=verification.violation_share if verification.free_space_known else None,
        unexplained=[
            UnexplainedSurface(
                station=target if piece.in_target else source,
                centre_m=(float(piece.centre_m[0]), float(piece.centre_m[1]), float(piece.centre_m[2])),
                area_m2=piece.area_m2,
                range_m=piece.range_m,
            )
            for piece in verification.unexplained
        ],
    )
