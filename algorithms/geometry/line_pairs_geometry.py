"""Pairs of lines: their invariants, and the motions that carry one pair onto another (MATH 1.7, 1.8, 5.5)."""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, IndexPairs, Points, Scalars
from algorithms.errors import InvalidInputError
from algorithms.geometry.lines import Lines
from algorithms.geometry.rotations import rotation_from_frames

PARALLEL_SINE = 1e-6
"""Below this sine of the angle two lines count as parallel: they have no common perpendicular of their own."""

ASSIGNMENTS = np.array(
    [[swap, first, second] for swap in (0, 1) for first in (1, -1) for second in (1, -1)], dtype=np.int64
)
"""(8, 3) ways to lay source pair (A, B) on target pair (A, B): exchanged or not, sign of the source line laid on
target A, sign of the one laid on target B. Lichtenstein's table lists 16, every one of these twice (MATH 5.5)."""


@dataclass(frozen=True, eq=False)
class LinePairs:
    """n pairs of lines A and B in one frame, column by column."""

    anchors_a: Points
    """(n, 3) a point of line A [m]."""
    directions_a: Points
    """(n, 3) unit direction of line A."""
    anchors_b: Points
    """(n, 3) a point of line B [m]."""
    directions_b: Points
    """(n, 3) unit direction of line B."""

    def __len__(self) -> int:
        return len(self.anchors_a)


@dataclass(frozen=True, eq=False)
class PairGeometry:
    """What n pairs of lines look like, column by column.

    (|cosine|, distance, chirality) is the complete invariant of an undirected pair under rigid motions.
    """

    cosines: Scalars
    """(n,) dA.dB; changes sign when one direction is reversed."""
    moments_m: Scalars
    """(n,) reciprocal product (dA x dB).(qA - qB) [m]; changes sign when one direction is reversed."""
    distances_m: Scalars
    """(n,) shortest distance of the two lines [m]."""
    chirality: Scalars
    """(n,) sign of cosine times moment: +1, -1, or 0 for orthogonal or intersecting pairs; direction signs cancel."""
    feet_a: Points
    """(n, 3) foot of the common perpendicular on A [m]; for parallel pairs A's anchor."""
    feet_b: Points
    """(n, 3) foot of the common perpendicular on B [m]; for parallel pairs the point of B next to A's anchor."""


@dataclass(frozen=True, eq=False)
class PairMotions:
    """All motions that lay source pairs on target pairs: n pairs times the 8 `ASSIGNMENTS`."""

    rotations: Array
    """(n, 8, 3, 3) proper rotations, target from source."""
    translations_m: Array
    """(n, 8, 3) translations [m]."""
    angle_misfits_rad: Array
    """(n, 8) difference of the angles between the lines [rad]; what no motion can remove."""
    distance_misfits_m: Array
    """(n, 8) difference of the distances, signed by the side on which B passes A [m]; what no motion can remove."""

    def proper(self, max_angle_rad: float, max_distance_m: float) -> Array:
        """Say which motions really carry pair onto pair, (n, 8): angle and signed distance agree within the limits.

        Of the 8 assignments 4 do for a skew or an intersecting pair, all 8 for an intersecting orthogonal one.
        """
        return np.asarray((self.angle_misfits_rad <= max_angle_rad) & (self.distance_misfits_m <= max_distance_m))


def line_pairs_of(lines: Lines, pairs: IndexPairs) -> LinePairs:
    """Gather pairs from a record of lines.

    Parameters
    ----------
    lines
        Lines of one frame.
    pairs
        (n, 2) numbers of line A and line B of each pair.
    """
    a, b = pairs[:, 0], pairs[:, 1]
    return LinePairs(lines.anchors[a], lines.directions[a], lines.anchors[b], lines.directions[b])


