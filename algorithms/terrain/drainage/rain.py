"""Rain on a height grid until what runs off does not change."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int64

from algorithms.arrays import Array
from algorithms.deviations.rasters import GridValues
from algorithms.terrain.drainage.flow_kernels import flood, rain_once, settled_runoff, shares_of


@dataclass(frozen=True, eq=False)
class Rain:
    """Water on a terrain whose hollows are full."""

    filled_m: GridValues
    """Heights with hollows filled to the lowest point of their rims [m]."""
    runoff: GridValues
    """What runs into each cell, in units of the rain on one cell: the cells of its catchment without itself."""
    shares: Array
    """(cells, 4) of a cell's water that run to its neighbours: next column, previous column, next row, previous row."""
    order: Array
    """(cells,) cells in the order in which flooding from outside reaches them."""
    main: Int64[Array, "cells"]
    """To which cell most of the water of each runs, -1 for none."""
    parents: Int64[Array, "cells"]
    """From which cell flooding reached each, -1 at outlets."""


def rain_on(heights_m: GridValues) -> Rain:
    """Let it rain one unit on each cell until the runoff is in equilibrium.

    The water of a cell runs to the lower ones of its four neighbours in proportion to the slopes; hollows fill to the
    lowest point of their rims and overflow there; beyond the border and in gaps (NaN), where slopes go on as before, it
    is lost. The equilibrium of
    the rounds of `runoff_of_rounds` is computed at once, for water runs only to cells that flooding reaches earlier:
    O(cells log cells).

    Parameters
    ----------
    heights_m
        Of the cells [m].
    """
    filled, order, parents = flood(np.ascontiguousarray(heights_m))
    shares, main = shares_of(filled, parents)
    runoff = settled_runoff(shares, order, heights_m.shape[1]).reshape(heights_m.shape)
    return Rain(filled, np.where(np.isnan(heights_m), np.nan, runoff), shares, order, main, parents)


def runoff_of_rounds(rain: Rain, rounds: int) -> list[GridValues]:
    """Give what runs into each cell after each round of rain, as the source tabulates it."""
    runoff = np.zeros(rain.runoff.size)
    tables = []
    for _ in range(rounds):
        runoff = rain_once(rain.shares, runoff, rain.runoff.shape[1])
        tables.append(runoff.reshape(rain.runoff.shape))
    return tables
