"""Where stations are according to approximate poses, and which of them are too far apart to see the same."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree

from algorithms.arrays import Points, Vector3
from algorithms.geometry.poses import PoseEstimate

SIGMAS = 5.0
"""So many standard deviations may stations be nearer to each other than their approximate poses say."""


@dataclass(frozen=True, eq=False)
class Whereabouts:
    """What approximate poses tell of n stations."""

    positions_m: Mapping[int, Vector3] = field(default_factory=dict)
    """Approximate places of stations in one frame [m]; those of others are unknown."""
    apart: frozenset[tuple[int, int]] = frozenset()
    """Pairs, the smaller number first, whose scans reach nowhere near each other."""

    def are_apart(self, first: int, second: int) -> bool:
        """Say whether two stations are known to be too far apart."""
        return (min(first, second), max(first, second)) in self.apart

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
    apart = {
        (first, second)
        for first, second in combinations(sorted(boxes), 2)
        if (boxes[first][0] > boxes[second][1]).any() or (boxes[second][0] > boxes[first][1]).any()
    }
    partners = {station: sum(station in pair for pair in apart) for station in boxes}
    lost = {station for station in boxes if partners[station] == len(boxes) - 1}
    return Whereabouts(
        {station: pose.translation_m for station, pose in poses.items() if station not in lost},
        frozenset(pair for pair in apart if not lost & set(pair)),
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
