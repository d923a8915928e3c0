"""Surfaces as heights on a grid, with what the points in and around a cell say of them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from algorithms.arrays import Array, Points, Vector3
from algorithms.deviations.raster_std import CellPlanes, plane_std
from algorithms.errors import InvalidInputError

GridValues = Float64[Array, "rows columns"]

MOST_CELLS = 50_000_000
"""More cells than that are no picture that anybody looks at."""
LEAST_POINTS = 5
"""A plane of fewer points has too little redundancy to tell its scatter."""
LEAST_SPREAD = 1e-3
"""Least ratio of the smaller to the larger moment of the points' places: else they lie on a line."""
UPWARDS = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Grid:
    """Square cells; rows count along v, columns along u."""

    u_min_m: float
    v_min_m: float
    cell_m: float
    rows: int
    columns: int

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.rows, self.columns

    def centres(self) -> Float64[Array, "cells 2"]:
        """Give u and v of the middles of all cells, row by row [m]."""
        v, u = np.indices(self.shape, dtype=np.float64)
        return np.column_stack([u.ravel() + 0.5, v.ravel() + 0.5]) * self.cell_m + [self.u_min_m, self.v_min_m]

    def places(self, uvh: Points) -> Float64[Array, "n 2"]:
        """Give column and row of points in cells, fractions included: the middle of cell 0 is 0.5."""
        return np.asarray((uvh[:, :2] - [self.u_min_m, self.v_min_m]) / self.cell_m)

    def cells_of(self, uvh: Points) -> Array:
        """Give the cell (n,) of each point, row by row, -1 outside."""
        column, row = np.floor(self.places(uvh)).astype(np.int64).T
        inside = (column >= 0) & (row >= 0) & (column < self.columns) & (row < self.rows)
        return np.where(inside, row * self.columns + column, -1)


def viewed_along(points: Points, normal: Vector3) -> Points:
    """Give coordinates (n, 3): to the right, upwards, and towards an observer to whom the normal points [m].

    Seen from above (normal z), right and up are the axes x and y; of a wall, up is z.
    """
    n = normal / np.linalg.norm(normal)
    up = np.array([0.0, 1.0, 0.0]) if abs(n[2]) > 0.9 else np.array([0.0, 0.0, 1.0])
    right = np.cross(up, n)
    right /= np.linalg.norm(right)
    return np.asarray(points @ np.column_stack([right, np.cross(n, right), n]))


def grid_over(clouds: Sequence[Array], cell_m: float, *, overlap: bool) -> Grid:
    """Lay a grid over clouds, its lines at multiples of the cell; over what all have in common, or over all.

    Raises
    ------
    InvalidInputError
        If the clouds have nothing in common, or the grid has too many cells.
    """
    lows, highs = np.stack([c[:, :2].min(axis=0) for c in clouds]), np.stack([c[:, :2].max(axis=0) for c in clouds])
    low, high = (lows.max(axis=0), highs.min(axis=0)) if overlap else (lows.min(axis=0), highs.max(axis=0))
    if (high <= low).any():
        raise InvalidInputError(
            "comparison", "the surfaces have no area in common", "check that both are in the same coordinate system"
        )
    first, last = np.floor(low / cell_m), np.ceil(high / cell_m)
    columns, rows = (int(count) for count in last - first)
    if columns * rows > MOST_CELLS:
        raise InvalidInputError(
            "raster", f"{columns} x {rows} cells of {cell_m:g} m are too many", f"at most {MOST_CELLS}: larger cells"
        )
    return Grid(float(first[0] * cell_m), float(first[1] * cell_m), cell_m, rows, columns)


@dataclass(frozen=True, eq=False)
class RasterSurface:
    """A surface on a grid; NaN where there is none."""

    heights_m: GridValues
    """Heights of the moving plane at the middles of the cells [m]."""
    std_m: GridValues
    """Standard deviations of these heights, from the points' number, places and scatter, and from bends and steps of
    the surface [m] (A-08 of the quality of terrain models: density, distance, curvature, residuals)."""
    counts: GridValues
    """Points in each cell."""


