"""How alike two scans are, from distances between parallel planes: rooms have widths and heights of their own.

One distance is shared by chance often, two of three parallel planes hardly ever: so triples speak first, and pairs
where a scan shows few planes. A cheap hint on which pairs of many stations are worth a registration, nothing more: no
pose is derived from it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations

import numpy as np
from jaxtyping import Float32, Float64, Int64
from scipy import sparse

from algorithms.arrays import Array
from algorithms.geometry.planes import Planes

MOST_DISTANCE_M = 16.0
BIN_M = 0.02
PARALLEL_COSINE = np.cos(np.radians(2.0))
SMOOTHING = np.array([0.25, 0.5, 1.0, 0.5, 0.25])
"""Distances of the same walls differ by a few centimetres between scans that see different parts of them."""
MOST_PLANES = 300
"""The largest planes of a scan say what can be said."""
TRIPLE_BIN_M = 0.05
"""Two distances are laid out in squares of this edge, each shared by the four squares around it."""
MOST_IN_TRIPLES = 60
"""The same of triples, whose number grows with the third power."""
MOST_TRIPLE_BINS = 2000
"""Of each scan; the heaviest."""
PAIR_SHARE = 0.25
"""Weight of pairs beside triples: it decides where there are hardly any."""


@dataclass(frozen=True, eq=False)
class Appearance:
    """What distances between parallel planes of a scan say of it, whatever its frame."""

    pairs: Float64[Array, "bins"]
    """Weights of distances, by what two planes are to each other."""
    triples: Int64[Array, "t"]
    """Numbers of two distances of three planes with what these are to each other, in ascending order."""
    triple_weights: Float64[Array, "t"]


def appearance(planes: Planes) -> Appearance:
    """Describe a scan by distances between its parallel planes, large planes more. O(p²) for p planes, and p³ for few.

    Parameters
    ----------
    planes
        In any frame.
    """
    return Appearance(_distance_profile(planes), *_triples(planes))


def _distance_profile(planes: Planes) -> Float64[Array, "bins"]:
    """Count distances between parallel planes by what the planes are to each other.

    Facing each other (the width of a room), back to back (the thickness of a wall or body), looking the same way (a
    step): three histograms one after the other.
    """
    largest = np.argsort(-planes.areas_m2, kind="stable")[:MOST_PLANES]
    normals, centroids, areas = planes.normals[largest], planes.centroids[largest], planes.areas_m2[largest]
    i, j = np.triu_indices(len(largest), 1)
    cosines = np.einsum("ni,ni->n", normals[i], normals[j])
    apart = np.einsum("ni,ni->n", normals[i], centroids[j] - centroids[i])
    weights = np.sqrt(np.minimum(areas[i], areas[j]))
    bins = round(MOST_DISTANCE_M / BIN_M)
    profile = np.zeros((3, bins))
    for kind, chosen in enumerate(
        (
            (cosines < -PARALLEL_COSINE) & (apart > 0.0),
            (cosines < -PARALLEL_COSINE) & (apart <= 0.0),
            cosines > PARALLEL_COSINE,
        )
    ):
        places = (np.abs(apart[chosen]) / BIN_M).astype(np.int64)
        near = places < bins
        np.add.at(profile[kind], places[near], weights[chosen][near])
    smoothed = [np.convolve(row, SMOOTHING, mode="same") for row in profile]
    return np.concatenate(smoothed)


def _triples(planes: Planes) -> tuple[Int64[Array, "t"], Float64[Array, "t"]]:
    """Lay out three parallel planes by the distances of the outer ones from the middle one and the ways they look.

    Read from the side of the shorter distance, so that it does not matter from which end one begins.
    """
    largest = np.argsort(-planes.areas_m2, kind="stable")[:MOST_IN_TRIPLES]
    normals, centroids, areas = planes.normals[largest], planes.centroids[largest], planes.areas_m2[largest]
    numbers = _all_triples(len(largest))
    cosines = normals @ normals.T
    parallel = np.abs(cosines) > PARALLEL_COSINE
    numbers = numbers[parallel[numbers[:, 0], numbers[:, 1]] & parallel[numbers[:, 0], numbers[:, 2]]]
    along, middles = normals[numbers[:, 0]], centroids[numbers]
    offsets = np.einsum("nki,ni->nk", middles - middles[:, :1], along)
    same_way = np.sign(np.take_along_axis(cosines[numbers[:, 0]], numbers, axis=1))
    order = np.argsort(offsets, axis=1, kind="stable")
    offsets, same_way = np.take_along_axis(offsets, order, axis=1), np.take_along_axis(same_way, order, axis=1)
    gaps = np.diff(offsets, axis=1)
    backwards = gaps[:, 0] > gaps[:, 1]
    gaps[backwards], same_way[backwards] = gaps[backwards, ::-1], -same_way[backwards, ::-1]
    looks = (same_way > 0.0) @ np.array([4, 2, 1])
    near = gaps[:, 1] < MOST_DISTANCE_M
    weights = np.sqrt(areas[numbers].min(axis=1))[near]
    return _spread_on_squares(gaps[near], looks[near].astype(np.int64), weights)


@cache
def _all_triples(count: int) -> Int64[Array, "t 3"]:
    return np.array(list(combinations(range(count), 3)), dtype=np.int64).reshape(-1, 3)


def _spread_on_squares(
    gaps: Float64[Array, "n 2"], looks: Int64[Array, "n"], weights: Float64[Array, "n"]
) -> tuple[Int64[Array, "t"], Float64[Array, "t"]]:
    """Share weights among the four squares around each pair of distances; keep the heaviest squares."""
    places = gaps / TRIPLE_BIN_M - 0.5
    low = np.floor(places).astype(np.int64)
    beyond = places - low
    numbers, parts = [], []
    for first in (0, 1):
        for second in (0, 1):
            step = np.array([first, second])
            square = low + step + 1
            numbers.append((looks * _SQUARES + square[:, 0]) * _SQUARES + square[:, 1])
            parts.append(weights * np.abs(1 - step - beyond).prod(axis=1))
    found, at = np.unique(np.concatenate(numbers), return_inverse=True)
    total = np.bincount(at, np.concatenate(parts), minlength=len(found))
    kept = np.sort(np.argsort(-total, kind="stable")[:MOST_TRIPLE_BINS])
    return found[kept], total[kept]


_SQUARES = round(MOST_DISTANCE_M / TRIPLE_BIN_M) + 3
"""Squares along an axis."""


@dataclass(frozen=True, eq=False)
class Likeness:
    """How alike n scans are: up to 1 + `PAIR_SHARE`, 0 nothing in common."""

    triples: sparse.csr_array
    """(n, d) of length one, or zero."""
    pairs: Float32[Array, "n e"]
    """(n, e) of length `PAIR_SHARE` in square, or zero."""

    def __len__(self) -> int:
        return len(self.pairs)

    def rows(self, stations: Int64[Array, "k"]) -> Float64[Array, "k n"]:
        """Compare some scans (k,) with all, cosine by cosine: n² of them are never held at once."""
        of_triples = (self.triples[stations] @ self.triples.T).toarray()
        return np.asarray(of_triples + self.pairs[stations] @ self.pairs.T)


def likeness(scans: Sequence[Appearance]) -> Likeness:
    """Compare scans by their appearance, what few scans have counting more (rare before common).

    Parameters
    ----------
    scans
        Appearance of each.
    """
    counts = np.log1p(np.array([scan.pairs for scan in scans]))
    weighted = counts * _rarity((counts > 0.0).sum(axis=0), len(scans))
    lengths = np.linalg.norm(weighted, axis=1)
    pairs = np.sqrt(PAIR_SHARE) * weighted / np.maximum(lengths, np.finfo(np.float64).tiny)[:, None]
    found, columns = np.unique(np.concatenate([scan.triples for scan in scans]), return_inverse=True)
    starts = np.concatenate([[0], np.cumsum([len(scan.triples) for scan in scans])])
    values = np.log1p(np.concatenate([scan.triple_weights for scan in scans]))
    values *= _rarity(np.bincount(columns, minlength=len(found)), len(scans))[columns]
    triples = sparse.csr_array((values, columns, starts), shape=(len(scans), len(found)))
    lengths = np.sqrt(np.asarray(triples.power(2).sum(axis=1)).ravel())
    triples.data /= np.repeat(np.maximum(lengths, np.finfo(np.float64).tiny), np.diff(starts))
    return Likeness(triples, pairs.astype(np.float32))


def _rarity(in_scans: Array, scans: int) -> Array:
    return np.asarray(np.log((1.0 + scans) / (1.0 + in_scans)) + 0.1)
