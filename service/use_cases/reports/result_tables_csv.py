"""The tables of a result as CSV files: one row each, units in the names of the columns."""

from collections.abc import Mapping, Sequence
from typing import Any

from schemas.results.correspondences import Correspondence, PlaneCorrespondence
from schemas.results.registration_result import Pair, Station
from service.formats.writers.csv_table import csv_text
from service.use_cases.documents.pose_documents import PARAMETERS

LINE_COMPONENTS = ("tilt_1_rad", "tilt_2_rad", "offset_1_m", "offset_2_m")
PLANE_COMPONENTS = ("tilt_1_rad", "tilt_2_rad", "offset_1_m")
"""Components of residuals in the basis (E1, E2) of the target feature; a plane's offset is along its normal."""
AXES = ("x", "y", "z")
Row = dict[str, Any]


def poses_csv(stations: Sequence[Station]) -> str:
    """Give the stations with parameters and standard deviations."""
    rows = []
    for station in stations:
        pose = station.world_from_scan
        row: Row = {"station": station.name, "status": station.status}
        row |= {name: None if pose is None else getattr(pose, name) for name in PARAMETERS}
        std = None if pose is None else pose.std
        row |= {f"{name}_std": None if std is None else getattr(std, name) for name in PARAMETERS}
        rows.append(row)
    return _rows(rows, ["station", "status", *PARAMETERS, *(f"{name}_std" for name in PARAMETERS)])


def correspondences_csv(pairs: Sequence[Pair]) -> str:
    """Give all pairs of lines and planes with every figure of the result document."""
    rows: list[Row] = []
    for pair in pairs:
        rows += [_line_row(pair, line) for line in pair.correspondences]
        rows += [_plane_row(pair, plane) for plane in pair.plane_correspondences]
    return _rows(rows, CORRESPONDENCE_COLUMNS)


def _line_row(pair: Pair, entry: Correspondence) -> Row:
    return {
        **_common(pair, entry, LINE_COMPONENTS),
        "kind": "line",
        "target_feature": entry.target_line,
        "source_feature": entry.source_line,
        "feature_source": entry.source,
        "shortest_distance_m": entry.shortest_distance_m,
        "offset_1_mm": entry.offset_mm[0],
        "offset_2_mm": entry.offset_mm[1],
    }


def _plane_row(pair: Pair, entry: PlaneCorrespondence) -> Row:
    return {
        **_common(pair, entry, PLANE_COMPONENTS),
        "kind": "plane",
        "target_feature": entry.target_plane,
        "source_feature": entry.source_plane,
        "offset_1_mm": entry.offset_mm,
    }


def _common(pair: Pair, entry: Correspondence | PlaneCorrespondence, components: Sequence[str]) -> Row:
    row: Row = {
        "target": pair.target,
        "source": pair.source,
        "state": entry.state,
        "angle_gon": entry.angle_gon,
        "distance_m": entry.distance_m,
        "redundancy": entry.redundancy,
        "tilt_1_gon": entry.tilt_gon[0],
        "tilt_2_gon": entry.tilt_gon[1],
    }
    row |= {f"at_{axis}_m": value for axis, value in zip(AXES, entry.at_m, strict=True)}
    for number, direction in enumerate(entry.basis, start=1):
        row |= {f"e{number}_{axis}": value for axis, value in zip(AXES, direction, strict=True)}
    for k, component in enumerate(components):
        unitless = component.rsplit("_", 1)[0]
        row |= {
            f"residual_{component}": entry.residuals[k],
            f"residual_std_{component}": entry.residual_std[k],
            f"normalised_{unitless}": entry.normalised[k],
            f"redundancy_{unitless}": entry.redundancy_numbers[k],
            f"mdb_{component}": entry.mdb[k],
        }
    if entry.test is not None:
        row |= {f"test_{name}": value for name, value in entry.test.model_dump().items()}
    if entry.external_effect is not None:
        row |= {f"effect_{name}": value for name, value in entry.external_effect.model_dump().items()}
    if entry.removal is not None:
        row |= {
            "removed_in_step": entry.removal.step,
            "removed_with_statistic": entry.removal.statistic,
            "why": entry.removal.why,
            "inseparable_from": "; ".join(
                f"{partner.correspondence} ({partner.correlation:.3f})" for partner in entry.removal.inseparable_from
            ),
            "moved_plane": entry.removal.moved_plane,
        }
    return row


def _component_columns() -> Sequence[str]:
    columns = [f"residual_{name}" for name in LINE_COMPONENTS] + [f"residual_std_{name}" for name in LINE_COMPONENTS]
    for figure in ("normalised", "redundancy"):
        columns += [f"{figure}_{name.rsplit('_', 1)[0]}" for name in LINE_COMPONENTS]
    return columns + [f"mdb_{name}" for name in LINE_COMPONENTS]


CORRESPONDENCE_COLUMNS = (
    *("target", "source", "kind", "target_feature", "source_feature", "feature_source", "state"),
    *("angle_gon", "distance_m", "shortest_distance_m", "tilt_1_gon", "tilt_2_gon", "offset_1_mm", "offset_2_mm"),
    *("at_x_m", "at_y_m", "at_z_m", "e1_x", "e1_y", "e1_z", "e2_x", "e2_y", "e2_z"),
    *_component_columns(),
    "redundancy",
    *("test_statistic", "test_degrees_of_freedom", "test_critical", "test_critical_b_method", "test_p_value"),
    *(f"effect_{name}" for name in PARAMETERS),
    *("effect_centroid_shift_m", "effect_global_effect"),
    *("removed_in_step", "removed_with_statistic", "why", "inseparable_from", "moved_plane"),
)
"""What was not determined, or does not exist for planes, is left empty."""


def _rows(rows: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> str:
    return csv_text(columns, ([row.get(name) for name in columns] for row in rows))
