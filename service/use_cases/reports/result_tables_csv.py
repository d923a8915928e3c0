"""The tables of a result as CSV files: one row each, units in the names of the columns."""

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

from schemas.results.correspondences import Correspondence, PlaneCorrespondence
from schemas.results.registration_result import Pair
from service.formats.writers.csv_table import csv_text, harmless
from service.use_cases.documents.pose_documents import PARAMETERS
from service.use_cases.reports.figures import SHIFTS, TURNS, PairFigures, StationFigures

LINE_COMPONENTS = ("tilt_1_rad", "tilt_2_rad", "offset_1_m", "offset_2_m")
PLANE_COMPONENTS = ("tilt_1_rad", "tilt_2_rad", "offset_1_m")
"""Components of residuals in the basis (E1, E2) of the target feature; a plane's offset is along its normal."""
AXES = ("x", "y", "z")
Row = dict[str, Any]


POSE_COLUMNS: Mapping[str, tuple[str, str, str]] = {
    "angles_gon": TURNS,
    "position_m": SHIFTS,
    "std_angles_gon": ("omega_gon_std", "phi_gon_std", "kappa_gon_std"),
    "std_origin_m": ("tx_m_std", "ty_m_std", "tz_m_std"),
    "std_centroid_m": ("tx_m_std_at_centroid", "ty_m_std_at_centroid", "tz_m_std_at_centroid"),
    "centroid_m": ("centroid_x_m", "centroid_y_m", "centroid_z_m"),
}
"""Columns of each figure of a pose."""
PROJECTED_COLUMNS: Mapping[str, tuple[str, str, str]] = {
    "projected_m": ("east_m", "north_m", "height_m"),
    "std_projected_m": ("east_m_std", "north_m_std", "height_m_std"),
}
"""Columns of each figure of a place in the projection of the control."""
SURFACE_COLUMNS = ("std_surface_m", "std_middle_m", "std_rotation_gon")
"""Columns and figures of what the pose leaves uncertain on the surface."""


def poses_csv(stations: Sequence[StationFigures]) -> str:
    """Return the stations with parameters and standard deviations, in the frame and in the projection named beside."""
    rows = []
    for station in stations:
        row: Row = {"station": station.name, "status": station.status, "frame": station.frame, "crs": station.system}
        for figures, columns in ((station.pose, POSE_COLUMNS), (station, PROJECTED_COLUMNS)):
            for figure, names in columns.items():
                row |= zip(names, getattr(figures, figure), strict=True)
        row |= {figure: getattr(station, figure) for figure in SURFACE_COLUMNS}
        rows.append(row)
    pose, projected = (chain.from_iterable(columns.values()) for columns in (POSE_COLUMNS, PROJECTED_COLUMNS))
    return _rows(rows, ["station", "status", *pose, "frame", "crs", *projected, *SURFACE_COLUMNS])


PAIR_COLUMNS: Mapping[str, str] = {
    "target": "target",
    "source": "source",
    "status": "status",
    "state": "use",
    "place": "place_probability",
    "rank": "parameters_determined",
    "std_far_m": "std_far_m",
    "tolerance_m": "tolerance_m",
    "std_worst_m": "std_worst_m",
    "undetected_m": "undetected_m",
    "overlap_0_1m": "overlap_0_1m",
    "overlap_0_5m": "overlap_0_5m",
    "rms_m": "rms_m",
    "sigma0": "sigma0",
}
"""Column of each figure of a pair."""


def pairs_csv(pairs: Sequence[PairFigures]) -> str:
    """Return the pairs with their verdicts: place, what is determined, and how well."""
    rows = [{column: getattr(pair, figure) for figure, column in PAIR_COLUMNS.items()} for pair in pairs]
    return _rows(rows, list(PAIR_COLUMNS.values()))


def matrix_text(station: StationFigures) -> str:
    """Return the pose of a station as four rows of four numbers: into the common frame, in metres.

    Where the station has a place in a projection too, remarks below the rows name the frame, and have the first-order
    map of the scan into the projection. Readers of matrices take the first sixteen numbers, or skip remarks.
    """
    lines = _matrix_lines(station.matrix or ())
    if station.projected_matrix is not None:
        system = harmless(str(station.system))
        lines += [
            f"# the rows above lead into the common frame: {harmless(station.frame)}",
            f"# {system} (east, north, height) from scan, to first order, scale and convergence included:",
            *(f"# {line}" for line in _matrix_lines(station.projected_matrix)),
            f"# origin of the scan in {system}: {_numbers(station.projected_m)}",
            f"# standard deviations of its east, north, height [m]: {_numbers(station.std_projected_m)}",
        ]
    return "\n".join(lines) + "\n"


def _matrix_lines(matrix: Sequence[Sequence[float]]) -> list[str]:
    return [_numbers(row) for row in matrix]


def _numbers(values: Sequence[float | None]) -> str:
    return " ".join("nan" if value is None else repr(value) for value in values)


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
