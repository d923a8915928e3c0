"""Lichtenstein's combinatorial solution: pairs of lines that look alike give motions (MATH 1.7, 5.5).

In a rectangular building angle and distance of two lines say next to nothing. So each line carries what it is made of:
the oriented normals of the two planes that meet in it, or the radius of the cylinder whose axis it is. The invariants
of all pairs of one scan are sorted by kinds and distance, those of the other scan look up their like.
"""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, Flags, IndexPairs, Labels, Matrices3, Points, Scalars
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.line_pairs_geometry import PairGeometry, bisector_frames, line_pairs_of, pair_geometry
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
    numbers = [_pairs(lines.lines) for lines in described]
    if min(len(pairs) for pairs in numbers) == 0:
        return Motions.empty()
    # Source pairs are entered in both orders, so that no exchange needs to be looked at.
    numbers[1] = np.concatenate([numbers[1], numbers[1][:, ::-1]])
    ours, theirs = (_Pairs.of(lines, pairs) for lines, pairs in zip(described, numbers, strict=True))
    matches = look_alikes(*(each.invariants(max_angle_rad, max_distance_m) for each in (ours, theirs)))
    if len(matches) == 0:
        return Motions.empty()
    return joined([_motions(ours, theirs, matches, signs, max_angle_rad, max_distance_m) for signs in SIGNS])


@dataclass(frozen=True, eq=False)
class _Pairs:
    """n pairs of lines of one scan, and what is asked of each more than once."""

    described: DescribedLines
    numbers: IndexPairs
    """(n, 2) of the two lines."""
    geometry: PairGeometry
    angles: Scalars
    """(n,) between the directions as they are given [rad]."""
    passes_m: Scalars
    """(n,) distance, with the sign of the side on which the second line passes the first [m]."""
    frames: Matrices3
    """(n, 3, 3) bisectors of the directions, as columns."""
    signed: tuple[Array, Array]
    """For each of the two lines (n, 2) what changes its sign with the line's direction."""

    @staticmethod
    def of(described: DescribedLines, numbers: IndexPairs) -> "_Pairs":
        """Work out what pairs look like."""
        pairs = line_pairs_of(described.lines, numbers)
        geometry = pair_geometry(pairs)
        angles = np.arccos(np.clip(geometry.cosines, -1.0, 1.0))
        first, second = described.bisectors[numbers[:, 0]], described.bisectors[numbers[:, 1]]
        normal = np.cross(first, second)
        of_first, of_second = (
            np.column_stack([np.einsum("ij,ij->i", direction, other), np.einsum("ij,ij->i", direction, normal)])
            for direction, other in ((pairs.directions_a, second), (pairs.directions_b, first))
        )
        frames = bisector_frames(pairs.directions_a, pairs.directions_b)
        return _Pairs(
            described, numbers, geometry, angles, geometry.moments_m / np.sin(angles), frames, (of_first, of_second)
        )

    def invariants(self, max_angle_rad: float, max_distance_m: float) -> Array:
        """Compute what no motion and no choice of direction signs changes, in units of the limits, (n, 12).

        Angle of the lines, distance, the bisectors' relation to each other, to the other line and to the common
        perpendicular (with its hand: the triple product changes sign for a mirrored pair), openings or radii, and kinds
        (spaced so far apart that different kinds never meet).
        """
        first, second = (self.described.bisectors[self.numbers[:, side]] for side in (0, 1))
        across = self.geometry.feet_b - self.geometry.feet_a

        def dots(a: Array, b: Array) -> Array:
            return np.asarray(np.einsum("ij,ij->i", a, b))

        angles = np.column_stack(
            [
                np.abs(self.geometry.cosines),
                dots(first, second),
                np.abs(self.signed[1][:, 0]),
                np.abs(self.signed[0][:, 0]),
            ]
        )
        distances = np.column_stack(
            [
                self.geometry.distances_m,
                dots(first, across),
                dots(second, across),
                dots(np.cross(first, second), across),
            ]
        )
        kinds = self.described.kinds[self.numbers]
        # Radii are compared ten times more finely than positions.
        sizes = self.described.sizes[self.numbers] / np.where(kinds >= 2, 0.1 * max_distance_m, 2.0 * max_angle_rad)
        return np.hstack([angles / (1.5 * max_angle_rad), distances / max_distance_m, sizes, 1e3 * kinds])


def _motions(
    ours: _Pairs,
    theirs: _Pairs,
    matches: IndexPairs,
    signs: tuple[float, float],
    max_angle_rad: float,
    max_distance_m: float,
) -> Motions:
    """Lay pair on pair with the source lines' directions as given or reversed, where that also lays normals on normals.

    The rotation turns bisectors of the directions onto bisectors, the translation lays the middle of the common
    perpendicular on the middle of the other (MATH 1.7).
    """
    # what can be told without the rotation saves it for three in four
    possible = np.ones(len(matches), dtype=np.bool_)
    for side in (0, 1):
        differences = ours.signed[side][matches[:, 0]] - signs[side] * theirs.signed[side][matches[:, 1]]
        possible &= (np.abs(differences) < 6.0 * max_angle_rad).all(axis=1)
    # reversing one of two directions changes the signs of cosine and moment
    reverse = signs[0] * signs[1]
    wanted, given = matches[possible].T
    angles = theirs.angles if reverse > 0.0 else np.pi - theirs.angles
    good = np.abs(ours.angles[wanted] - angles[given]) <= 1.5 * max_angle_rad
    good &= np.abs(ours.passes_m[wanted] - reverse * theirs.passes_m[given]) <= 2.0 * max_distance_m
    wanted, given = wanted[good], given[good]
    rotations = rotation_from_frames(_reversed(theirs.frames, signs)[given], ours.frames[wanted])
    good = np.ones(len(wanted), dtype=np.bool_)
    for side in (0, 1):
        line, other = ours.numbers[wanted, side], theirs.numbers[given, side]
        turned = np.einsum("nij,nj->ni", rotations, theirs.described.bisectors[other])
        agreement = np.einsum("ni,ni->n", turned, ours.described.bisectors[line])
        good &= ours.described.are_axes[line] | (agreement > np.cos(3.0 * max_angle_rad))
    rotations = rotations[good]
    middles = [
        0.5 * (each.feet_a[pairs[good]] + each.feet_b[pairs[good]])
        for each, pairs in ((ours.geometry, wanted), (theirs.geometry, given))
    ]
    translations = middles[0] - np.einsum("nij,nj->ni", rotations, middles[1])
    return Motions(rotations, translations, np.ones(len(rotations)))


def _reversed(frames: Matrices3, signs: tuple[float, float]) -> Array:
    """Give the bisectors, (n, 3, 3), of directions of which some are reversed: sum and difference change places."""
    if signs[0] == signs[1]:
        return np.asarray(frames * np.array([signs[0], signs[0], 1.0]))
    return np.asarray(frames[:, :, [1, 0, 2]] * np.array([signs[0], signs[0], -1.0]))


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
