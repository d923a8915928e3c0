"""Which pairs of many stations are worth a registration: growth instead of all n².

Up to eight stations every pair is tried. Beyond, in rounds: first neighbours in the order of the list (stations are
mostly recorded as the surveyor walked), the most alike scans, and, where positions are roughly known, the nearest;
then, as long as the network is in parts, pairs that may join them; and pairs of connected stations that overlap
according to the poses found so far, so that every station is controlled by loops. Stations whose scans cannot reach
each other according to their approximate poses are never paired. The number of pairs is bounded by n (3 + 2 log2 n).
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import ceil, log2
from typing import TypeAlias

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Matrix, Points
from algorithms.network.options import ALL_PAIRS_UP_TO
from algorithms.network.whereabouts import NOWHERE, Whereabouts

PairOfStations: TypeAlias = tuple[int, int]
"""Numbers of two stations, the smaller one first."""

MOST_ALIKE = 2
"""Scans tried with each one in the first round because they are the most alike."""
NEAREST = 4
"""Stations tried with each one because their known positions are the nearest."""
JOINING_EACH = 3
"""Pairs tried in a round for each station of the smaller parts of a network."""
LOOPS_EACH = 3
"""Registrations that each station should have."""
CELL_M = 1.0
"""Edge of the cells in which surfaces are compared."""
LEAST_OVERLAP = 0.15
"""Share of the cells of the smaller surface that the other one must occupy too."""


@dataclass(frozen=True, eq=False)
class Tried:
    """What is known after some rounds."""

    pairs: Collection[PairOfStations]
    """All pairs that were tried."""
    accepted: Collection[PairOfStations]
    """Those of them whose registration is used."""
    poses: Mapping[int, RigidTransform]
    """Poses of stations in the frame of the first station of their part of the network."""
    parts: Sequence[Sequence[int]]
    """Stations that accepted registrations connect, each part in ascending order; single stations too."""


def most_pairs(stations: int) -> int:
    """Give the bound of the number of pairs that are tried: all of few stations, of many n (3 + 2 log2 n)."""
    every = stations * (stations - 1) // 2
    return every if stations <= ALL_PAIRS_UP_TO else min(every, ceil(stations * (3.0 + 2.0 * log2(stations))))


def first_pairs(alike: Matrix, whereabouts: Whereabouts = NOWHERE) -> list[PairOfStations]:
    """Give the pairs of the first round.

    Parameters
    ----------
    alike
        (n, n) how alike the scans are (`similarities`).
    whereabouts
        Where stations are, roughly.
    """
    n = len(alike)
    if n <= ALL_PAIRS_UP_TO:
        return list(combinations(range(n), 2))
    pairs = {(k, k + 1) for k in range(n - 1)}
    for k in range(n):
        excluded = {k, *(other for other in range(n) if whereabouts.are_apart(k, other))}
        pairs |= {_sorted(k, other) for other in _best(alike[k], MOST_ALIKE, excluded)}
    pairs |= set(whereabouts.nearest(NEAREST))
    return sorted(pair for pair in pairs if not whereabouts.are_apart(*pair))


def next_pairs(
    alike: Matrix, surfaces: Sequence[Points], tried: Tried, whereabouts: Whereabouts = NOWHERE
) -> list[PairOfStations]:
    """Give the pairs of a further round; none when nothing promising is left or the bound is reached.

    Parameters
    ----------
    alike
        (n, n) how alike the scans are.
    surfaces
        Thinned surface points (k, 3) of each station in its own frame [m].
    tried
        What is known so far.
    whereabouts
        Where stations are, roughly.
    """
    n = len(alike)
    left = most_pairs(n) - len(tried.pairs)
    if n <= ALL_PAIRS_UP_TO or left <= 0:
        return []
    known = {*tried.pairs, *whereabouts.apart}
    joining = _joining(alike, tried, known)
    closing = _closing(surfaces, tried, known)
    return sorted({*joining[:left], *closing[: max(left - len(joining), 0)]})


def _joining(alike: Matrix, tried: Tried, known: set[PairOfStations]) -> list[PairOfStations]:
    """Give for each station outside the largest part its most promising pairs with other parts, best first.

    Promising are scans that are alike, and stations that are near in the list.
    """
    if len(tried.parts) < 2:
        return []
    largest = max(tried.parts, key=lambda part: (len(part), [-station for station in part]))
    ranked: dict[PairOfStations, float] = {}
    for part in tried.parts:
        if part is largest:
            continue
        for station in part:
            distances = np.abs(np.arange(len(alike)) - station)
            promise = alike[station] + 1.0 / (1.0 + distances)
            excluded = {*part, *(other for other in range(len(alike)) if _sorted(station, other) in known)}
            for other in _best(promise, JOINING_EACH, excluded):
                ranked[_sorted(station, other)] = float(promise[other])
    return sorted(ranked, key=lambda pair: (-ranked[pair], pair))


def _closing(surfaces: Sequence[Points], tried: Tried, known: set[PairOfStations]) -> list[PairOfStations]:
    """Give pairs of connected stations that overlap in the poses so far, for stations with few registrations."""
    degrees = np.zeros(len(surfaces), dtype=np.int64)
    for pair in tried.accepted:
        degrees[list(pair)] += 1
    found: list[tuple[float, PairOfStations]] = []
    for part in tried.parts:
        cells = {station: occupied_cells(surfaces[station], tried.poses[station]) for station in part}
        for pair in _touching(cells):
            share = len(cells[pair[0]] & cells[pair[1]]) / max(min(len(cells[k]) for k in pair), 1)
            if pair not in known and share >= LEAST_OVERLAP:
                found.append((share, pair))
    chosen = []
    for _, pair in sorted(found, key=lambda entry: (-entry[0], entry[1])):
        if (degrees[list(pair)] < LOOPS_EACH).any():
            chosen.append(pair)
            degrees[list(pair)] += 1
    return chosen


def occupied_cells(points: Points, pose: RigidTransform) -> frozenset[tuple[int, int, int]]:
    """Give the cells that a surface occupies in the common frame."""
    if len(points) == 0:
        return frozenset()
    places = np.unique(np.floor(pose.apply(points) / CELL_M).astype(np.int64), axis=0)
    return frozenset((int(x), int(y), int(z)) for x, y, z in places)


def _touching(cells: Mapping[int, frozenset[tuple[int, int, int]]]) -> list[PairOfStations]:
    """Give the pairs of stations whose bounding boxes overlap."""
    boxes = {
        station: (np.min(list(occupied), axis=0), np.max(list(occupied), axis=0))
        for station, occupied in cells.items()
        if occupied
    }
    return [
        (first, second)
        for first, second in combinations(sorted(boxes), 2)
        if (boxes[first][0] <= boxes[second][1]).all() and (boxes[second][0] <= boxes[first][1]).all()
    ]


def _best(values: np.ndarray, count: int, excluded: set[int]) -> list[int]:
    """Give the places of the largest values."""
    order = np.argsort(-values, kind="stable").tolist()
    return [place for place in order if place not in excluded][:count]


def _sorted(first: int, second: int) -> PairOfStations:
    return (first, second) if first < second else (second, first)
