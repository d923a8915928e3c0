"""Figures of the adjustment of one pair, as clients read them."""

import math
from collections.abc import Sequence
from typing import cast

import numpy as np

from algorithms.adjustment.critical_values import b_method_limit
from algorithms.adjustment.line_adjustment import LineAdjustment
from algorithms.adjustment.snooping import CorrespondenceState
from algorithms.adjustment.testing import GlobalTest as TestOfVariance
from algorithms.adjustment.testing import GlobalVerdict
from algorithms.arrays import Array
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.angles import GON_PER_RAD
from algorithms.geometry.lines import LineSource
from algorithms.geometry.poses import PoseEstimate
from algorithms.quality.accuracy import accuracy_figures
from algorithms.registration.base import FineRegistration
from schemas.results.adjustment_figures import (
    Accuracy,
    Adjustment,
    FreeMotion,
    GlobalTest,
    LineCounts,
    PrincipalMotion,
    RankReport,
    TestLevels,
    WeakDirection,
)
from schemas.results.correspondences import Triple
from schemas.values.poses import Row6
from service.use_cases.documents.correspondence_documents import largest_effects

MEANINGS = {
    GlobalVerdict.ACCEPTED: "the residuals are as large as the scans' own noise explains",
    GlobalVerdict.TOO_LARGE: "the residuals are larger than the scans' own noise explains: a gross error is left, "
    "surfaces are uneven, or the a-priori standard deviations promise too much",
    GlobalVerdict.TOO_SMALL: "the residuals are smaller than the a-priori standard deviations promise: those are "
    "pessimistic",
}


def adjustment_document(fine: FineRegistration) -> Adjustment:
    """Describe the adjustment and its tests."""
    adjustment = fine.adjustment
    options = adjustment.options
    return Adjustment(
        model="gauss-helmert-lines-planes" if len(fine.planes) else "gauss-helmert-lines",
        datum="the target scan is fixed, the source scan moves",
        observations=adjustment.observation_count,
        independent_observations=adjustment.independent_condition_count,
        unknowns=6,
        defect=6 - adjustment.rank,
        rank=adjustment.rank,
        redundancy=adjustment.redundancy,
        sigma0_prior=1.0,
        sigma0=adjustment.sigma0,
        variance_factor=adjustment.variance_factor,
        iterations=adjustment.iterations,
        converged=adjustment.converged,
        global_test=global_test_document(adjustment.global_test),
        levels=TestLevels(
            confidence_level=1.0 - options.alpha_global,
            alpha_single=options.alpha_single,
            power=options.power,
            normalised_critical=adjustment.w_critical,
            tau_critical=adjustment.tau_critical,
            line_critical=adjustment.t_critical,
            b_method_alpha=b_method_limit(4, options.alpha_single, options.power).alpha,
        ),
        test_variance_factor=adjustment.test_variance_factor,
        largest_external_effects=largest_effects(fine),
    )


def rank_document(adjustment: LineAdjustment, fine: FineRegistration) -> RankReport:
    """Describe what is determined and what is free; standard deviations as those of the pose beside it."""
    scale = math.sqrt(adjustment.variance_factor)
    ratio = adjustment.ghost_ratio
    return RankReport(
        rank=adjustment.rank,
        expected=6,
        null_space=[
            FreeMotion(text=text, vector=cast("Row6", _numbers(column)))
            for text, column in zip(adjustment.free_directions, fine.pose.null_space.T, strict=True)
        ],
        advice=adjustment.advice,
        weakest_shift_ratio=ratio if math.isfinite(ratio) else None,
        features_radius_m=adjustment.radius_m,
        determined=[
            PrincipalMotion(
                text=motion.text,
                std_m=motion.std_m * scale,
                turn=cast("Triple", _numbers(motion.turn)),
                shift=cast("Triple", _numbers(motion.shift)),
            )
            for motion in adjustment.principal_motions
        ],
    )


def rank_document_without_pose(free_directions: Sequence[str], advice: str) -> RankReport:
    """Describe what the geometry of one scan leaves free before any pose is looked for."""
    return RankReport(
        rank=None,
        expected=6,
        null_space=[FreeMotion(text=text, vector=None) for text in free_directions],
        advice=advice,
        weakest_shift_ratio=None,
        features_radius_m=None,
        determined=[],
    )


def accuracy_document(fine: FineRegistration, pose: PoseEstimate, target_features: ScanFeatures) -> Accuracy:
    """Summarise under the names of the dissertation's tables.

    Parameters
    ----------
    fine
        The adjustment.
    pose
        Its pose between full coordinates, which for methods with an estimator of their own is not `fine.pose`.
    target_features
        Features of the target scan; they tell what kind each line is.
    """
    adjustment, report = fine.adjustment, fine.adjustment.lines
    used = report.states != int(CorrespondenceState.REMOVED)
    figures = accuracy_figures(
        pose,
        used=used,
        angles_rad=report.angles_rad,
        shortest_distances_m=report.shortest_distances_m,
        offsets_m=report.offsets_m,
        normalised=report.w * math.sqrt(adjustment.test_variance_factor),
        controlled=report.controlled.astype(np.float64),
        sigma0=adjustment.sigma0,
    )
    kinds = target_features.lines.sources[fine.lines[:, 0]][used]
    return Accuracy(
        mean_std_rotation_gon=_gon(figures.mean_std_rotation_rad),
        max_std_rotation_gon=_gon(figures.max_std_rotation_rad),
        mean_std_translation_m=figures.mean_std_translation_m,
        max_std_translation_m=figures.max_std_translation_m,
        max_angle_gon=_gon(figures.max_angle_rad),
        max_distance_m=figures.max_shortest_distance_m,
        max_offset_m=figures.max_offset_m,
        max_normalised=figures.max_normalised,
        share_normalised_beyond_1_96=figures.share_beyond_196,
        sigma0=adjustment.sigma0,
        iterations=adjustment.iterations,
        lines=LineCounts(
            plane_intersections=int((kinds == LineSource.PLANE_INTERSECTION).sum()),
            cylinder_axes=int((kinds == LineSource.CYLINDER_AXIS).sum()),
            photo_edges=int((kinds == LineSource.PHOTO_EDGE).sum()),
            removed=int((~used).sum()),
        ),
    )


def free_directions(directions: Sequence[str], advice: str) -> list[WeakDirection]:
    """List what is free: no standard deviation."""
    return [WeakDirection(text=text, std_m=None, advice=advice) for text in directions]


def weak_direction_documents(adjustment: LineAdjustment) -> list[WeakDirection]:
    """List what is free and what is badly determined."""
    free = free_directions(adjustment.free_directions, adjustment.advice)
    scale = math.sqrt(adjustment.variance_factor)  # as the standard deviations of the pose beside it
    return free + [WeakDirection(text=w.description, std_m=w.std_m * scale, advice=w.advice) for w in adjustment.weak]


def global_test_document(test: TestOfVariance) -> GlobalTest | None:
    """Describe the global test; None where nothing is left to test by."""
    if test.verdict is GlobalVerdict.NOT_TESTABLE:
        return None
    return GlobalTest(
        statistic=test.omega,
        degrees_of_freedom=test.redundancy,
        lower=test.lower,
        upper=test.upper,
        alpha=test.alpha,
        passed=test.verdict is GlobalVerdict.ACCEPTED,
        side=test.verdict.value,
        meaning=MEANINGS[test.verdict],
    )


def _gon(angle_rad: float | None) -> float | None:
    return None if angle_rad is None else angle_rad * GON_PER_RAD


def _numbers(vector: Array) -> tuple[float, ...]:
    return tuple(float(value) for value in vector)
