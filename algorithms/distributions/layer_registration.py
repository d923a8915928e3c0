"""Lay the slices of two levelled scans on each other, coarse to fine, from many headings."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, Scalars
from algorithms.distributions.layers import LayerDistributions, Layers, Score, distributions_of, score_in

MOST_STEPS = 30
"""Newton steps in one size of cells."""
FEW_POINTS, MANY_POINTS = 1500, 20_000
"""Points of the source while many starts are followed, and for those that are left."""
LARGEST_STEP_CELLS, LARGEST_TURN_RAD = 0.5, 0.2
"""A step moves no farther than this."""
SMALL_STEP_CELLS = 1e-4
"""Steps below so many cells end the search in one size of cells."""
HALVINGS = 6
"""A step that makes the score worse is halved so often before it is given up."""
NARROW_CELLS_M = 16.0
"""While cells are larger than this, or than the rms extent of the scan, all starts are followed; then the best ones."""
REACH_EXTENTS = 2.5
"""Shifts are tried no farther than so many rms extents of the source."""
KEPT_STARTS = 12
SHIFTS_PER_CELL, HEADINGS_OF_SHIFTS = 0.5, 36
"""Then also shifts so many cells apart are tried, in so many headings: from the largest cells all starts come to where
the middles of the scans meet, which is wrong where they have little in common."""
SAME_M, SAME_RAD = 0.5, np.radians(2.0)
"""Answers nearer to each other than this are one."""


@dataclass(frozen=True, eq=False)
class LayerMatch:
    """A heading and a horizontal shift, and how well they lay slices on slices."""

    pose: Scalars
    """(3,) translation [m] and heading [rad], target from source."""
    score: Score
    """In the finest cells."""
    mean_score: float
    """Of a source point that meets a cell of the target, 0..1."""
    iterations: int
    last_step_m: float
    converged: bool


def cell_sizes(coarsest_m: float, finest_m: float, steps: int) -> list[float]:
    """Give the edges of the cells, falling by the same factor from step to step [m]."""
    return [float(size) for size in np.geomspace(coarsest_m, finest_m, steps)]


def match_layers(
    target: Layers, source: Layers, sizes_m: Sequence[float], starts: Array, reach_m: float
) -> list[LayerMatch]:
    """Follow every start from the largest cells to the smallest; give the distinct answers, the best first.

    Parameters
    ----------
    target, source
        Slices of both scans, each with at least one point.
    sizes_m
        Edges of the cells, falling [m].
    starts
        (k, 3) translations [m] and headings [rad].
    reach_m
        As far from the first start other shifts are tried in cells of middle size [m].
    """
    extent = float(np.sqrt(np.mean(np.sum((source.points - source.points.mean(axis=0)) ** 2, axis=1))))
    narrow, reach = min(NARROW_CELLS_M, extent), min(reach_m, REACH_EXTENTS * extent)
    poses = [np.array(start, dtype=np.float64) for start in starts]
    some = source.thinned(FEW_POINTS)
    narrowed = False
    matches: list[LayerMatch] = []
    for size in sizes_m:
        distributions = distributions_of(target, size)
        if (size <= narrow or size == sizes_m[-1]) and not narrowed:
            poses = _best_of(distributions, some, [*poses, *_shifted(starts[0], size, reach)])
            some, narrowed = source.thinned(MANY_POINTS), True
        matches = [ascended(distributions, some, pose) for pose in poses]
        poses = [match.pose for match in matches]
    return _distinct(sorted(matches, key=lambda match: -match.score.value))


def ascended(distributions: LayerDistributions, source: Layers, start: Scalars) -> LayerMatch:
    """Climb to the nearest maximum of the score: Newton steps, with the Hessian made negative definite, and halving.

    Parameters
    ----------
    distributions
        Of the target.
    source
        Slices of the source.
    start
        (3,) pose.
    """
    pose, here = start.copy(), score_in(distributions, source, start)
    reach = max(float(np.sqrt(np.mean(source.points**2))), 1.0)
    length, iteration, converged = np.inf, 0, here.value == 0.0
    while not converged and iteration < MOST_STEPS:
        step = _newton_step(here, reach, distributions.cell_m)
        for _ in range(HALVINGS):
            there = score_in(distributions, source, pose + step)
            if there.value >= here.value:
                break
            step = 0.5 * step
        else:
            step, there = np.zeros(3), here
        iteration += 1
        pose, here = pose + step, there
        length = float(np.hypot(np.linalg.norm(step[:2]), reach * step[2]))
        converged = length < SMALL_STEP_CELLS * distributions.cell_m
    return LayerMatch(pose, here, here.value / max(len(source.points), 1), iteration, length, converged)


def _newton_step(score: Score, reach_m: float, cell_m: float) -> Array:
    """Solve for the step up; where the score is not concave the curvature's size is taken, and long steps cut."""
    scale = np.array([1.0, 1.0, 1.0 / reach_m])
    values, vectors = np.linalg.eigh(scale[:, None] * score.hessian * scale)
    curvature = np.maximum(np.abs(values), 1e-3 * max(float(np.abs(values).max()), 1e-12))
    step = scale * (vectors @ ((vectors.T @ (scale * score.gradient)) / curvature))
    longest = max(
        float(np.linalg.norm(step[:2])) / (LARGEST_STEP_CELLS * cell_m), abs(float(step[2])) / LARGEST_TURN_RAD, 1.0
    )
    return np.asarray(step / longest)


def _shifted(start: Scalars, cell_m: float, reach_m: float) -> list[Scalars]:
    """Give poses all around a start, in every heading."""
    steps = np.arange(-reach_m, reach_m + 1e-9, SHIFTS_PER_CELL * cell_m)
    headings = np.linspace(0.0, 2.0 * np.pi, HEADINGS_OF_SHIFTS, endpoint=False)
    grid = np.stack(np.meshgrid(steps, steps, headings, indexing="ij"), axis=-1).reshape(-1, 3)
    return list(start + grid)


def _best_of(distributions: LayerDistributions, source: Layers, poses: list[Scalars]) -> list[Scalars]:
    """Keep the distinct poses with the best scores."""
    scores = [score_in(distributions, source, pose).value for pose in poses]
    kept: list[Scalars] = []
    for k in np.argsort(-np.array(scores), kind="stable").tolist():
        if not any(_same(poses[k], other, distributions.cell_m) for other in kept):
            kept.append(poses[k])
        if len(kept) == KEPT_STARTS:
            break
    return kept


def _distinct(matches: list[LayerMatch]) -> list[LayerMatch]:
    kept: list[LayerMatch] = []
    for match in matches:
        if not any(_same(match.pose, other.pose, 0.0) for other in kept):
            kept.append(match)
    return kept


def _same(first: Scalars, second: Scalars, cell_m: float) -> bool:
    turn = abs(float(np.angle(np.exp(1j * (first[2] - second[2])))))
    apart = float(np.linalg.norm(first[:2] - second[:2]))
    return bool(apart < max(SAME_M, 0.2 * cell_m) and turn < max(SAME_RAD, 0.01 * cell_m))
