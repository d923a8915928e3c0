"""How alike two scans are, from distances between parallel planes: rooms have widths and heights of their own.

A cheap hint on which pairs of many are worth a registration, nothing more: no pose is derived from it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from algorithms.arrays import Array, Matrix
from algorithms.geometry.planes import Planes

MOST_DISTANCE_M = 16.0
BIN_M = 0.02
PARALLEL_COSINE = np.cos(np.radians(2.0))
SMOOTHING = np.array([0.25, 0.5, 1.0, 0.5, 0.25])
"""Distances of the same walls differ by a few centimetres between scans that see different parts of them."""
MOST_PLANES = 300
"""The largest planes of a scan say what can be said."""


def distance_profile(planes: Planes) -> Float64[Array, "bins"]:
    """Count distances between parallel planes of a scan, large planes more, by what the planes are to each other.

    Facing each other (the width of a room), back to back (the thickness of a wall or body), looking the same way (a
    step): three histograms one after the other. They do not depend on the scan's frame. O(p²) for p planes.
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


@dataclass(frozen=True, eq=False)
class Likeness:
    """How alike n scans are: 1 the same, 0 nothing in common."""

    descriptions: Matrix
    """(n, d) of length one."""

    def __len__(self) -> int:
        return len(self.descriptions)

    def rows(self, stations: Int64[Array, "k"]) -> Float64[Array, "k n"]:
        """Compare some scans (k,) with all, cosine by cosine: n² of them are never held at once."""
        return np.asarray(self.descriptions[stations] @ self.descriptions.T)


def likeness(profiles: Sequence[Array]) -> Likeness:
    """Compare scans by their profiles, what few scans have counting more (rare before common).

    Parameters
    ----------
    profiles
        (bins,) of each scan.
    """
    counts = np.log1p(np.array(profiles))
    in_scans = (counts > 0.0).sum(axis=0)
    rarity = np.log((1.0 + len(counts)) / (1.0 + in_scans)) + 0.1
    weighted = counts * rarity
    lengths = np.linalg.norm(weighted, axis=1)
    return Likeness(weighted / np.maximum(lengths, np.finfo(np.float64).tiny)[:, None])
