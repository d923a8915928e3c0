"""What became of each pair of lines and planes, as clients read it."""

from collections.abc import Callable, Mapping
from typing import Any, cast

import numpy as np

from algorithms.adjustment.external_reliability import largest_effect
from algorithms.adjustment.gross_errors import Partner
from algorithms.adjustment.line_adjustment import LineAdjustment
from algorithms.adjustment.removals import Removal as RemovalStep
from algorithms.adjustment.reports import CorrespondenceReport
from algorithms.adjustment.snooping import Change, CorrespondenceState
from algorithms.arrays import Array, Vector3
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.angles import GON_PER_RAD
from algorithms.geometry.lines import LineSource
from algorithms.geometry.pose_parameters import pose_parameters
from algorithms.registration.base import FineRegistration
from schemas.results.correspondences import (
    Correspondence,
    ExternalEffect,
    FeatureTest,
    Inseparable,
    Outlier,
    PlaneCorrespondence,
    Removal,
    Triple,
)
from service.use_cases.documents.feature_names import line_name, plane_name
from service.use_cases.documents.pose_documents import PARAMETERS

STATE_NAMES = {
    CorrespondenceState.USED: "used",
    CorrespondenceState.REMOVED: "removed",
    CorrespondenceState.REINSTATED: "reinstated",
    CorrespondenceState.NOT_CONTROLLED: "not-controlled",
}


def line_correspondences(
    fine: FineRegistration, target_features: ScanFeatures, target: str, source: str
) -> list[Correspondence]:
    """Describe all pairs of lines.

    Parameters
    ----------
    fine
        The adjusted pose and what it rests on.
    target_features
        Features of the target scan.
    target, source
        Names of the stations.
    """
    report, lines = fine.adjustment.lines, target_features.lines
    tested, names = _tested(fine, report, 0, target, source), _names(fine, target, source)
    out = []
    for k, (i, _) in enumerate(fine.lines):
        removed = report.states[k] == CorrespondenceState.REMOVED
        target_line, source_line = names(k).split(" – ")
        out.append(
            Correspondence(
                **tested(k),
                target_line=target_line,
                source_line=source_line,
                source=LineSource(int(lines.sources[i])).label,
                distance_m=float(np.linalg.norm(report.offsets_m[k])),
                shortest_distance_m=float(report.shortest_distances_m[k]),
                at_m=_triple(report.middles_m[k] + target_features.origin_m),
                basis=(_triple(lines.bases[i, :, 0]), _triple(lines.bases[i, :, 1])),
                tilt_gon=_pair(report.tilts_rad[k] * GON_PER_RAD),
                offset_mm=_pair(report.offsets_m[k] * 1e3),
                offset_covariance_mm2=None
                if removed
                else (_pair(report.offset_covariances[k, 0] * 1e6), _pair(report.offset_covariances[k, 1] * 1e6)),
            )
        )
    return out


def plane_correspondences(
    fine: FineRegistration, target_features: ScanFeatures, target: str, source: str
) -> list[PlaneCorrespondence]:
    """Describe all pairs of planes; parameters as `line_correspondences`."""
    report, planes = fine.adjustment.planes, target_features.planes
    first = len(fine.lines)
    tested, names = _tested(fine, report, first, target, source), _names(fine, target, source)
    out = []
    for k, (i, _) in enumerate(fine.planes):
        target_plane, source_plane = names(first + k).split(" – ")
        out.append(
            PlaneCorrespondence(
                **tested(k),
                target_plane=target_plane,
                source_plane=source_plane,
                distance_m=abs(float(report.offsets_m[k])),
                at_m=_triple(planes.centroids[i] + target_features.origin_m),
                basis=(_triple(planes.bases[i, :, 0]), _triple(planes.bases[i, :, 1])),
                tilt_gon=_pair(report.residuals[k, :2] * GON_PER_RAD),
                offset_mm=float(report.offsets_m[k]) * 1e3,
            )
        )
    return out


def outliers(fine: FineRegistration, target: str, source: str) -> list[Outlier]:
    """Tell what was removed and put back, in order."""
    names = _names(fine, target, source)
    return [
        Outlier(
            line=names(removal.correspondence),
            kind=removal.kind,
            step=removal.step,
            statistic=removal.statistic,
            critical=removal.critical,
            change=removal.change.value,
            why=removal.reason,
            inseparable_from=_inseparable(removal.inseparable_from, names),
            moved_plane=_moved_plane(removal, target, source),
        )
        for removal in fine.adjustment.removals
    ]


