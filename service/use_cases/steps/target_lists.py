"""Lists of targets as plans give them to steps, without numpy: plans are asked in the web process."""

import math
from collections.abc import Mapping, Sequence

from service.ports import Json

STATED = "stated"
SAME_PLACE_M = 0.02
"""A target that is found within so far of a stated one is that one, which a person measured."""
Rows = list[list[float]]


def targets_by_station(inputs: Json, found: Mapping[str, Sequence[Json]]) -> dict[str, list[Json]]:
    """Give the targets of all stations that have some, by name: those of the request, then others that were found.

    Parameters
    ----------
    inputs
        Of a `register` job.
    found
        In the scans, by name of the station.
    """
    joined: dict[str, list[Json]] = {}
    for station in inputs["stations"]:
        stated = [_as_found(target) for target in station.get("targets", [])]
        fresh = [
            each
            for each in found.get(station["name"], [])
            if all(math.dist(each["xyz_m"], own["xyz_m"]) > SAME_PLACE_M for own in stated)
        ]
        if stated or fresh:
            joined[station["name"]] = [*stated, *fresh]
    return joined


def covariance_rows(point: Json) -> Rows:
    """Give the covariance, 3x3 row by row, of a point of a request; zero where it states none [m²]."""
    if point.get("covariance") is not None:
        return [list(row) for row in point["covariance"]]
    std = point.get("std") or 0.0
    stds = [std] * 3 if isinstance(std, int | float) else list(std)
    return [[stds[i] ** 2 if i == k else 0.0 for k in range(3)] for i in range(3)]


def _as_found(target: Json) -> Json:
    return {
        "name": target.get("name"),
        "kind": STATED,
        "xyz_m": [target["x"], target["y"], target["z"]],
        "covariance_m2": covariance_rows(target),
    }
