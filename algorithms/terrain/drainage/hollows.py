"""Hollows without outflow, and the paths that join them (Gaisky)."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import label, minimum_position

from algorithms.arrays import Array, Points
from algorithms.deviations.rasters import Grid, GridValues
from algorithms.terrain.drainage.rain import Rain

DEPTH_M = 1e-6
"""Shallower hollows are rounding."""
FOUR = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]])


@dataclass(frozen=True)
class Hollow:
    """A region that fills with water."""

    bottom: int
    """Its deepest cell (base)."""
    bottom_m: float
    """Height of that [m]."""
    rim_m: float
    """Height of the lowest point of its rim, at which it overflows [m]."""
    cells: int
    """Cells under water."""
    volume_m3: float
    """Water when it is full [m³]."""


def hollows_of(heights_m: GridValues, rain: Rain, cell_m: float) -> tuple[list[Hollow], Array]:
    """Give the hollows, and which one (from 1; 0: none) each cell belongs to.

    Parameters
    ----------
    heights_m
        The terrain [m].
    rain
        On it.
    cell_m
        Edge of the cells [m].
    """
    depth = np.nan_to_num(rain.filled_m - heights_m)
    labels, count = label(depth > DEPTH_M, structure=FOUR)
    if count == 0:
        return [], labels
    numbers = np.arange(1, count + 1)
    bottoms = minimum_position(heights_m, labels, numbers)
    cells = np.bincount(labels.ravel())
    volumes = np.bincount(labels.ravel(), depth.ravel()) * cell_m**2
    columns = heights_m.shape[1]
    return [
        Hollow(
            bottom=int(r * columns + c),
            bottom_m=float(heights_m[r, c]),
            rim_m=float(rain.filled_m[r, c]),
            cells=int(cells[k]),
            volume_m3=float(volumes[k]),
        )
        for k, (r, c) in zip(numbers, bottoms, strict=True)
    ], labels


def hollow_paths(hollows: list[Hollow], labels: Array, rain: Rain, grid: Grid) -> list[Points]:
    """Join the bases of hollows, the highest first: from a base over the lowest saddle to the base of the next hollow.

    Heights run linearly from base to base: as breaklines the paths cut through the dams that made the hollows. Paths
    that leave the area without meeting another hollow are left out.

    Parameters
    ----------
    hollows, labels
        As `hollows_of` gives them.
    rain
        On the terrain.
    grid
        Its cells.

    Returns
    -------
    Paths, each (k, 3) [m].
    """
    centres, flat = grid.centres(), labels.ravel()
    paths = []
    for number in sorted(range(len(hollows)), key=lambda k: -hollows[k].bottom_m):
        cells, cell = [hollows[number].bottom], hollows[number].bottom
        while True:
            inside = flat[cell] == number + 1
            cell = int(rain.parents[cell] if inside else rain.main[cell])
            if cell < 0:
                break
            cells.append(cell)
            if flat[cell] not in {0, number + 1}:
                break
        if cell < 0:
            continue
        end = hollows[flat[cell] - 1]
        plan = centres[[*cells, end.bottom]]
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(plan, axis=0).T))])
        heights = np.interp(along, [0.0, max(along[-1], 1e-12)], [hollows[number].bottom_m, end.bottom_m])
        paths.append(np.column_stack([plan, heights]))
    return paths
