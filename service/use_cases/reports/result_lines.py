"""The lines of all stations as they lie in the end, with what became of them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Colors, Points, Vector3
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.lines import Lines
from schemas.results.registration_result import Pair, Station
from service.formats.dxf_lines_writer import LineLayer, dxf_lines
from service.formats.ply_edges_writer import ply_edges
from service.names.pair_statuses import IN_PLACE
from service.use_cases.documents.feature_names import line_name

COLORS = {
    "used": (0, 128, 96),
    "reinstated": (0, 128, 96),
    "not-controlled": (214, 138, 0),
    "removed": (200, 40, 40),
    "alone": (150, 150, 150),
}
"""Of line states; `alone`: seen from one station only, or matched in no accepted pair."""
MOST_SURFACE_POINTS = 50_000
"""Of each station, for pictures and precision: 1.2 MB."""
WORST_FIRST = ("removed", "not-controlled", "used", "reinstated")


@dataclass(frozen=True, eq=False)
class ScanLines:
    """What drawings need of a scan: little, so that many stations fit into memory."""

    lines: Lines
    """In the reduced scan frame."""
    origin_m: Vector3
    """(3,) local origin of that frame in the file's coordinates [m]."""
    sensor_m: Vector3 | None
    """(3,) position of the instrument in the reduced frame [m]; None where it is unknown."""
    surface_m: Points = field(default_factory=lambda: np.empty((0, 3)))
    """(n, 3) points of the surface, thinned evenly, in the reduced frame [m]."""
    spacing_m: float = 0.0
    """Edge of the voxels that the surface was thinned with [m]."""

    @staticmethod
    def of_features(features: ScanFeatures) -> "ScanLines":
        """Keep the lines and some of the surface, and forget the rest."""
        surface = features.surface
        every = max(1, math.ceil(len(surface.points) / MOST_SURFACE_POINTS))
        return ScanLines(
            features.lines, features.origin_m, features.sensor_m, surface.points[::every].copy(), surface.voxel_size_m
        )


@dataclass(frozen=True, eq=False)
class StationLines:
    """The lines of one station in some frame."""

    station: str
    starts: Points
    """(n, 3) [m]."""
    ends: Points
    """(n, 3) [m]."""
    states: Sequence[str]
    """n keys of `COLORS`."""

    @property
    def colors(self) -> Colors:
        """(n, 3) colours of the states."""
        return np.array([COLORS[state] for state in self.states], dtype=np.uint8).reshape(-1, 3)


def lines_of_station(
    name: str, scan: ScanLines, target_from_scan: RigidTransform, states: Mapping[str, str]
) -> StationLines:
    """Carry the lines of a station from its reduced frame into another.

    Parameters
    ----------
    name
        Of the station.
    scan
        Its lines.
    target_from_scan
        Where the file's full coordinates lie in the wanted frame.
    states
        State by name of the line, such as ``S1/L3``; others are `alone`.
    """
    starts, ends = (target_from_scan.apply(points + scan.origin_m) for points in scan.lines.end_points)
    names = [f"{name}/{line_name(k)}" for k in range(len(scan.lines))]
    return StationLines(name, starts, ends, [states.get(each, "alone") for each in names])


def states_of_lines(pairs: Sequence[Pair]) -> dict[str, str]:
    """Give the state of every matched line; the worst where several pairs use it."""
    states: dict[str, str] = {}
    for pair in pairs:
        for entry in pair.correspondences:
            for name in (entry.target_line, entry.source_line):
                known = states.get(name, entry.state)
                states[name] = min(known, entry.state, key=WORST_FIRST.index)
    return states


def registered_lines(
    stations: Sequence[Station], scans: Mapping[str, ScanLines], pairs: Sequence[Pair]
) -> list[StationLines]:
    """Give the lines of all registered stations in the world frame, states from the accepted pairs."""
    states = states_of_lines([pair for pair in pairs if pair.status in IN_PLACE])
    return [
        lines_of_station(
            station.name,
            scans[station.name],
            RigidTransform.from_matrix(np.array(station.world_from_scan.matrix)),
            states,
        )
        for station in stations
        if station.world_from_scan is not None
    ]


def lines_ply(parts: Sequence[StationLines]) -> bytes:
    """Write the lines of several stations as one PLY of coloured edges."""
    starts = np.vstack([np.empty((0, 3)), *(part.starts for part in parts)])
    ends = np.vstack([np.empty((0, 3)), *(part.ends for part in parts)])
    colors = np.vstack([np.empty((0, 3), dtype=np.uint8), *(part.colors for part in parts)])
    return ply_edges(starts, ends, colors)


def lines_dxf(parts: Sequence[StationLines]) -> bytes:
    """Write the lines of several stations as a drawing, one layer for each station and state."""
    layers = []
    for part in parts:
        for state, color in COLORS.items():
            which = np.array([each == state for each in part.states], dtype=bool)
            if which.any():
                layers.append(LineLayer(f"{part.station} {state}", color, part.starts[which], part.ends[which]))
    return dxf_lines(layers)
