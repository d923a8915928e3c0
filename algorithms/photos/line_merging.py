"""Pieces of one straight edge become one line."""

from dataclasses import replace

import numpy as np

from algorithms.arrays import Array, Flags, IndexPairs, Indices, Scalars
from algorithms.photos.line_fit import EdgeLines
from algorithms.photos.line_merging_kernels import near_lines

SAMPLE_PX = 10.0
"""Neighbours are looked for around points of the lines this far apart [px]."""
ACROSS_PX = 1.0
"""Pieces of one edge lie no further from their common line [px]."""
LARGEST_ANGLE_RAD = float(np.deg2rad(3.0))
LARGEST_DOUBLE_ANGLE_RAD = float(np.deg2rad(10.0))
DOUBLE_PX = 1.5
MAX_ROUNDS = 3
"""Every round joins lines in pairs: so many rounds join eight pieces."""


def merge_collinear(lines: EdgeLines, max_gap_px: float) -> EdgeLines:
    """Join lines that continue or overlap each other, are bright on the same side and fit one straight line.

    Gaps of up to `max_gap_px` are bridged. Lines are joined in pairs, the longest first, round by round, so that of
    the pieces of a bent edge only those are joined that are straight together.
    """
    known = 0
    for _ in range(MAX_ROUNDS):
        first, second = _partners(lines, max_gap_px, known)
        if len(first) == 0:
            break
        joined = _joined(lines, first, second)
        alone = np.ones(len(lines), dtype=bool)
        alone[first] = alone[second] = False
        lines = _together(lines[alone], joined)
        # two lines that both were left alone do not fit each other: had they, one of them would have been joined
        known = int(alone.sum())
    return lines


def neighbouring_pairs(lines: EdgeLines, distance_px: float, known: int = 0) -> IndexPairs:
    """Give pairs (i, j), i < j, of nearly parallel lines of which some points are about `distance_px` apart or less.

    Pairs among the first `known` lines are left out.
    """
    counts = np.maximum(1, np.ceil(lines.lengths / SAMPLE_PX).astype(np.int64)) + 1
    owners = np.repeat(np.arange(len(lines)), counts)
    rank = np.arange(len(owners)) - np.repeat(np.cumsum(counts) - counts, counts)
    along = lines.extents[owners, 0] + rank * (lines.lengths / (counts - 1))[owners]
    points = lines.centres[owners] + along[:, None] * lines.directions[owners]
    near = near_lines(points, owners, max(distance_px, 0.6 * SAMPLE_PX), known)
    cosine = np.abs(np.sum(lines.directions[near[:, 0]] * lines.directions[near[:, 1]], axis=1))
    near = near[cosine > np.cos(LARGEST_DOUBLE_ANGLE_RAD)]
    return np.asarray(near[np.lexsort((near[:, 1], near[:, 0]))])


def _moments(lines: EdgeLines, chosen: Indices, origin: Array) -> tuple[Scalars, Array, Array]:
    """Give length, first and second moment about `origin` of lines as thin rods."""
    length = lines.lengths[chosen]
    middle = lines.centres[chosen] + lines.extents[chosen].mean(axis=1)[:, None] * lines.directions[chosen] - origin
    direction = lines.directions[chosen]
    second = middle[:, :, None] * middle[:, None, :]
    second = second + (length**2 / 12.0)[:, None, None] * direction[:, :, None] * direction[:, None, :]
    return length, length[:, None] * middle, length[:, None, None] * second


def _joined(lines: EdgeLines, first: Indices, second: Indices) -> EdgeLines:
    """Give the common lines of pairs: the axis of inertia of both rods, from the first start to the last end."""
    origin = lines.centres[first]
    (la, fa, sa), (lb, fb, sb) = _moments(lines, first, origin), _moments(lines, second, origin)
    total = la + lb
    mean = (fa + fb) / total[:, None]
    scatter = (sa + sb) / total[:, None, None] - mean[:, :, None] * mean[:, None, :]
    angle = 0.5 * np.arctan2(2.0 * scatter[:, 0, 1], scatter[:, 0, 0] - scatter[:, 1, 1])
    directions = np.column_stack([np.cos(angle), np.sin(angle)])
    directions *= np.where(np.sum(directions * lines.directions[first], axis=1) < 0.0, -1.0, 1.0)[:, None]
    centres = origin + mean
    ends = np.concatenate([_ends(lines, first), _ends(lines, second)], axis=1)
    along = np.einsum("nij,nj->ni", ends - centres[:, None], directions)
    return EdgeLines(
        centres=centres,
        directions=directions,
        extents=np.column_stack([along.min(axis=1), along.max(axis=1)]),
        widths=(la * lines.widths[first] + lb * lines.widths[second]) / total,
        half_widths=np.minimum(lines.half_widths[first], lines.half_widths[second]),
    )