def largest_effects(fine: FineRegistration) -> ExternalEffect | None:
    """Give the largest effects of errors that stay undetected in any line or plane."""
    parts: tuple[CorrespondenceReport, ...] = (fine.adjustment.lines, fine.adjustment.planes)
    controlled = np.concatenate([part.controlled.ravel() for part in parts])
    motions = np.vstack([part.effects.reshape(-1, 6) for part in parts])
    global_ = np.concatenate([part.global_effects.ravel() for part in parts])
    return _effect(fine, motions[controlled > 0.0], global_[controlled > 0.0])


def _tested(
    fine: FineRegistration, report: CorrespondenceReport, first: int, target: str, source: str
) -> Callable[[int], dict[str, Any]]:
    """Give a function that fills what lines and planes have in common for pair k."""
    removals = _last_removals(fine.adjustment)
    names = _names(fine, target, source)

    def fields(k: int) -> dict[str, Any]:
        state, removal = CorrespondenceState(int(report.states[k])), removals.get(first + k)
        seen = report.controlled[k] > 0.0
        return {
            "state": STATE_NAMES[state],
            "angle_gon": float(report.angles_rad[k]) * GON_PER_RAD,
            "residuals": [float(value) for value in report.residuals[k]],
            "residual_std": [float(value) if np.isfinite(value) else None for value in report.residual_std[k]],
            "normalised": _where(report.w[k], seen),
            "redundancy_numbers": [float(value) for value in report.redundancy[k]],
            "redundancy": float(report.redundancy[k].sum()),
            "test": None
            if report.degrees[k] < 1
            else FeatureTest(
                statistic=float(report.statistics[k]),
                degrees_of_freedom=float(report.degrees[k]),
                critical=float(report.critical[k]),
                critical_b_method=float(report.critical_b_method[k]),
                p_value=float(report.p_values[k]),
            ),
            "mdb": _where(report.detectable[k], seen),
            "external_effect": _effect(fine, report.effects[k][seen], report.global_effects[k][seen]),
            "removal": None
            if removal is None or state is not CorrespondenceState.REMOVED
            else Removal(
                step=removal.step,
                statistic=removal.statistic,
                critical=removal.critical,
                why=removal.reason,
                inseparable_from=_inseparable(removal.inseparable_from, names),
                moved_plane=_moved_plane(removal, target, source),
            ),
        }

    return fields


def _where(values: Array, known: Array) -> list[float | None]:
    return [float(value) if k else None for value, k in zip(values, known, strict=True)]


def _effect(fine: FineRegistration, motions: Array, global_: Array) -> ExternalEffect | None:
    if len(motions) == 0:
        return None
    largest = largest_effect(motions, global_, fine.pose.target_from_source, fine.centroid_m)
    values = largest.parameters * np.array([GON_PER_RAD, GON_PER_RAD, GON_PER_RAD, 1.0, 1.0, 1.0])
    return ExternalEffect(
        **dict(zip(PARAMETERS, _where(values, pose_parameters(fine.pose).determined), strict=True)),
        centroid_shift_m=largest.centroid_m,
        global_effect=largest.global_,
    )


def _last_removals(adjustment: LineAdjustment) -> Mapping[int, RemovalStep]:
    return {removal.correspondence: removal for removal in adjustment.removals if removal.change is Change.REMOVED}


def _names(fine: FineRegistration, target: str, source: str) -> Callable[[int], str]:
    """Give a function that names pair k: lines first, then planes."""

    def name(k: int) -> str:
        is_line = k < len(fine.lines)
        i, j = fine.lines[k] if is_line else fine.planes[k - len(fine.lines)]
        named = line_name if is_line else plane_name
        return f"{target}/{named(int(i))} – {source}/{named(int(j))}"

    return name


def _inseparable(partners: tuple[Partner, ...], names: Callable[[int], str]) -> list[Inseparable]:
    return [Inseparable(correspondence=names(p.block), correlation=p.correlation) for p in partners]


def _moved_plane(removal: RemovalStep, target: str, source: str) -> str | None:
    if removal.plane is None:
        return None
    side, number = removal.plane
    return f"{(target, source)[side]}/{plane_name(number)}"


def _triple(vector: Vector3) -> Triple:
    return cast("Triple", tuple(float(value) for value in vector))


def _pair(values: Array) -> tuple[float, float]:
    return (float(values[0]), float(values[1]))
