"""Lichtenstein's combinatorial solution: pairs of lines that look alike give motions (MATH 1.7, 5.5).

In a rectangular building angle and distance of two lines say next to nothing. So each line carries what it is made of:
the oriented normals of the two planes that meet in it, or the radius of the cylinder whose axis it is. The invariants
of all pairs of one scan are sorted by kinds and distance, those of the other scan look up their like.
"""

from dataclasses import dataclass, replace

import numpy as np

from algorithms.arrays import Array, Flags, IndexPairs, Labels, Points, Scalars
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.line_pairs_geometry import bisector_frames, line_pairs_of, pair_geometry
from algorithms.geometry.lines import Lines, LineSource
from algorithms.geometry.rotations import rotation_from_frames
from algorithms.matching.line_pairs_kernels import alike_rows
from algorithms.matching.votes import Motions, joined

MIN_PAIR_SINE = 0.25
"""Pairs with a smaller sine (16 gon) fix the motion badly and are left out."""
MAX_LINES = 140
"""So many of the longest lines of a scan form pairs unless told otherwise."""
MAX_MATCHES = 60_000
"""Of more pairs of pairs than this the rarest are kept."""
KEY_TOLERANCE = 1.0 + 1e-6
"""The keys of pairs that look alike differ by 1 at most, and by rounding."""
SIGNS = ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0))
"""How the directions of a source pair may lie on those of a target pair; the orders are all among the pairs."""


@dataclass(frozen=True, eq=False)
class DescribedLines:
    """Lines with what they are made of."""

    lines: Lines
    kinds: Labels
    """(n,) 0 edge of planes seen from inside (a room's corner), 1 from outside, 2 and 3 axis of a cylinder seen from
    outside or inside, 4 edge in a photo."""
    bisectors: Points
    """(n, 3) unit mean of the two oriented normals, of photo edges the normal of their surface; zero for axes."""
    sizes: Scalars
    """(n,) half the angle between the normals [rad], or the radius [m]; 0 for photo edges."""

    @property
    def are_axes(self) -> Flags:
        """(n,) True for axes of cylinders, which have no normals."""
        return np.asarray((self.kinds == 2) | (self.kinds == 3))


def described_lines(features: ScanFeatures) -> DescribedLines:
    """Attach to each line of a scan its planes' bisector and opening, or its cylinder's radius."""
    lines, planes, cylinders = features.lines, features.planes, features.cylinders
    n = len(lines)
    kinds = np.zeros(n, dtype=np.int32)
    bisectors, sizes = np.zeros((n, 3)), np.zeros(n)
    edges = np.flatnonzero((lines.parents >= 0).all(axis=1) & (lines.sources == int(LineSource.PLANE_INTERSECTION)))
    if len(edges):
        first, second = lines.parents[edges].T
        sums = planes.normals[first] + planes.normals[second]
        lengths = np.linalg.norm(sums, axis=1)
        bisectors[edges] = sums / np.maximum(lengths, 1e-9)[:, None]
        sizes[edges] = np.arccos(np.clip(0.5 * lengths, -1.0, 1.0))
        # Seen from inside, each plane lies on the side its partner's normal points to.
        towards = np.einsum("ij,ij->i", planes.normals[first], planes.centroids[second] - lines.anchors[edges])
        kinds[edges] = np.where(towards > 0.0, 0, 1)
    axes = np.flatnonzero((lines.sources == int(LineSource.CYLINDER_AXIS)) & (lines.parents[:, 0] >= 0))
    if len(axes):
        numbers = lines.parents[axes, 0]
        sizes[axes] = cylinders.radii_m[numbers]
        kinds[axes] = np.where(cylinders.convex[numbers], 2, 3)
    if features.photo_edges is not None:
        in_photos = lines.sources == int(LineSource.PHOTO_EDGE)
        kinds[in_photos] = 4
        bisectors[in_photos] = features.photo_edges.line_normals[in_photos]
    return DescribedLines(lines, kinds, bisectors, sizes)