def _ends(lines: EdgeLines, chosen: Indices) -> Array:
    return np.asarray(
        lines.centres[chosen][:, None] + lines.extents[chosen][:, :, None] * lines.directions[chosen][:, None]
    )


def _partners(lines: EdgeLines, max_gap_px: float, known: int) -> tuple[Indices, Indices]:
    """Choose pairs to join, every line at most once, the longest first; none among the first `known` lines."""
    if len(lines) < 2:
        none = np.zeros(0, dtype=np.int64)
        return none, none
    pairs = neighbouring_pairs(lines, max_gap_px + 1.0, known)
    first, second = pairs[:, 0], pairs[:, 1]
    cosine = np.sum(lines.directions[first] * lines.directions[second], axis=1)
    pairs = pairs[cosine > np.cos(LARGEST_ANGLE_RAD)]
    first, second = pairs[:, 0], pairs[:, 1]
    ok = _one_line(lines, first, second, max_gap_px)
    first, second = first[ok], second[ok]
    order = np.argsort(-(lines.lengths[first] + lines.lengths[second]), kind="stable")
    taken = np.zeros(len(lines), dtype=bool)
    chosen = []
    for k in order:
        if not (taken[first[k]] or taken[second[k]]):
            taken[first[k]] = taken[second[k]] = True
            chosen.append(k)
    keep = np.array(chosen, dtype=np.int64)
    return first[keep], second[keep]


def _one_line(lines: EdgeLines, first: Indices, second: Indices, max_gap_px: float) -> Flags:
    """Tell which pairs fit one straight line with a gap of at most `max_gap_px`."""
    common = _joined(lines, first, second)
    ends = np.stack([_ends(lines, first), _ends(lines, second)], axis=1)
    relative = ends - common.centres[:, None, None]
    across = np.abs(np.einsum("npei,ni->npe", relative, common.normals)).max(axis=(1, 2))
    along = np.sort(np.einsum("npei,ni->npe", relative, common.directions), axis=2)
    gap = np.maximum(along[:, 0, 0], along[:, 1, 0]) - np.minimum(along[:, 0, 1], along[:, 1, 1])
    return np.asarray((across <= ACROSS_PX) & (gap <= max_gap_px))


def without_doubles(lines: EdgeLines) -> EdgeLines:
    """Leave out lines that run for the most part beside a longer one of the same edge, bright on the same side.

    Beside means within `DOUBLE_PX` or the width of the edge's profile: one edge has one place.
    """
    if len(lines) < 2:
        return lines
    pairs = neighbouring_pairs(lines, SAMPLE_PX)
    swap = lines.lengths[pairs[:, 0]] < lines.lengths[pairs[:, 1]]
    longer, shorter = np.where(swap, pairs[:, 1], pairs[:, 0]), np.where(swap, pairs[:, 0], pairs[:, 1])
    cosine = np.sum(lines.directions[longer] * lines.directions[shorter], axis=1)
    relative = _ends(lines, shorter) - lines.centres[longer][:, None]
    across = np.abs(np.einsum("nei,ni->ne", relative, lines.normals[longer])).mean(axis=1)
    along = np.einsum("nei,ni->ne", relative, lines.directions[longer])
    overlap = np.minimum(along.max(axis=1), lines.extents[longer, 1])
    overlap -= np.maximum(along.min(axis=1), lines.extents[longer, 0])
    double = (
        (cosine > np.cos(LARGEST_DOUBLE_ANGLE_RAD))
        & (across < np.maximum(DOUBLE_PX, lines.widths[longer]))
        & (overlap > 0.5 * lines.lengths[shorter])
    )
    keep = np.ones(len(lines), dtype=bool)
    keep[shorter[double]] = False
    return lines[keep]


def _together(lines: EdgeLines, others: EdgeLines) -> EdgeLines:
    return replace(
        lines,
        centres=np.concatenate([lines.centres, others.centres]),
        directions=np.concatenate([lines.directions, others.directions]),
        extents=np.concatenate([lines.extents, others.extents]),
        widths=np.concatenate([lines.widths, others.widths]),
        half_widths=np.concatenate([lines.half_widths, others.half_widths]),
    )
