"""ESRI ASCII grids, which every geographic information system reads."""

import io

import numpy as np

from algorithms.deviations.rasters import Grid, GridValues

NO_DATA = -9999


def esri_ascii(values: GridValues, grid: Grid, origin: tuple[float, float] = (0.0, 0.0)) -> bytes:
    """Give a grid as text, the northernmost row first.

    Parameters
    ----------
    values
        One for each cell; NaN becomes `NO_DATA`.
    grid
        The cells.
    origin
        What was subtracted from the places of the grid [m].
    """
    text = io.BytesIO()
    header = (
        f"ncols {grid.columns}\nnrows {grid.rows}\nxllcorner {origin[0] + grid.u_min_m:.6f}\n"
        f"yllcorner {origin[1] + grid.v_min_m:.6f}\ncellsize {grid.cell_m:.10g}\nNODATA_value {NO_DATA}\n"
    )
    text.write(header.encode())
    np.savetxt(text, np.where(np.isfinite(values), values, NO_DATA)[::-1], fmt="%.6g")
    return text.getvalue()