def line_pair_motions(
    target: ScanFeatures,
    source: ScanFeatures,
    *,
    max_angle_rad: float,
    max_distance_m: float,
    max_lines: int = MAX_LINES,
) -> Motions:
    """Give a motion for every pair of lines of one scan that looks like a pair of the other.

    Parameters
    ----------
    target, source
        Features of the two scans.
    max_angle_rad, max_distance_m
        Within these limits angles and distances count as equal.
    max_lines
        So many of the longest lines of a scan form pairs.

    Returns
    -------
    Motions with one vote each: of the 8 assignments of a pair to a pair those that also lay normals on normals. Pairs
    of axes have no normals: all their proper assignments are kept.
    """
    described = [longest_lines(described_lines(features), max_lines) for features in (target, source)]
    pairs = [_pairs(lines.lines) for lines in described]
    if min(len(p) for p in pairs) == 0:
        return Motions.empty()
    # Source pairs are entered in both orders, so that no exchange needs to be looked at.
    pairs[1] = np.concatenate([pairs[1], pairs[1][:, ::-1]])
    invariants = [
        _invariants(lines, p, max_angle_rad, max_distance_m) for lines, p in zip(described, pairs, strict=True)
    ]
    matches = look_alikes(*invariants)
    if len(matches) == 0:
        return Motions.empty()
    numbers = [pairs[0][matches[:, 0]], pairs[1][matches[:, 1]]]
    signed = [_signed(lines, pairs) for lines, pairs in zip(described, numbers, strict=True)]
    return joined([_motions(described, numbers, signed, signs, max_angle_rad, max_distance_m) for signs in SIGNS])


def _motions(
    described: list[DescribedLines],
    numbers: list[IndexPairs],
    signed: list[tuple[Array, Array]],
    signs: tuple[float, float],
    max_angle_rad: float,
    max_distance_m: float,
) -> Motions:
    """Lay pair on pair with the source lines' directions as given or reversed, where that also lays normals on normals.

    The rotation turns bisectors of the directions onto bisectors, the translation lays the middle of the common
    perpendicular on the middle of the other (MATH 1.7).
    """
    # what can be told without the rotation saves it for three in four
    possible = np.ones(len(numbers[0]), dtype=np.bool_)
    ours, theirs = signed
    for side in (0, 1):
        possible &= (np.abs(ours[side] - signs[side] * theirs[side]) < 6.0 * max_angle_rad).all(axis=1)
    wanted, given = (pairs[possible] for pairs in numbers)
    target, source = line_pairs_of(described[0].lines, wanted), line_pairs_of(described[1].lines, given)
    source = replace(source, directions_a=signs[0] * source.directions_a, directions_b=signs[1] * source.directions_b)
    rotations = rotation_from_frames(
        bisector_frames(source.directions_a, source.directions_b),
        bisector_frames(target.directions_a, target.directions_b),
    )
    ours_there, theirs_there = pair_geometry(target), pair_geometry(source)
    angles = [np.arccos(np.clip(geometry.cosines, -1.0, 1.0)) for geometry in (ours_there, theirs_there)]
    good = np.abs(angles[0] - angles[1]) <= 1.5 * max_angle_rad
    # with its sign: the side on which the second line passes the first
    passes = [
        geometry.moments_m / np.sin(angle) for geometry, angle in zip((ours_there, theirs_there), angles, strict=True)
    ]
    good &= np.abs(passes[0] - passes[1]) <= 2.0 * max_distance_m
    for side in (0, 1):
        turned = np.einsum("nij,nj->ni", rotations, described[1].bisectors[given[:, side]])
        agreement = np.einsum("ni,ni->n", turned, described[0].bisectors[wanted[:, side]])
        good &= described[0].are_axes[wanted[:, side]] | (agreement > np.cos(3.0 * max_angle_rad))
    middles = [0.5 * (geometry.feet_a + geometry.feet_b)[good] for geometry in (ours_there, theirs_there)]
    rotations = rotations[good]
    translations = middles[0] - np.einsum("nij,nj->ni", rotations, middles[1])
    return Motions(rotations, translations, np.ones(len(rotations)))


def _signed(described: DescribedLines, pairs: IndexPairs) -> tuple[Array, Array]:
    """Give for both lines of each pair what changes its sign with the line's direction, (n, 2) each."""
    first, second = described.bisectors[pairs[:, 0]], described.bisectors[pairs[:, 1]]
    normal = np.cross(first, second)
    return tuple(  # type: ignore[return-value]
        np.column_stack([np.einsum("ij,ij->i", direction, other), np.einsum("ij,ij->i", direction, normal)])
        for direction, other in (
            (described.lines.directions[pairs[:, 0]], second),
            (described.lines.directions[pairs[:, 1]], first),
        )
    )


