"""Stations that lines and planes leave open: they must not take the adjustment from all the others (MATH 6.4)."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.options import AdjustmentOptions
from algorithms.arrays import Array
from algorithms.errors import DegenerateGeometryError, TooFewCorrespondencesError
from algorithms.network.joint_adjustment import JointAdjustment, adjust_jointly
from algorithms.network.tracks import Member, StationFeatures, Tracks

DEFAULT_OPTIONS = AdjustmentOptions()

REACH_M = 10.0
"""Distance from a station at which its turn is compared with shifts."""
MOVING_SHARE = 0.01
"""Share of the largest motion from which a station is taken for one that what is open moves."""


@dataclass(frozen=True, eq=False)
class DeterminedStations:
    """The adjustment of those stations that lines and planes determine."""

    joint: JointAdjustment
    tracks: Tracks
    """Numbered as the given ones, with the members of these stations only."""
    left_out: tuple[int, ...]
    """The other stations, in ascending order."""


def adjust_determined(
    features: Mapping[int, StationFeatures],
    tracks: Tracks,
    stations: Sequence[int],
    start: Mapping[int, RigidTransform],
    options: AdjustmentOptions = DEFAULT_OPTIONS,
) -> DeterminedStations:
    """Adjust the stations that hold together by what they see in common, and leave out those that stay open.

    A station is open when nothing that it sees is seen by others, or when what is leaves a direction free: such are
    found by the directions along which the normal equations are singular. Of several parts that no common feature
    connects the largest is adjusted, of equal ones that of the first station.

    Parameters
    ----------
    features, tracks, stations, start, options
        As `adjust_jointly`; where the first station is open, the first of those that are not is fixed.

    Raises
    ------
    DegenerateGeometryError, TooFewCorrespondencesError
        When fewer than two stations are left.
    """
    inside = _largest_part(tracks, stations)
    while True:
        own = _seen_by(inside, tracks)
        try:
            joint = adjust_jointly(features, own, inside, start, options)
        except DegenerateGeometryError as error:
            opened = _open(error, inside)
            if not opened or len(inside) - len(opened) < 2:
                raise
            inside = _largest_part(own, [station for station in inside if station not in opened])
        else:
            return DeterminedStations(joint, own, tuple(sorted(set(stations) - set(inside))))


def _seen_by(stations: Iterable[int], tracks: Tracks) -> Tracks:
    """Keep the members of some stations; objects that fewer than two of them see have none."""
    known = set(stations)

    def kept(group: tuple[Member, ...]) -> tuple[Member, ...]:
        members = tuple(member for member in group if member[0] in known)
        return members if len(members) > 1 else ()

    kinds = (tracks.planes, tracks.lines, tracks.points)
    planes, lines, points = (tuple(kept(group) for group in groups) for groups in kinds)
    return replace(tracks, planes=planes, lines=lines, points=points)


def _largest_part(tracks: Tracks, stations: Sequence[int]) -> list[int]:
    """Give the most stations that common features connect, in the given order.

    Raises
    ------
    TooFewCorrespondencesError
        Where no two stations see anything in common.
    """
    import networkx as nx

    place = {station: k for k, station in enumerate(stations)}
    graph: nx.Graph[int] = nx.Graph()
    for group in (*tracks.planes, *tracks.lines, *tracks.points):
        nx.add_path(graph, [place[station] for station, _ in group if station in place])
    parts = [sorted(part) for part in nx.connected_components(graph) if len(part) > 1]
    if not parts:
        raise TooFewCorrespondencesError(0, 1, "features of several stations")
    return [stations[k] for k in min(parts, key=lambda part: (-len(part), part))]


def _open(error: DegenerateGeometryError, stations: Sequence[int]) -> set[int]:
    """Give the stations that open directions move; of two sides that move against each other the smaller one."""
    directions = error.null_space
    if directions is None:
        return set(stations)
    found: set[int] = set()
    for direction in np.asarray(directions).T:
        moving = _moving(direction, len(stations) - 1)
        inner = {stations[k + 1] for k in np.flatnonzero(moving).tolist()}
        found |= inner if 2 * len(inner) < len(stations) else set(stations) - inner
    return found


def _moving(direction: Array, count: int) -> Array:
    """Say which of the poses (count,) a direction of the unknowns moves."""
    of_poses = direction[: 6 * count].reshape(count, 6)
    motions = np.hypot(REACH_M * np.linalg.norm(of_poses[:, :3], axis=1), np.linalg.norm(of_poses[:, 3:], axis=1))
    return np.asarray(motions > MOVING_SHARE * motions.max())
