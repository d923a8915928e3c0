"""From strips to corrections: rows, patches in two runs, block adjustment, and again where patches then are."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from algorithms.arrays import Array, Indices, Points
from algorithms.errors import InvalidInputError
from algorithms.progress import Progress, ProgressSection
from algorithms.strips.adjustment import Adjusted, adjust_block, approximate_block
from algorithms.strips.block import Block, Control, State
from algorithms.strips.candidates import Candidates, candidates_of
from algorithms.strips.control import ControlPatch
from algorithms.strips.homologous import PointCells, chosen_seeds, homologous
from algorithms.strips.options import StripOptions
from algorithms.strips.scan_lines import scan_lines
from algorithms.strips.strip import Strip

SETTLED_M = 0.1
"""Patches that lie by less elsewhere than they were looked for show the same surface [m]."""
MOST_MORE = 4
"""Passes beyond those wished, while patches move by more."""
FOUND = 0.4
"""Share of the work after which patches are found."""


@dataclass(frozen=True, eq=False)
class StripBlock:
    """Strips with their patches and corrections."""

    adjusted: Adjusted
    lines: tuple[int, ...]
    """Scan lines of each strip."""
    looks_back: tuple[int, ...]
    """Of them those that look back."""
    candidates: tuple[int, ...]
    """Patch candidates of each strip."""
    control_patches: Indices
    """(controls,) number of each control's patch; -1 where no surface around tells its plane."""
    sought: int
    """Patches that were looked for in all strips, control patches not counted."""


def adjust_strips(
    strips: Sequence[Strip], control: Sequence[ControlPatch], options: StripOptions, progress: Progress
) -> StripBlock:
    """Tie strips by what they see in common, and adjust them.

    Parameters
    ----------
    strips
        At least two, or one and control; z upwards.
    control
        Known planes and heights; none: the observations of zero hold the datum.
    options
        Of patches and corrections.
    progress
        Hears of every step.

    Raises
    ------
    InvalidInputError
        One strip without control.
    TooFewCorrespondencesError
        Too few patches in common.
    NotConvergedError
        The adjustment does not settle.
    """
    if len(strips) < 2 and not control:
        raise InvalidInputError("strips", "one strip alone has nothing to be compared with", "give more, or control")
    lines, found, cells = [], [], []
    for number, strip in enumerate(strips):
        progress.report(FOUND * number / len(strips), f"patches of {strip.name}")
        rows = scan_lines(strip)
        lines.append(rows)
        found.append(candidates_of(strip, rows, options.patches))
        cells.append(PointCells.of(strip.points, 0.5 * options.patches.size_m))
    progress.report(FOUND, "homologous patches")
    seeds = chosen_seeds(found, cells, options.patches)
    references, frames, radii, known, numbers = _with_control(
        seeds, control, strips, cells, 0.5 * options.patches.size_m
    )
    paths = [strip.path for strip in strips]
    places = [references] * len(strips)
    start: State | None = None
    most = options.passes + MOST_MORE if options.passes > 1 else 1
    for run in range(most):
        part = FOUND + (1.0 - FOUND) * min(run, options.passes - 1) / options.passes
        section = ProgressSection(progress, part, part + (1.0 - FOUND) / options.passes)
        section.report(0.0, "homologous patches")
        ties = homologous(strips, cells, places, frames, radii, options.patches)
        block = Block.of(paths, references, frames, ties, known, options.corrections)
        start = block.zero_state() if start is None else start
        if run + 1 == most:
            break
        section.report(0.3, "robust adjustment")
        start, good = approximate_block(block, start, options.corrections)
        before, places = places, _places(block, start, good, references)
        moved = max(float(np.median(np.linalg.norm(b - a, axis=1))) for a, b in zip(before, places, strict=True))
        if run + 1 >= options.passes and moved <= SETTLED_M:
            break
    assert start is not None  # noqa: S101 - there is at least one pass
    adjusted = adjust_block(block, start, options.corrections, options.alpha, section)
    return StripBlock(
        adjusted,
        tuple(rows.count for rows in lines),
        tuple(int(rows.looks_back.sum()) for rows in lines),
        tuple(len(each) for each in found),
        numbers,
        len(seeds),
    )


def _with_control(
    seeds: Candidates,
    control: Sequence[ControlPatch],
    strips: Sequence[Strip],
    cells: Sequence[PointCells],
    radius_m: float,
) -> tuple[Array, Array, Array, Control, Array]:
    """Add the patches of control to those of the strips."""
    references, frames = [seeds.places_m], [seeds.frames]
    numbers, patches, points, stds = [], [np.zeros(0, dtype=np.int64)], [np.zeros((0, 3))], [np.zeros((0, 3))]
    count, radii = len(seeds), [radius_m] * len(seeds)
    for each in control:
        frame = each.frame(strips, cells, radius_m)
        numbers.append(count if frame is not None else -1)
        if frame is None:
            continue
        references.append(each.middle_m[None])
        frames.append(frame[None])
        radii.append(each.radius_m(radius_m))
        patches.append(np.full(len(each.points_m), count, dtype=np.int64))
        places, deviations = each.on_plane(frame, strips, cells, radii[-1])
        points.append(places)
        stds.append(deviations)
        count += 1
    known = Control(np.concatenate(patches), np.concatenate(points), np.concatenate(stds))
    numbered = np.array(numbers, dtype=np.int64)
    return np.concatenate(references), np.concatenate(frames), np.array(radii), known, numbered


def _places(block: Block, state: State, good: Array, references: Points) -> list[Points]:
    """Give where the reference points are in each strip, as its corrections so far say."""
    places = []
    for strip in range(len(block.paths)):
        own = np.flatnonzero(good & (block.ties.strips == strip))
        if len(own) == 0:
            places.append(references)
            continue
        middles, times = block.ties.anchors_m[own].mean(axis=1), block.ties.times_s[own].mean(axis=1)
        moved = block.correction(state, strip).applied(middles, times) - middles
        # how far a strip moves changes little from patch to patch
        _, nearest = cKDTree(middles[:, :2]).query(references[:, :2])
        places.append(references - moved[nearest])
    return places
