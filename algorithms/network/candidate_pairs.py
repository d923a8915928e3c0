"""Which pairs of many stations are worth a registration: growth instead of all n².

Up to eight stations every pair is tried. Beyond, in rounds: first neighbours in the order of the list (stations are
mostly recorded as the surveyor walked), the most alike scans, and, where positions are roughly known, the nearest;
then, as long as the network is in parts, pairs that may join them, a few for each part; and pairs of connected stations
that overlap according to the poses found so far, first over registrations that no loop holds, then so that every
station has several. Stations whose scans cannot reach
each other according to their approximate poses are never paired. The number of pairs is bounded by n (3 + 2 log2 n),
of more than some hundred stations by 4000, and of more than a thousand by 4 n.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import ceil, log2
from typing import TypeAlias, cast

import numpy as np
from jaxtyping import Int64
from scipy import sparse
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Matrix, Points
from algorithms.network.options import ALL_PAIRS_UP_TO
from algorithms.network.similarity import Likeness
from algorithms.network.whereabouts import NOWHERE, Whereabouts

PairOfStations: TypeAlias = tuple[int, int]
"""Numbers of two stations, the smaller one first."""

CellNumbers: TypeAlias = Int64[Array, "cells"]
"""Cells that a surface occupies, in ascending order."""

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
HALF_CELLS = 1 << 20
"""Cells along an axis on either side of the origin."""
LEAST_OVERLAP = 0.15
"""Share of the cells of the smaller surface that the other one must occupy too."""


MOST_SEARCHED = 4000
"""Pairs that are tried at most where there are not many stations; beyond, a search for what joins leads nowhere."""
MOST_EACH = 4
"""Pairs tried at most for each of very many stations, in the mean."""
FIRST_SHARE = 0.75
"""Share of them that the first round may use."""
ROWS_AT_ONCE = 256
"""Stations that are compared with all others at once."""


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
    """Give the bound of the number of pairs that are tried: all of few stations, of many four for each."""
    every = stations * (stations - 1) // 2
    if stations <= ALL_PAIRS_UP_TO:
        return every
    searching = ceil(stations * (3.0 + 2.0 * log2(stations)))
    return min(every, max(min(searching, MOST_SEARCHED), MOST_EACH * stations))


def first_pairs(alike: Likeness, whereabouts: Whereabouts = NOWHERE) -> list[PairOfStations]:
    """Give the pairs of the first round.

    Parameters
    ----------
    alike
        How alike the scans are.
    whereabouts
        Where stations are, roughly.
    """
    n = len(alike)
    if n <= ALL_PAIRS_UP_TO:
        return list(combinations(range(n), 2))
    in_order = {(k, k + 1) for k in range(n - 1)}
    likely: set[PairOfStations] = set()
    for stations in _blocks(np.arange(n)):
        values = alike.rows(stations)
        values[np.arange(len(stations)), stations] = -np.inf
        values[whereabouts.apart_from(stations, n)] = -np.inf
        likely |= {_sorted(int(stations[row]), other) for row, other in _largest(values, MOST_ALIKE)}
    near = set(whereabouts.nearest(NEAREST))
    pairs = sorted(pair for pair in in_order | likely | near if not whereabouts.are_apart(*pair))
    most = int(FIRST_SHARE * most_pairs(n))
    if len(pairs) > most:  # those for which most speaks, known positions more than anything else
        told = {pair: 2 * (pair in near) + (pair in in_order) + (pair in likely) for pair in pairs}
        pairs = sorted(sorted(pairs, key=lambda pair: (-told[pair], pair))[:most])
    return pairs


def next_pairs(
    alike: Likeness, surfaces: Sequence[Array], tried: Tried, whereabouts: Whereabouts = NOWHERE
) -> list[PairOfStations]:
    """Give the pairs of a further round; none when nothing promising is left or the bound is reached.

    Parameters
    ----------
    alike
        How alike the scans are.
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
    joining = _joining(alike, tried, whereabouts)
    if len(joining) > left:  # what the best of them join, the others need not join any more
        joining = joining[: ceil(0.5 * left)]
    closing = _closing(surfaces, tried, whereabouts)
    return sorted({*joining, *closing[: left - len(joining)]})


def _joining(alike: Likeness, tried: Tried, whereabouts: Whereabouts) -> list[PairOfStations]:
    """Give for each part but the largest its most promising pairs with other parts, best first.

    Promising are scans that are alike, and stations that are near in the list. One pair joins a part however large it
    is, so a part has no more than a few pairs for each of the stations along its edge, about the root of all of them.
    """
    if len(tried.parts) < 2:
        return []
    n = len(alike)
    largest = max(tried.parts, key=lambda part: (len(part), [-station for station in part]))
    part_of = np.empty(n, dtype=np.int64)
    for number, part in enumerate(tried.parts):
        part_of[list(part)] = number
    firsts, seconds = np.array(list(tried.pairs), dtype=np.int64).reshape(-1, 2).T
    known = sparse.csr_array(
        (np.ones(2 * len(firsts), dtype=bool), (np.r_[firsts, seconds], np.r_[seconds, firsts])), shape=(n, n)
    )
    ranked: dict[PairOfStations, float] = {}
    outside = np.array(sorted({*range(n)} - set(largest)), dtype=np.int64)
    for stations in _blocks(outside):
        promise = alike.rows(stations) + 1.0 / (1.0 + np.abs(np.arange(n) - stations[:, None]))
        hopeless = part_of == part_of[stations, None]
        hopeless |= known[stations].toarray() | whereabouts.apart_from(stations, n)
        promise[hopeless] = -np.inf
        best = promise.copy()
        for row, other in _largest(best, JOINING_EACH):
            ranked[_sorted(int(stations[row]), other)] = float(promise[row, other])
    left = [JOINING_EACH * ceil(np.sqrt(len(part))) for part in tried.parts]
    chosen = []
    for pair in sorted(ranked, key=lambda pair: (-ranked[pair], pair)):
        ends = [int(part_of[station]) for station in pair if part_of[station] != part_of[largest[0]]]
        if any(left[number] > 0 for number in ends):
            chosen.append(pair)
            for number in ends:
                left[number] -= 1
    return chosen


