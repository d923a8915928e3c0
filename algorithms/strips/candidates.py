"""Run 1 through each strip: pieces of its row buffer that are planes (Kager 2003, 2.2)."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int64

from algorithms.arrays import Array, Indices, Matrices3, OtherPoints, Points, Scalars
from algorithms.progress import NoProgress
from algorithms.strips.options import PatchOptions
from algorithms.strips.scan_lines import ScanLines
from algorithms.strips.strip import Strip
from algorithms.terrain.cell_heights import cells_over, heights_on, spacing_of
from algorithms.terrain.filters.opening import opened_terrain

LOOSE = 2.0
"""Run 1 lets pass what scatters by so many times the limit: outliers are still among the points."""
LEAST_SPREAD = 0.15
"""Least ratio of the middle to the largest moment: else the points lie along a line."""
FLAT_DEG, STEEP_DEG = 8.0, 22.0
"""Between classes of slope; what is steeper than the first is divided by its aspect too."""
ASPECTS = 4
TERRAIN_CELL_M, LARGEST_BUILDING_M, STEEPEST_GROUND = 1.0, 60.0, 0.15
"""Terrain is told from roofs by openings, as `roofs` does without plans."""


@dataclass(frozen=True, eq=False)
class Candidates:
    """Planes of strips, before anybody knows whether others see them."""

    places_m: Points
    """(k, 3) middles, which become the reference points [m]."""
    normals: Points
    """(k, 3) upwards."""
    std_m: Scalars
    """(k,) of all their points [m]."""
    classes: Int64[Array, "k"]
    """(k,) of slope and aspect."""

    def selected(self, which: Array) -> "Candidates":
        """Keep some."""
        return Candidates(self.places_m[which], self.normals[which], self.std_m[which], self.classes[which])

    def __len__(self) -> int:
        return len(self.std_m)

    @property
    def frames(self) -> Matrices3:
        """Columns e1, e2, normal (k, 3, 3), right-handed."""
        return frames_of(self.normals)


def frames_of(normals: Points) -> Matrices3:
    """Give right-handed frames (k, 3, 3) with the normals (k, 3) as third columns, e1 level."""
    e1 = np.column_stack([normals[:, 1], -normals[:, 0], np.zeros(len(normals))])
    length = np.hypot(e1[:, 0], e1[:, 1])
    e1 = np.where(length[:, None] > 1e-6, e1 / np.maximum(length, 1e-12)[:, None], [1.0, 0.0, 0.0])
    return np.stack([e1, np.cross(normals, e1), normals], axis=2)


def candidates_of(strip: Strip, lines: ScanLines, options: PatchOptions) -> Candidates:
    """Find the planes among blocks of neighbouring rows and their neighbouring nadir angles.

    Blocks overlap by half in both directions. Their moments come from those of quarter blocks, so that every point is
    looked at once. O(n).
    """
    half = 0.5 * options.size_m
    usable = ~lines.looks_back[lines.lines]
    block = np.floor((lines.along_m - lines.along_m.min()) / half).astype(np.int64)[lines.lines]
    column = np.floor((lines.across_m - lines.across_m.min()) / half).astype(np.int64)
    rows, columns = int(block.max()) + 1, int(column.max()) + 1
    cells = (block * columns + column)[usable]
    counts, means, squares = _moments(strip.points[usable], cells, rows * columns)
    counts, means, squares = _of_four(counts, means, squares, rows, columns)
    enough = counts >= options.least_points
    if not enough.any():
        return Candidates(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0, dtype=np.int64))
    counts, means, squares = counts[enough], means[enough], squares[enough]
    values, vectors = np.linalg.eigh(squares)
    normals = vectors[:, :, 0] * np.where(vectors[:, 2, 0] < 0.0, -1.0, 1.0)[:, None]
    std = np.sqrt(np.maximum(values[:, 0], 0.0) / np.maximum(counts - 3.0, 1.0))
    slope = np.degrees(np.arccos(np.minimum(normals[:, 2], 1.0)))
    good = (std <= LOOSE * options.std_m) & (values[:, 1] > LEAST_SPREAD * values[:, 2])
    good &= (slope >= options.least_slope_deg) & (slope <= options.steepest_deg)
    if options.least_rise_m > 0.0:
        good &= _rises(means, strip.points) >= options.least_rise_m
    return Candidates(means[good], normals[good], std[good], _classes(normals[good], slope[good]))


def _rises(places: OtherPoints, points: Points) -> Array:
    """Give how far places (k,) stand above the terrain below the points of their strip [m]."""
    grid = cells_over(points, max(TERRAIN_CELL_M, spacing_of(points)))
    terrain = opened_terrain(points, grid, LARGEST_BUILDING_M / 2.0, STEEPEST_GROUND, NoProgress())
    return np.asarray(places[:, 2] - heights_on(terrain, grid, places))


def _classes(normals: Points, slope_deg: Scalars) -> Indices:
    aspect = np.floor(ASPECTS * (np.arctan2(normals[:, 1], normals[:, 0]) / (2.0 * np.pi) + 0.5)).astype(np.int64)
    steepness = np.searchsorted([FLAT_DEG, STEEP_DEG], slope_deg)
    return np.where(steepness == 0, 0, 1 + (aspect % ASPECTS) + ASPECTS * (steepness - 1)).astype(np.int64)


def _moments(points: Points, cells: Indices, count: int) -> tuple[Array, Array, Array]:
    """Give numbers (count,), means (count, 3) and sums of squares about the means (count, 3, 3)."""
    numbers = np.bincount(cells, minlength=count).astype(np.float64)
    safe = np.maximum(numbers, 1.0)
    means = np.column_stack([np.bincount(cells, points[:, k], count) for k in range(3)]) / safe[:, None]
    local = points - means[cells]
    squares = np.empty((count, 3, 3))
    for i in range(3):
        for j in range(i + 1):
            squares[:, i, j] = squares[:, j, i] = np.bincount(cells, local[:, i] * local[:, j], count)
    return numbers, means, squares


def _of_four(counts: Scalars, means: Points, squares: Matrices3, rows: int, columns: int) -> tuple[Array, Array, Array]:
    """Join each cell with those behind and beside it."""
    n = np.pad(counts.reshape(rows, columns), ((0, 1), (0, 1)))
    m = np.pad(means.reshape(rows, columns, 3), ((0, 1), (0, 1), (0, 0)))
    s = np.pad(squares.reshape(rows, columns, 3, 3), ((0, 1), (0, 1), (0, 0), (0, 0)))
    parts = [(slice(a, a + rows), slice(b, b + columns)) for a in (0, 1) for b in (0, 1)]
    total = sum(n[part] for part in parts)
    safe = np.maximum(total, 1.0)
    mean = sum(n[part][..., None] * m[part] for part in parts) / safe[..., None]
    joined = np.zeros((rows, columns, 3, 3))
    for part in parts:
        away = m[part] - mean
        joined += s[part] + n[part][..., None, None] * away[..., :, None] * away[..., None, :]
    return np.asarray(total).ravel(), np.asarray(mean).reshape(-1, 3), joined.reshape(-1, 3, 3)
