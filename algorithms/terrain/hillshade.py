"""Terrain as it looks in slanting light."""

import numpy as np
from jaxtyping import UInt8

from algorithms.arrays import Array
from algorithms.deviations.rasters import Grid, GridValues


def hillshade(
    heights_m: GridValues, grid: Grid, azimuth_deg: float, altitude_deg: float
) -> UInt8[Array, "rows columns"]:
    """Give the brightness of a diffuse surface, 0 to 255.

    Parameters
    ----------
    heights_m, grid
        Heights without gaps [m], and their cells.
    azimuth_deg
        From where the light comes, clockwise from north (y) [degrees].
    altitude_deg
        Of the light above the horizon [degrees].
    """
    along_v, along_u = np.gradient(heights_m, grid.cell_m) if min(grid.shape) > 1 else (np.zeros(grid.shape),) * 2
    azimuth, altitude = np.radians(azimuth_deg), np.radians(altitude_deg)
    light = np.array([np.sin(azimuth) * np.cos(altitude), np.cos(azimuth) * np.cos(altitude), np.sin(altitude)])
    cosine = (light[2] - along_u * light[0] - along_v * light[1]) / np.sqrt(1.0 + along_u**2 + along_v**2)
    return np.asarray(np.rint(255.0 * np.clip(cosine, 0.0, 1.0)), dtype=np.uint8)