def _closing(surfaces: Sequence[Array], tried: Tried, whereabouts: Whereabouts) -> list[PairOfStations]:
    """Give pairs of connected stations that overlap in the poses so far, what nothing controls yet first.

    First one pair over each registration that is in no loop, then pairs of stations with few registrations.
    """
    degrees = np.zeros(len(surfaces), dtype=np.int64)
    for pair in tried.accepted:
        degrees[list(pair)] += 1
    known = set(tried.pairs)
    found: list[tuple[float, PairOfStations]] = []
    for part in tried.parts:
        if len(part) > 1:
            cells = [occupied_cells(surfaces[station], tried.poses[station]) for station in part]
            found += [
                (-share, pair)
                for share, first, second in _overlaps(cells)
                if (pair := _sorted(part[first], part[second])) not in known and not whereabouts.are_apart(*pair)
            ]
    controlling, closing = [], []
    together = _looped(tried, len(surfaces))
    for _, pair in sorted(found):
        if together.joined(*pair):
            controlling.append(pair)
        elif (degrees[list(pair)] < LOOPS_EACH).any():
            closing.append(pair)
        else:
            continue
        degrees[list(pair)] += 1
    return controlling + closing


def _looped(tried: Tried, stations: int) -> "_Groups":
    """Group the stations that loops of registrations hold together."""
    import networkx as nx

    graph: nx.Graph[int] = nx.Graph()
    graph.add_edges_from(tried.accepted)
    groups = _Groups(stations)
    bridges = {_sorted(*edge) for edge in cast("list[PairOfStations]", list(nx.bridges(graph)))}
    for pair in tried.accepted:
        if _sorted(*pair) not in bridges:
            groups.joined(*pair)
    return groups


class _Groups:
    """Groups of stations that grow together."""

    def __init__(self, stations: int) -> None:
        self._above = list(range(stations))

    def joined(self, first: int, second: int) -> bool:
        """Put two stations into one group; say whether they were in different ones."""
        ours, theirs = self._top(first), self._top(second)
        self._above[theirs] = ours
        return ours != theirs

    def _top(self, station: int) -> int:
        while self._above[station] != station:
            self._above[station] = station = self._above[self._above[station]]
        return station


def occupied_cells(points: Points, pose: RigidTransform) -> CellNumbers:
    """Give the cells that a surface occupies in the common frame, as sorted numbers; up to 1000 km from its origin."""
    if len(points) == 0:
        return np.zeros(0, dtype=np.int64)
    places = np.floor(pose.apply(points) / CELL_M).clip(-HALF_CELLS, HALF_CELLS - 1).astype(np.int64) + HALF_CELLS
    return np.unique((places[:, 0] * (2 * HALF_CELLS) + places[:, 1]) * (2 * HALF_CELLS) + places[:, 2])


def _overlaps(cells: Sequence[Array]) -> Iterator[tuple[float, int, int]]:
    """Give the share of common cells of the smaller surface, and the two, of surfaces that overlap enough."""
    sizes = np.array([len(each) for each in cells])
    numbers, columns = np.unique(np.concatenate(cells), return_inverse=True)
    starts = np.concatenate([[0], np.cumsum(sizes)])
    held = sparse.csr_array((np.ones(len(columns), dtype=np.int32), columns, starts), shape=(len(cells), len(numbers)))
    common = sparse.coo_array(held @ held.T)
    firsts, seconds = common.coords
    shares = common.data / np.maximum(np.minimum(sizes[firsts], sizes[seconds]), 1)
    enough = (firsts < seconds) & (shares >= LEAST_OVERLAP)
    yield from zip(shares[enough].tolist(), firsts[enough].tolist(), seconds[enough].tolist(), strict=True)


def _blocks(stations: Array) -> list[Array]:
    """Cut stations into pieces whose rows of comparisons with all others fit into memory easily."""
    return [stations[first : first + ROWS_AT_ONCE] for first in range(0, len(stations), ROWS_AT_ONCE)]


def _largest(values: Matrix, count: int) -> Iterator[tuple[int, int]]:
    """Give row and column of the largest values of each row, the first of equal ones; the values are used up."""
    rows = np.arange(len(values))
    for _ in range(count):
        places = np.argmax(values, axis=1)
        open_rows = np.flatnonzero(values[rows, places] > -np.inf)
        yield from zip(open_rows.tolist(), places[open_rows].tolist(), strict=True)
        values[rows, places] = -np.inf


def _sorted(first: int, second: int) -> PairOfStations:
    return (first, second) if first < second else (second, first)