def longest_lines(described: DescribedLines, most: int) -> DescribedLines:
    """Keep the longest lines, in their order."""
    order = np.sort(np.argsort(-described.lines.lengths, kind="stable")[:most])
    return DescribedLines(
        described.lines[order], described.kinds[order], described.bisectors[order], described.sizes[order]
    )


def _pairs(lines: Lines) -> IndexPairs:
    """Give the pairs of lines that are not nearly parallel."""
    i, j = np.triu_indices(len(lines), k=1)
    sines = np.linalg.norm(np.cross(lines.directions[i], lines.directions[j]), axis=1)
    usable = sines > MIN_PAIR_SINE
    return np.column_stack([i[usable], j[usable]]).astype(np.int64)


def _invariants(described: DescribedLines, pairs: IndexPairs, max_angle_rad: float, max_distance_m: float) -> Array:
    """Compute what no motion and no choice of direction signs changes, in units of the limits, (n, 12).

    Angle of the lines, distance, the bisectors' relation to each other, to the other line and to the common
    perpendicular (with its hand: the triple product changes sign for a mirrored pair), openings or radii, and kinds
    (spaced so far apart that different kinds never meet).
    """
    geometry = pair_geometry(line_pairs_of(described.lines, pairs))
    first, second = described.bisectors[pairs[:, 0]], described.bisectors[pairs[:, 1]]
    direction_a = described.lines.directions[pairs[:, 0]]
    direction_b = described.lines.directions[pairs[:, 1]]
    across = geometry.feet_b - geometry.feet_a

    def dots(a: Array, b: Array) -> Array:
        return np.asarray(np.einsum("ij,ij->i", a, b))

    angles = np.column_stack(
        [
            np.abs(geometry.cosines),
            dots(first, second),
            np.abs(dots(first, direction_b)),
            np.abs(dots(second, direction_a)),
        ]
    )
    distances = np.column_stack(
        [
            geometry.distances_m,
            dots(first, across),
            dots(second, across),
            dots(np.cross(first, second), across),
        ]
    )
    kinds = described.kinds[pairs]
    # Radii are compared ten times more finely than positions.
    sizes = described.sizes[pairs] / np.where(kinds >= 2, 0.1 * max_distance_m, 2.0 * max_angle_rad)
    return np.hstack([angles / (1.5 * max_angle_rad), distances / max_distance_m, sizes, 1e3 * kinds])


def look_alikes(target: Array, source: Array) -> IndexPairs:
    """Find all (target pair, source pair) whose invariants differ by no more than 1 in each entry.

    Parameters
    ----------
    target, source
        (n, 12) and (m, 12) invariants, in units of what may differ.

    Returns
    -------
    (matches, 2) their numbers, ordered; of more than `MAX_MATCHES` those of the target's rarest pairs.
    """
    keys, wanted = _keys(source), _keys(target)
    order = np.argsort(keys, kind="stable")
    first = np.searchsorted(keys[order], wanted - KEY_TOLERANCE, side="left")
    stop = np.searchsorted(keys[order], wanted + KEY_TOLERANCE, side="right")
    matches: IndexPairs = alike_rows(np.ascontiguousarray(target), source[order], first, stop)
    # they come by the target's pairs; one number each sorts faster than two columns
    numbers = np.sort(matches[:, 0] * len(source) + order[matches[:, 1]])
    matches = np.column_stack(np.divmod(numbers, max(len(source), 1)))
    if len(matches) <= MAX_MATCHES:
        return matches
    # rare pairs say more than common ones: the matches of the pairs with the fewest are kept
    counts = np.bincount(matches[:, 0], minlength=len(target))
    rarest = np.argsort(counts, kind="stable")
    kept = np.empty_like(counts)
    kept[rarest] = MAX_MATCHES - (np.cumsum(counts[rarest]) - counts[rarest])
    rank = np.arange(len(matches)) - (np.cumsum(counts) - counts)[matches[:, 0]]
    return np.asarray(matches[rank < kept[matches[:, 0]]])


def _keys(invariants: Array) -> Scalars:
    """Give a number for each pair, of kinds and distance, that differs by 1 at most between pairs that look alike."""
    return np.asarray(invariants[:, 4] + 10.0 * invariants[:, 10] + 100.0 * invariants[:, 11])
