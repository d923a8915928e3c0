"""Where stations are according to approximate poses, and which of them are too far apart to see the same."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Int64
from scipy.spatial import cKDTree

from algorithms.arrays import Array, Points, Vector3
from algorithms.geometry.poses import PoseEstimate

SIGMAS = 5.0
"""So many standard deviations may stations be nearer to each other than their approximate poses say."""

STATIONS_AT_ONCE = 256
"""Stations that are compared with all others at once."""


@dataclass(frozen=True, eq=False)
class Whereabouts:
    """What approximate poses tell of n stations."""

    positions_m: Mapping[int, Vector3] = field(default_factory=dict)
    """Approximate places of stations in one frame [m]; those of others are unknown."""
    boxes: Mapping[int, tuple[Vector3, Vector3]] = field(default_factory=dict)
    """Lower and upper corner of what the scans of stations may occupy in that frame [m]."""

    def are_apart(self, first: int, second: int) -> bool:
        """Say whether the scans of two stations reach nowhere near each other."""
        if first not in self.boxes or second not in self.boxes:
            return False
        (low, high), (other_low, other_high) = self.boxes[first], self.boxes[second]
        return bool((low > other_high).any() or (other_low > high).any())

    def apart_from(self, stations: Int64[Array, "k"], count: int) -> Bool[Array, "k n"]:
        """Say of some stations (k,) from which of all n they are apart.

        Parameters
        ----------
        stations
            Their numbers.
        count
            n.
        """
        low, high = np.full((count, 3), -np.inf), np.full((count, 3), np.inf)
        for station, (lower, upper) in self.boxes.items():
            low[station], high[station] = lower, upper
        beyond = (low[stations, None] > high[None]) | (low[None] > high[stations, None])
        return np.asarray(beyond.any(axis=2))

    def nearest(self, count: int) -> list[tuple[int, int]]:
        """Pair each known station with its nearest ones, the smaller number first."""
        stations = sorted(self.positions_m)
        if len(stations) < 2:
            return []
        places = np.array([self.positions_m[station] for station in stations])
        near = np.asarray(cKDTree(places).query(places, k=min(count + 1, len(stations)))[1])
        pairs = {(stations[row], stations[int(place)]) for row in range(len(stations)) for place in near[row]}
        return sorted({(min(pair), max(pair)) for pair in pairs if pair[0] != pair[1]})


NOWHERE = Whereabouts()
"""Nothing is known of any station."""


def whereabouts_of(surfaces: Sequence[Points], poses: Mapping[int, PoseEstimate]) -> Whereabouts:
    """Lay bounding boxes around the scans in their approximate poses, widened by their uncertainty.

    A station that would be apart from all others has a pose that cannot be right, as all belong to one job: nothing is
    concluded from it.

    Parameters
    ----------
    surfaces
        Some surface points (k, 3) of each station in its own frame [m].
    poses
        World from station, where it is roughly known.
    """
    boxes = {station: _box(surfaces[station], pose) for station, pose in poses.items() if len(surfaces[station])}
    placed = Whereabouts({}, boxes)
    known, lost = np.array(sorted(boxes), dtype=np.int64), set[int]()
    for first in range(0, len(known), STATIONS_AT_ONCE):
        stations = known[first : first + STATIONS_AT_ONCE]
        from_all_others = placed.apart_from(stations, len(surfaces)).sum(axis=1) == len(boxes) - 1
        lost |= set(stations[from_all_others].tolist())
    return Whereabouts(
        {station: pose.translation_m for station, pose in poses.items() if station not in lost},
        {station: box for station, box in boxes.items() if station not in lost},
    )


def _box(points: Points, pose: PoseEstimate) -> tuple[Vector3, Vector3]:
    """Give the lower and upper corner of what a scan may occupy in the world.

    However unknown the orientation, no point of a scan is farther from its station than its reach.
    """
    moved = pose.target_from_source.apply(points)
    reach = float(np.linalg.norm(moved - pose.translation_m, axis=1).max())
    turn = float(np.sqrt(np.linalg.eigvalsh(pose.covariance[:3, :3])[-1]))
    margin = SIGMAS * np.sqrt(np.diag(pose.covariance[3:, 3:])) + min(SIGMAS * turn, 2.0) * reach
    return moved.min(axis=0) - margin, moved.max(axis=0) + margin
