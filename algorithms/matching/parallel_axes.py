"""Motions from parallel axes of cylinders: tanks, silos, columns on one ground.

Where all axes are parallel and all planes lie across them, neither do pairs of lines fix a motion (parallel lines leave
a shift free) nor planes a rotation (one normal leaves a turn free). Both together do: two axes that are as far apart as
two of the other scan give the turn and the place across them, planes that look the same way the place along them.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Float64

from algorithms.arrays import Array, Indices, Points, Scalars
from algorithms.features.scan_features import ScanFeatures
from algorithms.matching.correspondences import MAX_RADIUS_DIFFERENCE
from algorithms.matching.line_pairs import described_lines
from algorithms.matching.votes import Motions, joined

MAX_AXES = 30
"""So many of the longest axes of a scan form pairs."""
MAX_PLANES = 12
"""So many of the largest planes across the axes of a scan tell the place along them."""
MAX_MATCHES = 2000
"""Of more pairs like pairs than this the rarest are kept."""
LEAST_APART_M = 0.5
"""Axes nearer to each other fix the turn about them badly."""
LEAST_RADIUS_DIFFERENCE_M = 0.01
"""Radii nearer to each other than this are alike, however small they are."""
LEAST_ALONG = 0.34
"""A plane tells the place along axes that it crosses at 20 degrees or more."""
AGREEING_COSINE = 0.985
"""Moved normals within 10 degrees of a normal of the other scan agree."""
MOST = 4000
"""So many of the motions proposed are kept, those that lay the largest planes on each other."""


@dataclass(frozen=True, eq=False)
class _Pairs:
    """n pairs of parallel axes of one scan, and the p planes across them."""

    radii_m: Array
    """(n, 2) of the two cylinders [m]."""
    kinds: Array
    """(n, 2) whether they are seen from outside or from inside (`DescribedLines.kinds`)."""
    middles: Points
    """(n, 3) half-way between the two axes [m]."""
    across: Points
    """(n, 3) unit direction from the first to the second."""
    along: Points
    """(n, 3) unit direction of the first."""
    apart_m: Scalars
    """(n,) [m]."""
    normals: Float64[Array, "p 3"]
    """(p, 3) of the planes, towards the instrument."""
    centroids: Float64[Array, "p 3"]
    """(p, 3) [m]."""
    areas: Float64[Array, "p"]
    """(p,) [m2]."""

    def __len__(self) -> int:
        return len(self.apart_m)

    @staticmethod
    def of(features: ScanFeatures, max_angle_rad: float) -> "_Pairs":
        """Take the longest axes and the largest planes that they cross."""
        described = described_lines(features)
        axes = np.flatnonzero(described.are_axes)
        axes = axes[np.argsort(-described.lines.lengths[axes], kind="stable")[:MAX_AXES]]
        directions, anchors = described.lines.directions[axes], described.lines.anchors[axes]
        i, j = np.triu_indices(len(axes), k=1)
        along, way = directions[i], anchors[j] - anchors[i]
        across = way - np.einsum("ij,ij->i", way, along)[:, None] * along
        apart = np.linalg.norm(across, axis=1)
        sines = np.linalg.norm(np.cross(along, directions[j]), axis=1)
        used = np.flatnonzero((sines < np.sin(max_angle_rad)) & (apart > LEAST_APART_M))
        i, j, along, across, apart = i[used], j[used], along[used], across[used], apart[used]
        planes = features.planes
        crossing = np.flatnonzero((np.abs(planes.normals @ along.T) > LEAST_ALONG).any(axis=1))
        crossing = crossing[np.argsort(-planes.areas_m2[crossing], kind="stable")[:MAX_PLANES]]
        return _Pairs(
            radii_m=np.column_stack([described.sizes[axes[i]], described.sizes[axes[j]]]),
            kinds=np.column_stack([described.kinds[axes[i]], described.kinds[axes[j]]]),
            middles=anchors[i] + 0.5 * across,
            across=across / apart[:, None],
            along=along,
            apart_m=apart,
            normals=planes.normals[crossing],
            centroids=planes.centroids[crossing],
            areas=planes.areas_m2[crossing],
        )

    def frames(self, which: Array, *, exchanged: bool, reversed_: bool) -> Array:
        """Build right-handed frames (k, 3, 3): columns across, the third direction, and along the axes."""
        along = -self.along[which] if reversed_ else self.along[which]
        across = -self.across[which] if exchanged else self.across[which]
        return np.stack([across, np.cross(along, across), along], axis=-1)


def parallel_axis_motions(
    target: ScanFeatures, source: ScanFeatures, *, max_angle_rad: float, max_distance_m: float
) -> Motions:
    """Give a motion for every pair of parallel axes like one of the other scan, and every plane that fits across them.

    Parameters
    ----------
    target, source
        Features of the two scans.
    max_angle_rad, max_distance_m
        Within these limits angles and distances count as equal.

    Returns
    -------
    Motions, the vote of each is the area of the smaller of the two planes.
    """
    ours, theirs = (_Pairs.of(features, max_angle_rad) for features in (target, source))
    if min(len(ours), len(theirs), len(ours.areas), len(theirs.areas)) == 0:
        return Motions.empty()
    parts = [
        _laid_on(ours, theirs, exchanged=exchanged, reversed_=reversed_, max_distance_m=2.0 * max_distance_m)
        for exchanged, reversed_ in product((False, True), repeat=2)
    ]
    motions = joined(parts)
    return motions[np.argsort(-motions.votes, kind="stable")[:MOST]]


def _alike(ours: _Pairs, theirs: _Pairs, max_distance_m: float, *, exchanged: bool) -> tuple[Indices, Indices]:
    """Find the pairs equally far apart whose cylinders are alike one by one; of too many the target's rarest ones."""
    order = [1, 0] if exchanged else [0, 1]
    radii, kinds = theirs.radii_m[:, order], theirs.kinds[:, order]
    larger = np.maximum(ours.radii_m[:, None], radii)
    alike = np.abs(ours.apart_m[:, None] - theirs.apart_m) < max_distance_m
    alike &= (ours.kinds[:, None] == kinds).all(axis=2)
    limits = np.maximum(MAX_RADIUS_DIFFERENCE * larger, LEAST_RADIUS_DIFFERENCE_M)
    alike &= (np.abs(ours.radii_m[:, None] - radii) <= limits).all(axis=2)
    i, j = np.nonzero(alike)
    if len(i) > MAX_MATCHES:
        rarest = np.argsort(alike.sum(axis=1)[i], kind="stable")[:MAX_MATCHES]
        i, j = i[rarest], j[rarest]
    return i, j


