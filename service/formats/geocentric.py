"""Coordinates from the middle of the earth, whose z is no height."""

import numpy as np

from algorithms.arrays import Array
from schemas.values.crs import GEOCENTRIC

SEMI_AXES_M = (6_378_137.0, 6_356_752.314)
"""Of the ellipsoid of WGS 84 [m]."""
LOWEST_M = -11_000.0
"""Least height on the earth, in the sea [m]."""
HIGHEST_M = 10_000.0
"""Largest height on the earth, and of a z that is a height [m]."""


def geocentric_in_words(crs_wkt: str | None, bounds_m: Array) -> str:
    """Return a remark that coordinates are geocentric, or nothing.

    A z beyond all heights of the earth, of places on it, shows it where the file states no system.

    Parameters
    ----------
    crs_wkt
        Coordinate reference system that the file states, WKT 1; None: none.
    bounds_m
        (2, 3) least and largest coordinates, full [m].
    """
    if crs_wkt is not None and crs_wkt.startswith(GEOCENTRIC):
        return "the coordinates are geocentric, as the file's reference system says: z is no height"
    x, y, z = np.asarray(bounds_m, dtype=np.float64).mean(axis=0).tolist()
    if crs_wkt is None and abs(z) > HIGHEST_M and LOWEST_M < _height_m(float(np.hypot(x, y)), z) < HIGHEST_M:
        return "the coordinates are geocentric, as they lie on the earth seen from its middle: z is no height"
    return ""


def _height_m(from_axis_m: float, z_m: float) -> float:
    """Return the height over the ellipsoid along the line to its middle, within 15 m per km of height [m]."""
    a, b = SEMI_AXES_M
    return float(np.hypot(from_axis_m, z_m) * (1.0 - 1.0 / np.hypot(from_axis_m / a, z_m / b)))
