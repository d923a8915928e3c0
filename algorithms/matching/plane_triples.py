"""Motions from planes: rotations from normals, translations from one-dimensional votes of offsets.

Every pair of planes with equal normals fixes one component of the translation, every pair of lines with equal
directions the components across them. The strongest votes of three independent directions, in all combinations, give
the translations (MATCHING 2.4). Pairs of lines alone fail where nearly all are parallel, as at a bridge: there two
pillars and the water's level do.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, Matrices3, Matrix3, Points, Scalars, Vector3
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.line_pairs_geometry import bisector_frames
from algorithms.geometry.lines import bases_of
from algorithms.matching.correspondences import alike_lines
from algorithms.matching.line_pairs import DescribedLines, described_lines, longest_lines
from algorithms.matching.votes import Motions, joined, nearest_rotations, rotation_clusters

MAX_PLANES = 60
MAX_LINES = 60
MAX_DIRECTIONS = 10
MAX_ROTATIONS = 40
"""Distinct ones; a box laid on a box has 24."""
SAME_ROTATION_RAD = np.radians(2.0)
"""Rotations nearer to each other than this count as one [rad]."""
MAX_PEAKS = 8
SAME_DIRECTION_COSINE = 0.995
"""Normals within 5.7 degrees form one class."""
AGREEING_COSINE = 0.985
"""Moved normals within 10 degrees of a normal of the other scan agree."""
ACROSS_SINE = 0.1
"""Lines within 6 degrees of perpendicular to an axis fix the place along it."""
LEAST_SINE = 0.34
"""Directions are independent from 20 degrees on."""
LEAST_PLANES = 2
"""Two directions of normals fix a rotation."""
LINE_WIDTH_M = 0.3
"""A line speaks as much for a place as a strip of plane of this width."""
VOTE_BIN_M = 0.1


@dataclass(frozen=True, eq=False)
class _Features:
    """What votes: p planes and m lines of one scan."""

    normals: Points
    """(p, 3) towards the instrument."""
    centroids: Points
    """(p, 3) [m]."""
    areas: Scalars
    """(p,) [m2]."""
    described: DescribedLines
    """The m lines."""

    @staticmethod
    def of(features: ScanFeatures) -> "_Features":
        """Take the largest planes and the longest lines."""
        planes = features.planes
        order = np.argsort(-planes.areas_m2, kind="stable")[:MAX_PLANES]
        return _Features(
            planes.normals[order],
            planes.centroids[order],
            planes.areas_m2[order],
            longest_lines(described_lines(features), MAX_LINES),
        )


@dataclass(frozen=True, eq=False)
class OffsetVotes:
    """What planes and parallel lines say of the translation once a rotation is assumed."""

    rotation: Matrix3
    """Target from source."""
    axes: Array
    """(k, 3) at most three unit directions, each far from the span of those before."""
    offsets_m: tuple[Array, ...]
    """Components of the translation along each axis that have most votes, the strongest first [m]."""
    votes: tuple[Array, ...]
    """Their votes."""


def plane_motions(votes: Sequence[OffsetVotes]) -> Motions:
    """Combine the strongest offsets of three directions to motions, with the sum of their votes.

    Parameters
    ----------
    votes
        Of `offset_votes`; those of fewer than three directions give no motion.
    """
    return joined([_combined(each) for each in votes if len(each.axes) == 3])


def offset_votes(target: ScanFeatures, source: ScanFeatures, *, max_angle_rad: float) -> list[OffsetVotes]:
    """Let planes vote for rotations, and planes and parallel lines for how far the scans are apart along directions.

    Parameters
    ----------
    target, source
        Features of the two scans; the normals must be oriented towards the sensor.
    max_angle_rad
        Angles between normals that differ by less count as equal [rad].

    Returns
    -------
    One entry for each rotation, the one that lays most normals on normals first.
    """
    ours, theirs = _Features.of(target), _Features.of(source)
    if min(len(each.normals) for each in (ours, theirs)) < LEAST_PLANES:
        return []
    return [_offsets(rotation, ours, theirs) for rotation in _rotations(ours, theirs, max_angle_rad)]


def offset_votes_at(rotations: Matrices3, target: ScanFeatures, source: ScanFeatures) -> list[OffsetVotes]:
    """Let planes and parallel lines vote for shifts at given rotations.

    Parameters
    ----------
    rotations
        (k, 3, 3) target from source.
    target, source
        Features of the two scans; the normals must be oriented towards the sensor.
    """
    ours, theirs = _Features.of(target), _Features.of(source)
    return [_offsets(rotation, ours, theirs) for rotation in rotations]


def direction_classes(normals: Points, weights: Scalars) -> tuple[Array, Array]:
    """Gather normals into classes of one direction (signed), by falling weight; give mean directions and weights."""
    from algorithms.matching import plane_triples_kernels as kernels

    means, totals = np.empty((len(normals), 3)), np.empty(len(normals))
    heaviest_first = np.argsort(-weights, kind="stable")
    found = kernels.direction_classes(normals, weights, heaviest_first, SAME_DIRECTION_COSINE, means, totals)
    order = np.argsort(-totals[:found], kind="stable")
    return means[order], totals[order]


def _rotations(target: _Features, source: _Features, max_angle_rad: float) -> Matrices3:
    """Find the rotations that lay most normals on normals: each pair of directions of equal angle proposes one."""
    directions_t, weights_t = (part[:MAX_DIRECTIONS] for part in direction_classes(target.normals, target.areas))
    directions_s, weights_s = (part[:MAX_DIRECTIONS] for part in direction_classes(source.normals, source.areas))
    pairs_t, pairs_s = _direction_pairs(directions_t), _direction_pairs(directions_s)
    if len(pairs_t) == 0 or len(pairs_s) == 0:
        return np.empty((0, 3, 3))
    angles_t, angles_s = (
        np.arccos(np.clip(np.einsum("ij,ij->i", d[p[:, 0]], d[p[:, 1]]), -1.0, 1.0))
        for d, p in ((directions_t, pairs_t), (directions_s, pairs_s))
    )
    i, j = np.nonzero(np.abs(angles_t[:, None] - angles_s[None, :]) < 2.0 * max_angle_rad)
    frames_t, frames_s = (
        bisector_frames(d[p[:, 0]], d[p[:, 1]]) for d, p in ((directions_t, pairs_t[i]), (directions_s, pairs_s[j]))
    )
    proposals = frames_t @ np.swapaxes(frames_s, 1, 2)
    # How well all directions agree: each source direction with the best target direction, weight the smaller area.
    cosines = np.einsum("hij,sj,ti->hst", proposals, directions_s, directions_t)
    agreeing = np.where(cosines > AGREEING_COSINE, np.minimum(weights_s[:, None], weights_t[None, :]), 0.0)
    votes = agreeing.max(axis=2).sum(axis=1)
    leaders, _ = rotation_clusters(proposals, votes, radius_rad=3.0 * max_angle_rad, most=4 * MAX_ROTATIONS)
    cosines = np.einsum("hij,sj,ti->hst", leaders, directions_s, directions_t)
    agreeing = np.where(cosines > AGREEING_COSINE, np.minimum(weights_s[:, None], weights_t[None, :]), 0.0)
    order = np.argsort(-agreeing.max(axis=2).sum(axis=1), kind="stable")
    return _distinct(nearest_rotations(np.einsum("hst,ti,sj->hij", agreeing[order], directions_t, directions_s)))


def _distinct(rotations: Matrices3) -> Array:
    """Keep the first of those that the agreeing directions have made the same, `MAX_ROTATIONS` in all."""
    # trace(R1' R2) = 1 + 2 cos(angle)
    same = np.einsum("aij,bij->ab", rotations, rotations) > 1.0 + 2.0 * np.cos(SAME_ROTATION_RAD)
    chosen: list[int] = []
    for k in range(len(rotations)):
        if not same[k, chosen].any():
            chosen.append(k)
            if len(chosen) == MAX_ROTATIONS:
                break
    return rotations[chosen]


def _direction_pairs(directions: Points) -> Array:
    """Give the ordered pairs of directions that are far from parallel."""
    sines = np.linalg.norm(np.cross(directions[:, None, :], directions[None, :, :]), axis=2)
    return np.argwhere(sines > LEAST_SINE)


def _offsets(rotation: Matrix3, target: _Features, source: _Features) -> OffsetVotes:
    """Find the strongest offsets along up to three independent directions."""
    moved_normals, moved_centroids = source.normals @ rotation.T, source.centroids @ rotation.T
    agreeing = target.normals @ moved_normals.T > AGREEING_COSINE
    directions, weights = direction_classes(target.normals, target.areas * agreeing.any(axis=1))
    lines = _line_offsets(rotation, target.described, source.described)
    directions = directions[weights > 0.0]
    axes = _independent(directions)
    if len(axes) < 3 and len(directions) and len(lines[2]):
        axes = _independent(np.vstack([directions, _across_lines(lines[1], lines[2], directions[0])]))
    found = []
    for axis in axes:
        t, s = np.nonzero(agreeing & (np.abs(target.normals @ axis) > AGREEING_COSINE)[:, None])
        across = np.abs(lines[1] @ axis) < ACROSS_SINE
        offsets = np.concatenate([target.centroids[t] @ axis - moved_centroids[s] @ axis, lines[0][across] @ axis])
        if len(offsets):
            areas = np.concatenate([np.minimum(target.areas[t], source.areas[s]), LINE_WIDTH_M * lines[2][across]])
            found.append((axis, *_peaks(offsets, np.sqrt(areas))))
    kept, peaks, votes = zip(*found, strict=True) if found else ((), (), ())
    return OffsetVotes(rotation, np.array(kept).reshape(-1, 3), tuple(peaks), tuple(votes))


def _combined(votes: OffsetVotes) -> Motions:
    """Lay every strong offset along one axis together with every one along the others."""
    right_sides = np.stack(np.meshgrid(*votes.offsets_m, indexing="ij"), axis=-1).reshape(-1, 3)
    totals = np.stack(np.meshgrid(*votes.votes, indexing="ij"), axis=-1).reshape(-1, 3).sum(axis=1)
    translations = np.linalg.solve(votes.axes, right_sides.T).T
    rotations = np.broadcast_to(votes.rotation, (len(translations), 3, 3)).copy()
    return Motions(rotations, np.ascontiguousarray(translations), totals)


def _line_offsets(rotation: Matrix3, ours: DescribedLines, theirs: DescribedLines) -> tuple[Points, Points, Scalars]:
    """Pair lines that a rotation lays in parallel: how far they are apart, directions, lengths of the shorter ones."""
    directions = theirs.lines.directions @ rotation.T
    parallel = np.abs(ours.lines.directions @ directions.T) > AGREEING_COSINE
    i, j = np.nonzero(parallel & alike_lines(ours, theirs, rotation))
    middles = [np.mean(each.lines.end_points, axis=0) for each in (ours, theirs)]
    return (
        middles[0][i] - middles[1][j] @ rotation.T,
        ours.lines.directions[i],
        np.minimum(ours.lines.lengths[i], theirs.lines.lengths[j]),
    )


def _across_lines(directions: Array, lengths: Array, first: Vector3) -> Points:
    """Give directions across the lines, those of the longest lines first, perpendicular to a given one if possible."""
    # the sign of a line's direction means nothing
    largest = np.argmax(np.abs(directions), axis=1)
    signs = np.sign(directions[np.arange(len(directions)), largest])
    along, _ = direction_classes(directions * signs[:, None], lengths)
    across = np.cross(along, first)
    sines = np.linalg.norm(across, axis=1)
    aligned = sines < LEAST_SINE
    across[aligned] = bases_of(along[aligned])[:, :, 0]
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return np.stack([across, np.cross(along, across)], axis=1).reshape(-1, 3)


def _independent(directions: Points) -> Array:
    """Pick three directions, the heaviest first, each far from the span of those before; fewer if there are none."""
    from algorithms.matching import plane_triples_kernels as kernels

    chosen = np.empty(3, dtype=np.int64)
    return np.asarray(directions[chosen[: kernels.independent(directions, LEAST_SINE, chosen)]])


def _peaks(offsets: Scalars, weights: Scalars) -> tuple[Array, Array]:
    """Find the offsets with most votes: mean of the votes within a bin's width around each peak."""
    from algorithms.matching import plane_triples_kernels as kernels

    means, votes = np.empty((2, MAX_PEAKS))
    found = kernels.peaks(offsets, weights, VOTE_BIN_M, means, votes)
    return means[:found], votes[:found]
