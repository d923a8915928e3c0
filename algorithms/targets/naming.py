"""Which target is which: consensus over congruent triples of points, without names or a first guess."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Array, IndexPairs, Points
from algorithms.geometry.point_sets import PointSet

SIGMAS = 4.0
"""Distances and places agree within so many standard deviations."""
LEAST_TOLERANCE_M = 1e-4
LEAST_COMMON = 3
MOST_HYPOTHESES = 20_000
MOST_CHANCE = 0.01
"""Expected number of assignments of as many points that agree by chance, above which one is not believed."""
THIN_TRIANGLE = 0.05
"""A triangle lower than so much of its longest side fixes no motion."""


@dataclass(frozen=True, eq=False)
class PointMatch:
    """Which points of two sets are the same."""

    pairs: IndexPairs
    """(n, 2) numbers in the first and the second set; empty where it is not determined."""
    first_from_second: RigidTransform | None
    """The motion that lays the second set on the first; None where it is not determined."""
    reason: str
    """Why it is not determined, or how clear it is."""
    runner_up: int
    """How many points the best other assignment has in common."""


def match_points(first: PointSet, second: PointSet) -> PointMatch:
    """Find which points of two sets are the same by their distances, whatever is missing or extra in either.

    Every pair of points with equal distance, and a third one with equal distances from both, give a motion; the points
    that agree in it are counted. The assignment with the most points is the answer, if no other has as many, and if
    so many do not agree by chance.

    Parameters
    ----------
    first, second
        Points with covariances, each set in a frame of its own.
    """
    if min(len(first), len(second)) < LEAST_COMMON:
        return _undetermined(f"{len(first)} and {len(second)} points, three in common are needed")
    a, b = _Distances.of(first), _Distances.of(second)
    ranked = _assignments(first, second, a, b)
    if not ranked:
        return _undetermined("no three points have the same distances in both")
    best, motion = ranked[0]
    runner_up = max((len(other) for other, _ in ranked[1:] if _contradicts(best, other)), default=0)
    if runner_up >= len(best):
        reason = f"two assignments have {len(best)} points in common: the points lie too regularly to tell them apart"
        return _undetermined(reason, runner_up)
    chance = _expected_by_chance(a, b, len(best))
    if chance > MOST_CHANCE:
        reason = f"{len(best)} points agree, and {chance:.2g} such assignments are expected by chance: add points"
        return _undetermined(reason, runner_up)
    reason = f"{len(best)} points in common, the best other assignment has {runner_up}"
    return PointMatch(np.array(best, dtype=np.int64).reshape(-1, 2), motion, reason, runner_up)


@dataclass(frozen=True, eq=False)
class _Distances:
    """All distances of a set of points."""

    lengths: Array
    """(n, n) [m]."""
    variances: Array
    """(n, n) [m²]."""

    @staticmethod
    def of(points: PointSet) -> "_Distances":
        apart = points.coordinates[:, None] - points.coordinates[None]
        lengths = np.linalg.norm(apart, axis=2)
        units = apart / np.maximum(lengths, 1e-12)[:, :, None]
        own = np.einsum("nki,nij,nkj->nk", units, points.covariances, units)
        return _Distances(lengths, own + own.T)


def _assignments(
    first: PointSet, second: PointSet, a: _Distances, b: _Distances
) -> list[tuple[tuple[tuple[int, int], ...], RigidTransform]]:
    """Give the distinct assignments that congruent triples lead to, with their motions, those of most points first."""
    found: dict[tuple[tuple[int, int], ...], RigidTransform] = {}
    tried: set[tuple[tuple[int, int], ...]] = set()
    one, other = np.nonzero(~np.eye(len(second), dtype=bool))
    for i, j in np.argwhere(np.triu(np.ones((len(first), len(first)), dtype=bool), 1)).tolist():
        equal = np.abs(a.lengths[i, j] - b.lengths[one, other]) < _tolerance(a.variances[i, j], b.variances[one, other])
        for k, m in zip(one[equal], other[equal], strict=True):
            thirds = _agreeing(a, b, int(i), int(k)) & _agreeing(a, b, int(j), int(m))
            thirds[[i, j]] = False
            thirds[:, [k, m]] = False
            for p, q in np.argwhere(thirds).tolist():
                start = ((int(i), int(k)), (int(j), int(m)), (int(p), int(q)))
                triple = tuple(sorted(start))
                if triple in tried or len(tried) >= MOST_HYPOTHESES:
                    continue
                tried.add(triple)
                if _thin(first.coordinates[np.array([i, j, p])]):
                    continue
                pairs, motion = _grown(first, second, start)
                if len(pairs) >= LEAST_COMMON:
                    found[pairs] = motion
    return sorted(found.items(), key=lambda item: (-len(item[0]), item[0]))


def _tolerance(one: Array | float, other: Array | float) -> Array:
    return np.asarray(np.maximum(SIGMAS * np.sqrt(one + other), LEAST_TOLERANCE_M))


def _agreeing(a: _Distances, b: _Distances, i: int, k: int) -> Array:
    """Mark points whose distance from the i-th in the first set equals that from the k-th in the second."""
    apart = np.abs(a.lengths[i][:, None] - b.lengths[k][None])
    return np.asarray(apart < _tolerance(a.variances[i][:, None], b.variances[k][None]))


def _thin(corners: Points) -> bool:
    sides = corners - np.roll(corners, 1, axis=0)
    longest = float(np.max(np.einsum("ij,ij->i", sides, sides)))
    return float(np.linalg.norm(np.cross(sides[0], sides[1]))) < THIN_TRIANGLE * longest


def _grown(
    first: PointSet, second: PointSet, start: tuple[tuple[int, int], ...]
) -> tuple[tuple[tuple[int, int], ...], RigidTransform]:
    """Lay the second set on the first by some pairs, take all pairs that agree, and repeat with those."""
    pairs = start
    motion = RigidTransform.identity()
    for _ in range(4):
        numbers = np.array(pairs)
        motion = closed_form_motion(first.coordinates[numbers[:, 0]], second.coordinates[numbers[:, 1]])
        moved = motion.apply(second.coordinates)
        apart = first.coordinates[:, None] - moved[None]
        turn = motion.rotation.as_matrix()
        covariances = first.covariances[:, None] + (turn @ second.covariances @ turn.T)[None]
        # the motion's own uncertainty is of the order of the points': twice their covariances
        statistic = np.einsum("nki,nki->nk", apart, np.linalg.solve(2.0 * covariances, apart[..., None])[..., 0])
        near = (statistic < SIGMAS**2) | (np.linalg.norm(apart, axis=2) < LEAST_TOLERANCE_M)
        nearest = np.argmin(np.where(near, statistic, np.inf), axis=1)
        back = np.argmin(np.where(near, statistic, np.inf), axis=0)
        grown = tuple((i, int(k)) for i, k in enumerate(nearest) if near[i, k] and back[k] == i)
        if grown == pairs or len(grown) < LEAST_COMMON:
            return grown, motion
        pairs = grown
    return pairs, motion


def closed_form_motion(first: Points, second: Points) -> RigidTransform:
    """Give the motion that lays n points (n, 3) on as many others with the least sum of squares."""
    centres = first.mean(axis=0), second.mean(axis=0)
    rotation, _ = Rotation.align_vectors(first - centres[0], second - centres[1])
    return RigidTransform.from_components(centres[0] - rotation.apply(centres[1]), rotation)


def _contradicts(best: tuple[tuple[int, int], ...], other: tuple[tuple[int, int], ...]) -> bool:
    """Say whether another assignment gives a point another partner."""
    ours, back = dict(best), {k: i for i, k in best}
    return any(ours.get(i, k) != k or back.get(k, i) != i for i, k in other)


def _expected_by_chance(a: _Distances, b: _Distances, size: int) -> float:
    """Estimate how many assignments of so many points agree by chance, from how densely the points lie.

    Three distances must agree, and each further point must lie at a place, within the tolerance.
    """
    n, m = len(a.lengths), len(b.lengths)
    ours, theirs = np.triu_indices(n, 1), np.triu_indices(m, 1)
    spread = max(float(np.ptp(np.concatenate([a.lengths[ours], b.lengths[theirs]]))), 1e-9)
    width = float(_tolerance(float(a.variances[ours].mean()), float(b.variances[theirs].mean())))
    share = min(1.0, 2.0 * width / spread)
    triples = n * (n - 1) * (n - 2) / 6.0 * m * (m - 1) * (m - 2) * share**3
    further = min(1.0, (n - 3) * (m - 3) * share**3)
    return triples * further ** (size - LEAST_COMMON)


def _undetermined(reason: str, runner_up: int = 0) -> PointMatch:
    return PointMatch(np.empty((0, 2), dtype=np.int64), None, reason, runner_up)
