"""Figures of a pose that lines, planes and surfaces gave together, as clients read them."""

from typing import cast

import numpy as np

from algorithms.adjustment.principal_motions import principal_motions
from algorithms.adjustment.rank import WEAK_STD_RATIO
from algorithms.registration.base import FinalPose
from algorithms.registration.deformed_fit import DeformationKind
from algorithms.registration.rigidity import Rigidity, Stretch
from algorithms.registration.surface_estimate import SurfaceEstimate
from schemas.results.adjustment_figures import FreeMotion, PrincipalMotion, RankReport, WeakDirection
from schemas.results.correspondences import Triple
from schemas.results.registration_result import ModelParameter, ModelTests, SurfaceFigures
from schemas.values.poses import Row6

PARAMETERS = 6


def surface_document(surfaces: SurfaceEstimate) -> SurfaceFigures:
    """Describe the estimate by surfaces alone."""
    open_ = surfaces.pose.null_space.shape[1] > 0
    motions = principal_motions(surfaces.pose, surfaces.centre_m, surfaces.radius_m)
    return SurfaceFigures(
        distances=surfaces.gap_count,
        spread_m=surfaces.spread_m,
        neighbourhoods=surfaces.neighbourhoods,
        neighbourhood_m=surfaces.neighbourhood_m,
        largest_std_m=None if open_ or not motions else motions[0].std_m,
        hidden_shift_m=surfaces.hidden_shift_m,
        iterations=surfaces.iterations,
        converged=surfaces.converged,
    )


def model_document(tested: Rigidity) -> ModelTests:
    """Describe whether two scans differ by more than a motion."""
    return ModelTests(
        rigid=tested.kind is None,
        scale=_parameter(tested.scale, tested.kind is DeformationKind.SCALE),
        stretch=_parameter(tested.stretch, tested.kind is DeformationKind.STRAIN),
        bend=tested.kind is DeformationKind.BEND,
        more_surface_fits=tested.gain,
        instrument_shift_m=tested.moved_m,
    )


def _parameter(found: Stretch | None, significant: bool) -> ModelParameter:
    if found is None:
        return ModelParameter(value=None, std=None, significant=False)
    return ModelParameter(
        value=found.value, std=found.std, significant=significant, direction_in_source=found.direction_in_source
    )


def final_rank_document(final: FinalPose) -> RankReport:
    """Describe what features and surfaces together determine and leave free."""
    columns = final.pose.null_space.T
    return RankReport(
        rank=PARAMETERS - len(columns),
        expected=PARAMETERS,
        null_space=[
            FreeMotion(text=text, vector=cast("Row6", tuple(float(value) for value in column)))
            for text, column in zip(final.free_directions, columns, strict=True)
        ],
        advice=final.advice,
        weakest_shift_ratio=None,
        features_radius_m=final.centred.radius_m,
        determined=[
            PrincipalMotion(
                text=motion.text,
                std_m=motion.std_m,
                turn=cast("Triple", tuple(float(value) for value in motion.turn)),
                shift=cast("Triple", tuple(float(value) for value in motion.shift)),
            )
            for motion in principal_motions(final.reduced, final.centred.centroid, final.centred.radius_m)
        ],
    )


def final_weak_directions(final: FinalPose) -> list[WeakDirection]:
    """List what is free, and what is known much worse than the rest."""
    found = [WeakDirection(text=text, std_m=None, advice=final.advice) for text in final.free_directions]
    motions = principal_motions(final.reduced, final.centred.centroid, final.centred.radius_m)
    if not motions:
        return found
    limit = WEAK_STD_RATIO * float(np.median([motion.std_m for motion in motions]))
    return found + [
        WeakDirection(text=motion.text, std_m=motion.std_m, advice="add surfaces or lines that stand across it")
        for motion in motions
        if motion.std_m > limit
    ]