def pair_geometry(pairs: LinePairs) -> PairGeometry:
    """Compute angle, reciprocal product, distance, chirality and foot points of each pair (MATH 1.7)."""
    normals = np.cross(pairs.directions_a, pairs.directions_b)
    squared_sines = _dots(normals, normals)
    between = pairs.anchors_a - pairs.anchors_b
    cosines = _dots(pairs.directions_a, pairs.directions_b)
    moments = _dots(normals, between)
    parallel = squared_sines < PARALLEL_SINE**2
    divisor = np.where(parallel, 1.0, squared_sines)
    # Parameters of the feet from (qA + s dA) - (qB + u dB) being parallel to dA x dB.
    along_a = np.where(parallel, 0.0, -_dots(np.cross(between, pairs.directions_b), normals) / divisor)
    feet_a = pairs.anchors_a + along_a[:, None] * pairs.directions_a
    along_b = _dots(feet_a - pairs.anchors_b, pairs.directions_b)
    feet_b = pairs.anchors_b + along_b[:, None] * pairs.directions_b
    return PairGeometry(
        cosines=cosines,
        moments_m=moments,
        distances_m=np.linalg.norm(feet_a - feet_b, axis=1),
        chirality=np.sign(cosines * moments),
        feet_a=feet_a,
        feet_b=feet_b,
    )


def motions_between_pairs(target: LinePairs, source: LinePairs) -> PairMotions:
    """Give for each k the 8 motions that lay source pair k on target pair k, in closed form.

    The rotation turns bisectors onto bisectors (the best one for two directions when their angles differ a little),
    the translation lays the middle of the common perpendicular on the middle of the other: the distances' difference
    is shared evenly.

    Parameters
    ----------
    target, source
        n pairs each, pair k to pair k.

    Raises
    ------
    InvalidInputError
        When a pair is parallel (sine below `PARALLEL_SINE`): it leaves the motion free along the lines.
    """
    target_geometry, source_geometry = pair_geometry(target), pair_geometry(source)
    target_sines, source_sines = (
        np.linalg.norm(np.cross(pairs.directions_a, pairs.directions_b), axis=1) for pairs in (target, source)
    )
    if (target_sines < PARALLEL_SINE).any() or (source_sines < PARALLEL_SINE).any():
        raise InvalidInputError("line pairs", "parallel lines fix no motion", "leave parallel pairs out")
    swapped = ASSIGNMENTS[None, :, :1] == 1
    a, b = source.directions_a[:, None, :], source.directions_b[:, None, :]
    first = np.where(swapped, b, a) * ASSIGNMENTS[None, :, 1:2]
    second = np.where(swapped, a, b) * ASSIGNMENTS[None, :, 2:3]
    target_frames = bisector_frames(target.directions_a, target.directions_b)[:, None]
    rotations = rotation_from_frames(bisector_frames(first, second), target_frames)
    target_middle = 0.5 * (target_geometry.feet_a + target_geometry.feet_b)
    source_middle = 0.5 * (source_geometry.feet_a + source_geometry.feet_b)
    translations = target_middle[:, None, :] - np.einsum("nhij,nj->nhi", rotations, source_middle)
    # Reversing one of the two directions turns the sign of cosine and moment; exchanging A and B keeps both.
    signs = (ASSIGNMENTS[:, 1] * ASSIGNMENTS[:, 2])[None, :]
    target_angles = np.arctan2(target_sines, target_geometry.cosines)[:, None]
    source_angles = np.arctan2(source_sines[:, None], signs * source_geometry.cosines[:, None])
    target_distances = (target_geometry.moments_m / target_sines)[:, None]
    source_distances = signs * (source_geometry.moments_m / source_sines)[:, None]
    return PairMotions(
        rotations=rotations,
        translations_m=translations,
        angle_misfits_rad=np.abs(target_angles - source_angles),
        distance_misfits_m=np.abs(target_distances - source_distances),
    )


def bisector_frames(first: Array, second: Array) -> Array:
    """Build right-handed orthonormal frames (..., 3, 3): columns along d1 + d2, d1 - d2 and their cross product."""
    u, v = first + second, first - second
    u = u / np.linalg.norm(u, axis=-1, keepdims=True)
    v = v / np.linalg.norm(v, axis=-1, keepdims=True)
    return np.stack([u, v, np.cross(u, v)], axis=-1)


def _dots(first: Array, second: Array) -> Array:
    return np.asarray(np.einsum("ij,ij->i", first, second))
