"""Slope, aspect and curvature of height grids, from a quadratic surface through each 3 x 3 cells (Evans 1972)."""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array
from algorithms.deviations.rasters import GridValues

LEVEL = 1e-9
"""A tangent of the slope below which a cell has no aspect."""


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Of every cell; NaN on the border and beside gaps."""

    slope_rad: GridValues
    """Steepest slope [rad]."""
    aspect_rad: GridValues
    """Direction downhill, clockwise from north (y), 0 to 2π [rad]; NaN where it is level."""
    profile_curvature: GridValues
    """Curvature of the section along the slope, positive where it is convex (a shoulder) [1/m]."""
    plan_curvature: GridValues
    """Curvature of the contour line, positive where it is convex (a spur) [1/m]."""
    mean_curvature: GridValues
    """Mean of the principal curvatures, positive on hilltops [1/m]."""


def derivatives(heights_m: GridValues, cell_m: float) -> Derivatives:
    """Fit z = r x²/2 + s x y + t y²/2 + p x + q y + c to each cell and its eight neighbours; exact for such surfaces.

    Parameters
    ----------
    heights_m
        Rows count along y, columns along x [m].
    cell_m
        Edge of the cells [m].
    """
    z = np.pad(heights_m, 1, constant_values=np.nan)
    (a, b, c), (d, e, f), (g, h, i) = ([_shifted(z, dv, du) for du in (-1, 0, 1)] for dv in (-1, 0, 1))
    p = (c + f + i - a - d - g) / (6.0 * cell_m)
    q = (g + h + i - a - b - c) / (6.0 * cell_m)
    r = (a + c + d + f + g + i - 2.0 * (b + e + h)) / (3.0 * cell_m**2)
    t = (a + b + c + g + h + i - 2.0 * (d + e + f)) / (3.0 * cell_m**2)
    s = (a + i - c - g) / (4.0 * cell_m**2)
    steep = p * p + q * q
    sloping = steep > LEVEL**2
    safe = np.where(sloping, steep, 1.0)
    level = np.isnan(p)
    profile = -(r * p * p + 2.0 * s * p * q + t * q * q) / (safe * (1.0 + steep) ** 1.5)
    plan = -(r * q * q - 2.0 * s * p * q + t * p * p) / safe**1.5
    mean = -((1.0 + q * q) * r - 2.0 * p * q * s + (1.0 + p * p) * t) / (2.0 * (1.0 + steep) ** 1.5)
    nothing = np.where(level, np.nan, 0.0)
    return Derivatives(
        np.arctan(np.sqrt(steep)),
        np.where(sloping, np.mod(np.arctan2(-p, -q), 2.0 * np.pi), np.nan),
        np.where(sloping, profile, nothing),
        np.where(sloping, plan, nothing),
        mean,
    )


def _shifted(padded: Array, dv: int, du: int) -> Array:
    rows, columns = padded.shape
    return padded[1 + dv : rows - 1 + dv, 1 + du : columns - 1 + du]
