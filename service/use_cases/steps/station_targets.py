"""Targets of the stations of a registration: those that are stated, and those that are found in the scans."""

from collections.abc import Sequence

import numpy as np
from pydantic import TypeAdapter

from algorithms.arrays import Vector3
from algorithms.geometry.point_sets import PointSet
from algorithms.targets.common_points import TargetSet
from algorithms.targets.options import SoughtKind
from service.ports import Json, StepContext
from service.use_cases.steps.run_features import read_stored_scan


def find_station_targets(context: StepContext, arguments: Json) -> Json:
    """Look for targets in the scan of one station; give them in the coordinates of its file."""
    from algorithms.targets.finding import find_targets

    context.progress.report(0.0, "reading")
    scan = read_stored_scan(context, arguments)
    kinds = TypeAdapter(list[SoughtKind]).validate_python(arguments["kinds"])
    found = find_targets(scan, kinds, progress=context.progress).found
    return {
        "station": arguments["name"],
        "targets": [
            {
                "name": None,
                "kind": each.kind.value,
                "xyz_m": (each.centre_m + scan.origin_m).tolist(),
                "covariance_m2": each.covariance_m2.tolist(),
            }
            for each in found
        ],
    }


def target_set(targets: Sequence[Json] | None, origin_m: Vector3) -> TargetSet | None:
    """Give targets in a reduced frame; None where there are none.

    Parameters
    ----------
    targets
        In the coordinates of the file.
    origin_m
        (3,) origin of the reduced frame [m].
    """
    if not targets:
        return None
    places = np.array([each["xyz_m"] for each in targets], dtype=np.float64) - origin_m
    covariances = np.array([each["covariance_m2"] for each in targets], dtype=np.float64)
    return TargetSet(tuple(each["name"] for each in targets), PointSet(places, covariances))
