"""Lay the distributions of one scan on those of another, coarse to fine, for scanners in any attitude."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Array, OtherPoints, Points, Vector3
from algorithms.distributions.cells import CellDistributions, CellScore, cell_distributions, cell_score

MOST_STEPS = 40
"""Newton steps in one size of cells."""
LARGEST_STEP_CELLS, LARGEST_TURN_RAD = 0.5, 0.2
"""A step moves no farther than this."""
SMALL_STEP_CELLS = 1e-4
"""Steps below so many cells end the search in one size of cells."""
HALVINGS = 6
"""A step that makes the score worse is halved so often before it is given up."""
KEPT = 8
"""Answers that go on to smaller cells."""
SAME_M, SAME_RAD = 0.3, float(np.radians(2.0))
"""Answers nearer to each other than this are one."""


@dataclass(frozen=True)
class ClimbStep:
    """One step up."""

    score: float
    """Before it."""
    step_m: float
    """Shift of the middle and turn, as the shift it causes at the rms distance [m]."""
    cell_m: float


@dataclass(frozen=True, eq=False)
class CellMatch:
    """A pose, and how well it lays distributions on distributions."""

    pose: RigidTransform
    """Target from source."""
    score: CellScore
    """In the finest cells, about `pivot_m`."""
    pivot_m: Vector3
    cells: int
    """Of the source."""
    steps: tuple[ClimbStep, ...]
    """In all sizes of cells."""
    converged: bool


def match_cells(
    target: Points, source: OtherPoints, sizes_m: Sequence[float], starts: Sequence[RigidTransform]
) -> list[CellMatch]:
    """Follow starts from the largest cells to the smallest; give the distinct answers, the best first.

    Parameters
    ----------
    target, source
        (n, 3) and (m, 3) points of both surfaces, each with at least one cell [m].
    sizes_m
        Edges of the cells, falling [m].
    starts
        Target from source.
    """
    reach = max(float(np.sqrt(np.mean(np.sum((source - source.mean(axis=0)) ** 2, axis=1)))), 1.0)
    poses = list(starts)
    steps: list[tuple[ClimbStep, ...]] = [()] * len(starts)
    matches: list[CellMatch] = []
    for size in sizes_m:
        ours, theirs = cell_distributions(target, size), cell_distributions(source, size)
        matches = [climbed(ours, theirs, pose, reach, before) for pose, before in zip(poses, steps, strict=True)]
        matches = _distinct(sorted(matches, key=lambda match: -match.score.value))[:KEPT]
        poses, steps = [match.pose for match in matches], [match.steps for match in matches]
    return matches


def climbed(
    target: CellDistributions,
    source: CellDistributions,
    start: RigidTransform,
    reach_m: float,
    before: tuple[ClimbStep, ...] = (),
) -> CellMatch:
    """Climb to the nearest maximum of the score: Newton steps with the Hessian made negative definite, and halving.

    Parameters
    ----------
    target, source
        In cells of one size.
    start
        Target from source.
    reach_m
        Rms distance of the source's points from their middle: turns count as the shift they cause there.
    before
        Steps in larger cells.
    """
    middle = source.means.mean(axis=0) if len(source.means) else np.zeros(3)
    pose, steps = start, list(before)
    pivot = np.asarray(pose.apply(middle))
    here = cell_score(target, source, pose, pivot)
    converged = here.value == 0.0
    count = 0
    while not converged and count < MOST_STEPS:
        step = _newton_step(here, reach_m, target.cell_m)
        for _ in range(HALVINGS):
            moved = _moved(pose, pivot, step)
            there = cell_score(target, source, moved, np.asarray(moved.apply(middle)))
            if there.value >= here.value:
                break
            step = 0.5 * step
        else:
            step, moved, there = np.zeros(6), pose, here
        count += 1
        length = float(np.hypot(np.linalg.norm(step[3:]), reach_m * np.linalg.norm(step[:3])))
        steps.append(ClimbStep(here.value, length, target.cell_m))
        pose, here = moved, there
        pivot = np.asarray(pose.apply(middle))
        converged = length < SMALL_STEP_CELLS * target.cell_m
    return CellMatch(pose, here, pivot, source.in_first, tuple(steps), converged)


def covariance_of(match: CellMatch) -> Array:
    """Give the covariance (6, 6) of (turn about the target's origin, shift): gradients between two inverse Hessians.

    Parameters
    ----------
    match
        At a maximum of the score.
    """
    values, vectors = np.linalg.eigh(-match.score.hessian)
    inverse = (vectors / np.maximum(values, 1e-9 * max(float(values[-1]), 1e-9))) @ vectors.T
    about_pivot = inverse @ match.score.outer @ inverse
    # a turn about the pivot moves the pose's translation as well
    lever = np.eye(6)
    arm = match.pivot_m - np.asarray(match.pose.translation)
    lever[3:, :3] = np.array([[0.0, -arm[2], arm[1]], [arm[2], 0.0, -arm[0]], [-arm[1], arm[0], 0.0]])
    return np.asarray(lever @ about_pivot @ lever.T)


def starts_around(start: RigidTransform, pivot_m: Vector3, turn_rad: float, shift_m: float) -> list[RigidTransform]:
    """Give a start and twelve beside it: turned about and shifted along each axis, to either side.

    Parameters
    ----------
    start
        Target from source.
    pivot_m
        (3,) place of the target about which it is turned [m].
    turn_rad, shift_m
        How far.
    """
    starts = [start]
    for step in np.diag([turn_rad] * 3 + [shift_m] * 3):
        if step.any():
            starts += [_moved(start, pivot_m, step), _moved(start, pivot_m, -step)]
    return starts


def _moved(pose: RigidTransform, pivot: Vector3, step: Array) -> RigidTransform:
    turn = Rotation.from_rotvec(step[:3])
    shift = pivot + turn.apply(np.asarray(pose.translation) - pivot) + step[3:]
    return RigidTransform.from_components(shift, turn * pose.rotation)


def _newton_step(score: CellScore, reach_m: float, cell_m: float) -> Array:
    """Solve for the step up; where the score is not concave the curvature's size is taken, and long steps cut."""
    scale = np.array([1.0 / reach_m] * 3 + [1.0] * 3)
    values, vectors = np.linalg.eigh(scale[:, None] * score.hessian * scale)
    curvature = np.maximum(np.abs(values), 1e-3 * max(float(np.abs(values).max()), 1e-12))
    step = scale * (vectors @ ((vectors.T @ (scale * score.gradient)) / curvature))
    longest = max(
        float(np.linalg.norm(step[3:])) / (LARGEST_STEP_CELLS * cell_m),
        float(np.linalg.norm(step[:3])) / LARGEST_TURN_RAD,
        1.0,
    )
    return np.asarray(step / longest)


def _distinct(matches: Sequence[CellMatch]) -> list[CellMatch]:
    kept: list[CellMatch] = []
    for match in matches:
        if not any(_same(match, other) for other in kept):
            kept.append(match)
    return kept


def _same(first: CellMatch, second: CellMatch) -> bool:
    turn = float((first.pose.rotation * second.pose.rotation.inv()).magnitude())
    return turn < SAME_RAD and float(np.linalg.norm(first.pivot_m - second.pivot_m)) < SAME_M
