"""The coarse registration of M. Lichtenstein's dissertation (RWTH Aachen 2011), eqs. 4.16 to 4.50, misprints corrected.

Pairs of lines are described by their angle and their shortest distance; a correspondence matrix compares every pair of
one scan with every pair of the other; each good entry gives sixteen motions; the most frequent motion wins, and the
pairs that agree on it say which line is which. Angle and distance alone say little in a rectangular building, so this
needs luck where `algorithms.matching` does not.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from jaxtyping import Float64, Int64
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Array, IndexPairs, Labels, Matrix3, OtherIndexPairs, Scalars, Vector3
from algorithms.errors import TooFewCorrespondencesError
from algorithms.geometry.line_pairs_geometry import PARALLEL_SINE, LinePairs, line_pairs_of, pair_geometry
from algorithms.geometry.lines import Lines
from algorithms.geometry.rotations import rotation_from_frames
from algorithms.matching.votes import Motions, nearest_rotations, vote_motions
from algorithms.registration.lines_compat import PairVotingOptions

MOST_ROTATIONS = 200
"""So many clusters of rotations are looked into for the most frequent motion."""
CENTRING_WIDTHS = (3.0, 2.0, 1.0, 1.0, 1.0)
"""Rounds in which the winner becomes the mean of those that agree with it, within so many times the limits."""

CASES = np.array(
    [
        [lead, other, first, second]
        for first, second in ((1, 1), (-1, -1), (-1, 1), (1, -1))
        for lead, other in ((0, 0), (0, 1), (1, 0), (1, 1))
    ],
    dtype=np.int64,
)
"""(16, 4) the dissertation's cases in its order: which source line (0: 12, 1: 34) is laid on which target line (0: AB,
1: CD), and the signs of the directions of 12 and 34. Cases 1-4 keep both directions, 5-8 reverse both, 9-12 the first,
13-16 the second. Only 8 are distinct (MATH 5.5): laying 12 on AB leaves CD for 34, so 1 and 4, 2 and 3 and so on differ
only in which of the two lines is laid exactly on its partner when the angles differ a little."""

DISTINCT_CASES = CASES[CASES[:, 0] == 0]
"""(8, 4) one of each two; these vote, since counting every motion twice changes no majority."""


class PairRelation(IntEnum):
    """How two lines of one scan lie to each other."""

    SKEW = 0
    INTERSECTING = 1
    PARALLEL = 2
    IDENTICAL = 3


@dataclass(frozen=True, eq=False)
class DescribedPairs:
    """n pairs of lines of one scan."""

    numbers: IndexPairs
    """(n, 2) numbers of the lines."""
    relations: Labels
    """(n,) `PairRelation`."""
    angles_rad: Scalars
    """(n,) angle between 0 and π/2, without regard to directions; 0 for parallel pairs [rad]."""
    distances_m: Scalars
    """(n,) shortest distance; 0 for intersecting pairs [m]."""


@dataclass(frozen=True, eq=False)
class CompatMatch:
    """What the voting found."""

    target_from_source: RigidTransform
    """The most frequent motion."""
    lines: IndexPairs
    """(k, 2) target and source lines that the agreeing pairs put together, one to one."""
    votes: int
    """Motions that agree with it."""
    motions: int
    """Motions that were compared: eight distinct cases for each entry."""


def described_pairs(lines: Lines, options: PairVotingOptions) -> DescribedPairs:
    """Describe all pairs of lines by relation, angle (4.19) and shortest distance (4.16, 4.20).

    Parameters
    ----------
    lines
        Lines of one scan; only the longest `options.max_lines` form pairs.
    options
        Limits.
    """
    longest = np.sort(np.argsort(-lines.lengths, kind="stable")[: options.max_lines])
    i, j = np.triu_indices(len(longest), k=1)
    numbers = np.stack([longest[i], longest[j]], axis=1).astype(np.int64)
    pairs = line_pairs_of(lines, numbers)
    geometry = pair_geometry(pairs)
    sines = np.linalg.norm(np.cross(pairs.directions_a, pairs.directions_b), axis=1)
    parallel = sines < np.sin(options.max_angle_rad)
    between = pairs.anchors_a - pairs.anchors_b
    apart = np.linalg.norm(np.cross(between, pairs.directions_a), axis=1)  # eq. (4.20)
    distances = np.where(parallel, apart, geometry.distances_m)
    near = distances < options.max_distance_m
    relations = np.select(
        [parallel & near, parallel, near],
        [int(PairRelation.IDENTICAL), int(PairRelation.PARALLEL), int(PairRelation.INTERSECTING)],
        int(PairRelation.SKEW),
    ).astype(np.int32)
    return DescribedPairs(
        numbers,
        relations,
        np.where(parallel, 0.0, np.arctan2(sines, np.abs(geometry.cosines))),
        np.where(near, 0.0, distances),
    )


def correspondence_matrix(
    target: DescribedPairs, source: DescribedPairs, distance_per_angle_m: float
) -> Float64[Array, "target_pairs source_pairs"]:
    """Compare every pair of one scan with every pair of the other: |Δdistance| + weight |Δangle| [m].

    Parameters
    ----------
    target, source
        Pairs of both scans.
    distance_per_angle_m
        The weight of angles against distances: so many metres count as one radian.
    """
    distances = np.abs(target.distances_m[:, None] - source.distances_m[None, :])
    angles = np.abs(target.angles_rad[:, None] - source.angles_rad[None, :])
    return np.asarray(distances + distance_per_angle_m * angles)


CaseTable = Int64[Array, "cases 4"]
CaseRotations = Float64[Array, "n cases 3 3"]
CaseTranslations = Float64[Array, "n cases 3"]


def motions_of_cases(
    target: LinePairs, source: LinePairs, cases: CaseTable = CASES
) -> tuple[CaseRotations, CaseTranslations]:
    """Give for each k the rotation and translation of every case that lays source pair k on target pair k.

    Rotation (4.22 to 4.28): the frame M has its second axis along the first line, its third across both, its first
    completing them; R = R_M2 R_M1ᵀ. Translation (4.44 to 4.50): the middles of the shortest connections are laid on
    each other, which solves 4.46 for the feet in closed form.

    Parameters
    ----------
    target, source
        n pairs each, not parallel.
    cases
        Rows of `CASES`.
    """
    directions = np.stack([source.directions_a, source.directions_b], axis=1)
    wanted = np.stack([target.directions_a, target.directions_b], axis=1)
    lead, other, signs = cases[:, 0], cases[:, 1], cases[:, 2:]
    every = np.arange(len(cases))
    signed = directions[:, None, :, :] * signs[None, :, :, None]
    source_frames = _frames(signed[:, every, lead], signed[:, every, 1 - lead])
    target_frames = _frames(wanted[:, other], wanted[:, 1 - other])
    rotations = rotation_from_frames(source_frames, target_frames)
    middles = []
    for pairs in (target, source):
        geometry = pair_geometry(pairs)
        middles.append(0.5 * (geometry.feet_a + geometry.feet_b))
    translations = middles[0][:, None, :] - np.einsum("nhij,nj->nhi", rotations, middles[1])
    return rotations, np.asarray(translations)


def match_by_pairs(target: Lines, source: Lines, options: PairVotingOptions) -> CompatMatch:
    """Find the most frequent motion and the lines that belong together in it.

    Parameters
    ----------
    target, source
        Lines of both scans.
    options
        Weight and limits; the dissertation gives no numbers.

    Raises
    ------
    TooFewCorrespondencesError
        When no two pairs look alike, or too few lines belong together.
    """
    described = [described_pairs(lines, options) for lines in (target, source)]
    rows, columns = _best_entries(described[0], described[1], options)
    if len(rows) == 0:
        raise TooFewCorrespondencesError(0, 1, "pairs of lines that look alike")
    numbers = described[0].numbers[rows], described[1].numbers[columns]
    rotations, translations = motions_of_cases(
        line_pairs_of(target, numbers[0]), line_pairs_of(source, numbers[1]), DISTINCT_CASES
    )
    motions = Motions(rotations.reshape(-1, 3, 3), translations.reshape(-1, 3), np.ones(rotations.size // 9))
    centre = source.anchors.mean(axis=0)
    pose, agree = _most_frequent(motions, centre, options)
    lines = _single_lines(numbers[0], numbers[1], agree.reshape(-1, len(DISTINCT_CASES)), (len(target), len(source)))
    if len(lines) < 2:
        raise TooFewCorrespondencesError(len(lines), 2)
    return CompatMatch(pose, lines, int(agree.sum()), len(motions))


def _best_entries(target: DescribedPairs, source: DescribedPairs, options: PairVotingOptions) -> tuple[Array, Array]:
    """Give row and column of the smallest entries, parallel and identical pairs left out: they fix no motion."""
    rows, columns = (np.flatnonzero(p.relations <= int(PairRelation.INTERSECTING)) for p in (target, source))
    if min(len(rows), len(columns)) == 0:
        return rows[:0], columns[:0]
    matrix = correspondence_matrix(_chosen(target, rows), _chosen(source, columns), options.distance_per_angle_m)
    flat = matrix.ravel()
    most = min(options.max_pair_matches, flat.size)
    best = np.argpartition(flat, most - 1)[:most]
    best = np.sort(best[flat[best] <= options.max_entry_m])
    return rows[best // matrix.shape[1]], columns[best % matrix.shape[1]]


def _chosen(pairs: DescribedPairs, which: Array) -> DescribedPairs:
    return DescribedPairs(
        pairs.numbers[which], pairs.relations[which], pairs.angles_rad[which], pairs.distances_m[which]
    )


def _frames(first: Array, second: Array) -> Array:
    """Build the axes r1, r2, r3 of M as columns (4.26 to 4.28), (..., 3, 3)."""
    r3 = np.cross(first, second)
    r3 = r3 / np.maximum(np.linalg.norm(r3, axis=-1, keepdims=True), PARALLEL_SINE)
    return np.stack([np.cross(first, r3), first, r3], axis=-1)


def _most_frequent(motions: Motions, centre_m: Vector3, options: PairVotingOptions) -> tuple[RigidTransform, Array]:
    """Give the motion on which most cases agree, in the middle of those, and which these are."""
    voted = vote_motions(
        motions,
        centre_m,
        radius_rad=options.agreement_angle_rad,
        radius_m=options.agreement_distance_m,
        most_rotations=MOST_ROTATIONS,
        most=1,
    )
    rotation, translation = voted.rotations[0], voted.translations_m[0]
    images = motions.rotations @ centre_m + motions.translations_m
    for width in CENTRING_WIDTHS:
        agree = _agreeing(motions, rotation, images, rotation @ centre_m + translation, options, width)
        if not agree.any():
            break
        rotation = nearest_rotations(motions.rotations[agree].sum(axis=0)[None])[0]
        translation = images[agree].mean(axis=0) - rotation @ centre_m
    agree = _agreeing(motions, rotation, images, rotation @ centre_m + translation, options)
    return RigidTransform.from_components(translation, Rotation.from_matrix(rotation)), agree


def _agreeing(
    motions: Motions,
    rotation: Matrix3,
    images: Array,
    image: Vector3,
    options: PairVotingOptions,
    width: float = 1.0,
) -> Array:
    """Say which motions agree with one within `width` times the limits: in rotation, and where they put the centre."""
    # |R1 - R2|^2 (Frobenius) = 8 sin^2(angle / 2)
    limit = 8.0 * np.sin(0.5 * width * options.agreement_angle_rad) ** 2
    turned = ((motions.rotations - rotation) ** 2).sum(axis=(1, 2)) <= limit
    return np.asarray(turned & (np.linalg.norm(images - image, axis=1) <= width * options.agreement_distance_m))


def _single_lines(target: IndexPairs, source: IndexPairs, agree: Array, counts: tuple[int, int]) -> OtherIndexPairs:
    """Count how often agreeing cases put two lines together; keep those that are each other's most frequent."""
    entry, case = np.nonzero(agree)
    tally = np.zeros(counts)
    for lead in (0, 1):
        ours = np.where(lead == DISTINCT_CASES[case, 0], DISTINCT_CASES[case, 1], 1 - DISTINCT_CASES[case, 1])
        np.add.at(tally, (target[entry, ours], source[entry, lead]), 1.0)
    best_source, best_target = tally.argmax(axis=1), tally.argmax(axis=0)
    rows = np.arange(counts[0])
    good = (tally[rows, best_source] > 0.0) & (best_target[best_source] == rows)
    return np.stack([rows[good], best_source[good]], axis=1).astype(np.int64)
