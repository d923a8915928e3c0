"""What each station and photo sees, in its own frame: the material of start values (H-17, H-18)."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from algorithms.adjustment.hybrid.image_equations import ImageObservations, distortion
from algorithms.adjustment.hybrid.network import Network
from algorithms.adjustment.hybrid.scanner_equations import (
    DISTANCE,
    HORIZONTAL,
    ZENITH,
    PolarObservations,
    StationCoordinates,
)
from algorithms.adjustment.hybrid.state import State
from algorithms.arrays import Array

UNDISTORTING_ROUNDS = 10


@dataclass(frozen=True, eq=False)
class Sight:
    """What one station or photo sees: points in its own frame, or directions to them."""

    pose: int
    mount: int
    is_photo: bool
    points: Array
    """(n,) numbers of points."""
    local: Array
    """(n, 3) coordinates in the frame of the station, or unit directions."""
    spatial: bool
    """Whether `local` are coordinates."""
    ideal: Array | None = None
    """(n, 2) of photos: image points without distortion over the principal distance."""


def sights_of(network: Network, state: State) -> Iterator[Sight]:
    """Give what every station and photo sees (Haring 2003)."""
    for each in network.observations:
        if isinstance(each, PolarObservations):
            yield from _polar_sights(each, state)
        elif isinstance(each, StationCoordinates):
            for pose in np.unique(each.stations):
                rows = each.stations == pose
                yield Sight(int(pose), 0, False, each.points[rows], each.values[rows], spatial=True)
        elif isinstance(each, ImageObservations):
            yield from _image_sights(each, state)


def _polar_sights(each: PolarObservations, state: State) -> Iterator[Sight]:
    # the elements of one pointing follow one another, each at most once
    new = np.ones(len(each), dtype=bool)
    same = (each.stations[1:] == each.stations[:-1]) & (each.points[1:] == each.points[:-1])
    new[1:] = ~(same & (each.components[1:] > each.components[:-1]))
    pointing = np.cumsum(new) - 1
    count = int(pointing[-1]) + 1
    values = np.full((count, 3), np.nan)
    values[pointing, each.components] = each.values
    first = np.flatnonzero(new)
    stations, points, heights = each.stations[first], each.points[first], each.heights[first]
    errors = state.scanners[each.scanners[first]]
    horizontal, zenith, distance = values[:, HORIZONTAL], values[:, ZENITH] - errors[:, 3], values[:, DISTANCE]
    distance = distance - errors[:, 0]
    directions = np.stack(
        [np.sin(zenith) * np.cos(horizontal), np.sin(zenith) * np.sin(horizontal), np.cos(zenith)], axis=1
    )
    whole, directed = np.isfinite(values).all(axis=1), np.isfinite(values[:, :2]).all(axis=1)
    for pose in np.unique(stations):
        own = stations == pose
        rows = own & whole
        if rows.any():
            local = distance[rows, None] * directions[rows]
            local[:, 2] -= heights[rows]
            yield Sight(int(pose), 0, False, points[rows], local, spatial=True)
        rows = own & directed & ~whole
        if rows.any():
            yield Sight(int(pose), 0, False, points[rows], directions[rows], spatial=False)


def _image_sights(each: ImageObservations, state: State) -> Iterator[Sight]:
    keys = np.stack([each.stations, each.mounts, each.cameras], axis=1)
    for key in np.unique(keys, axis=0):
        own = np.flatnonzero((keys == key).all(axis=1))
        points, at, counts = np.unique(each.points[own], return_index=True, return_counts=True)
        rows = own[at[counts >= 2]]
        if not len(rows):
            continue
        camera = np.repeat(state.cameras[key[2]][None], len(rows), axis=0)
        place = each.values[rows] - camera[:, 1:3]
        if each.backward[rows[0]]:
            ideal = place + distortion(place, camera)[0]
        else:
            ideal = place.copy()
            for _ in range(UNDISTORTING_ROUNDS):
                ideal = place - distortion(ideal, camera)[0]
        ideal = ideal / camera[:, :1]
        directions = np.column_stack([ideal, -np.ones(len(ideal))])
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        yield Sight(int(key[0]), int(key[1]), True, points[counts >= 2], directions, spatial=False, ideal=ideal)


def horizontal_angles(network: Network) -> Iterator[tuple[int, Array, Array]]:
    """Give for each station the points and horizontal angles [rad] that it observed (Haring 2003)."""
    for each in network.observations:
        if isinstance(each, PolarObservations):
            turning = each.components == HORIZONTAL
            for pose in np.unique(each.stations[turning]):
                own = turning & (each.stations == pose)
                yield int(pose), each.points[own], each.values[own]