def raster_surface(uvh: Points, grid: Grid) -> RasterSurface:
    """Fit a plane to the points in each cell and its eight neighbours, and take its height in the middle (MATH 11.5).

    Unlike the mean of the heights it has no error on slopes whose points lie aside. h = h₀ of z = h₀ + b₁ u + b₂ v,
    its standard deviation is that of `plane_std`. O(n + cells).

    Parameters
    ----------
    uvh
        (n, 3) places and heights [m].
    grid
        The cells.
    """
    own = _cell_moments(uvh, grid)
    moments = _pooled(own)
    n, u, v, z, uu, uv, vv, uz, vz, zz = np.moveaxis(moments, -1, 0)
    enough = n >= LEAST_POINTS
    safe = np.where(enough, n, 1.0)
    mu, mv, mz = u / safe, v / safe, z / safe
    cuu, cuv, cvv = uu - n * mu * mu, uv - n * mu * mv, vv - n * mv * mv
    cuz, cvz, czz = uz - n * mu * mz, vz - n * mv * mz, zz - n * mz * mz
    determinant = cuu * cvv - cuv**2
    good = enough & (determinant > LEAST_SPREAD * (0.5 * (cuu + cvv)) ** 2)
    per = 1.0 / np.where(good, determinant, 1.0)
    b1, b2 = (cvv * cuz - cuv * cvz) * per, (cuu * cvz - cuv * cuz) * per
    squares = np.maximum(czz - b1 * cuz - b2 * cvz, 0.0)
    heights = mz - b1 * mu - b2 * mv
    planes = CellPlanes(own, good, n, (mu, mv), (cuu, cuv, cvv), heights, (b1, b2), squares)
    cells = grid.cells_of(uvh)
    counts = np.bincount(cells[cells >= 0], minlength=grid.rows * grid.columns)
    return RasterSurface(
        np.where(good, heights, np.nan),
        plane_std(planes),
        counts.reshape(grid.shape).astype(np.float64),
    )


def _cell_moments(uvh: Points, grid: Grid) -> Float64[Array, "rows columns 10"]:
    """Sum 1, u, v, z, uu, uv, vv, uz, vz, zz over each cell; u and v from its middle in cells."""
    cells = grid.cells_of(uvh)
    used = cells >= 0
    cells, z = cells[used], uvh[used, 2]
    places = grid.places(uvh[used])
    u, v = (places - np.floor(places) - 0.5).T
    sums = [np.ones_like(z), u, v, z, u * u, u * v, v * v, u * z, v * z, z * z]
    total = grid.rows * grid.columns
    return np.stack([np.bincount(cells, each, total) for each in sums], axis=-1).reshape(*grid.shape, 10)


def _pooled(moments: Float64[Array, "rows columns 10"]) -> Float64[Array, "rows columns 10"]:
    """Add to each cell's moments those of its eight neighbours, about its own middle."""
    rows, columns = moments.shape[:2]
    padded = np.pad(moments, ((1, 1), (1, 1), (0, 0)))
    out = np.zeros_like(moments)
    for dv in (-1, 0, 1):
        for du in (-1, 0, 1):
            n, u, v, z, uu, uv, vv, uz, vz, zz = np.moveaxis(
                padded[1 + dv : 1 + dv + rows, 1 + du : 1 + du + columns], -1, 0
            )
            out += np.stack(
                [
                    n, u + n * du, v + n * dv, z,
                    uu + 2.0 * du * u + n * du * du, uv + du * v + dv * u + n * du * dv,
                    vv + 2.0 * dv * v + n * dv * dv,
                    uz + du * z, vz + dv * z, zz,
                ],
                axis=-1,
            )  # fmt: skip
    return out


def heights_at(surface_m: GridValues, grid: Grid, uvh: Points) -> Float64[Array, "n"]:
    """Interpolate a surface bilinearly between the middles of cells, (n,); NaN where one of the four is missing."""
    column, row = (grid.places(uvh) - 0.5).T
    c0, r0 = np.floor(column).astype(np.int64), np.floor(row).astype(np.int64)
    inside = (c0 >= 0) & (r0 >= 0) & (c0 + 1 < grid.columns) & (r0 + 1 < grid.rows)
    out = np.full(len(uvh), np.nan)
    c0, r0, s, t = c0[inside], r0[inside], (column - c0)[inside], (row - r0)[inside]
    out[inside] = (
        (1.0 - s) * (1.0 - t) * surface_m[r0, c0]
        + s * (1.0 - t) * surface_m[r0, c0 + 1]
        + (1.0 - s) * t * surface_m[r0 + 1, c0]
        + s * t * surface_m[r0 + 1, c0 + 1]
    )
    return out


def wished_cell(points: int, extent_m: tuple[float, float], points_per_cell: float) -> float:
    """Give an edge of cells that hold so many points on average, rounded to 1, 2 or 5 times a power of ten [m]."""
    edge = math.sqrt(max(extent_m[0] * extent_m[1], 1e-12) * points_per_cell / max(points, 1))
    power = 10.0 ** math.floor(math.log10(edge))
    return float(next((step * power for step in (1.0, 2.0, 5.0) if step * power >= edge), 10.0 * power))
