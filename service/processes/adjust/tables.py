"""Tables of an adjusted network as CSV."""

from collections.abc import Mapping, Sequence
from typing import Any

from schemas.results.adjust_result import AdjustedStation, PointDocument
from service.formats.writers.csv_table import csv_text


def observations_csv(columns: Mapping[str, Sequence[Any]]) -> str:
    """Give every component of every observation, one a row."""
    return csv_text(list(columns), zip(*columns.values(), strict=True))


def points_csv(points: Sequence[PointDocument]) -> str:
    """Give the points, one a row."""
    columns = ["id", "x_m", "y_m", "z_m", "std_x_m", "std_y_m", "std_z_m", "observations", "redundancy"]
    return csv_text(
        columns,
        ([p.id, *p.xyz_m, *(p.std_m or ("", "", "")), p.observations, p.redundancy] for p in points),
    )


def stations_csv(stations: Sequence[AdjustedStation]) -> str:
    """Give the stations and photos, one a row."""
    columns = [
        "id",
        "type",
        "x_m",
        "y_m",
        "z_m",
        "angles",
        "angle_1_gon",
        "angle_2_gon",
        "angle_3_gon",
        "std_x_m",
        "std_y_m",
        "std_z_m",
        "std_1_gon",
        "std_2_gon",
        "std_3_gon",
        "observations",
        "redundancy",
    ]
    return csv_text(
        columns,
        (
            [
                s.id,
                s.type,
                *s.xyz_m,
                s.angles,
                *s.angles_gon,
                *(s.std_xyz_m or ("", "", "")),
                *(s.std_gon or ("", "", "")),
                s.observations,
                s.redundancy,
            ]
            for s in stations
        ),
    )