def _laid_on(ours: _Pairs, theirs: _Pairs, *, exchanged: bool, reversed_: bool, max_distance_m: float) -> Motions:
    """Lay pairs on pairs, and every plane across them on every one that looks the same way then."""
    i, j = _alike(ours, theirs, max_distance_m, exchanged=exchanged)
    frames = ours.frames(i, exchanged=False, reversed_=False)
    rotations = frames @ np.swapaxes(theirs.frames(j, exchanged=exchanged, reversed_=reversed_), 1, 2)
    shifts = ours.middles[i] - np.einsum("hij,hj->hi", rotations, theirs.middles[j])
    moved = np.einsum("hij,sj->hsi", rotations, theirs.normals)
    crossing = ours.along[i] @ ours.normals.T
    agreeing = np.einsum("ti,hsi->hts", ours.normals, moved) > AGREEING_COSINE
    h, t, s = np.nonzero(agreeing & (np.abs(crossing) > LEAST_ALONG)[:, :, None])
    placed = np.einsum("kij,kj->ki", rotations[h], theirs.centroids[s]) + shifts[h]
    missing = np.einsum("ki,ki->k", ours.normals[t], ours.centroids[t] - placed) / crossing[h, t]
    translations = shifts[h] + missing[:, None] * ours.along[i][h]
    return Motions(rotations[h], translations, np.minimum(ours.areas[t], theirs.areas[s]))
