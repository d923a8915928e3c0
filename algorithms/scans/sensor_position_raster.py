"""Positions all over a cloud where an instrument may have stood: few, however far the cloud extends."""

import numpy as np
from scipy.spatial import cKDTree

from algorithms.arrays import Array, Points

NEAREST_SURFACE_M = (0.05, 3.5)
"""A terrestrial instrument stands on something: its nearest measured surface is within these bounds [m]. Without this
bound a bird's-eye view of a street explains the cloud as well as the true position does."""
MAX_CANDIDATES = 4_000
"""Positions at most."""
LARGEST_RASTER = 2_000_000
"""A box of more raster positions is not filled: positions are drawn near surfaces instead."""
DRAWN_FOR_ONE = 8
"""So many are drawn near surfaces for each that is kept."""
ROUGHLY = 0.2
"""How far these are from surfaces may be wrong by this share."""


def positions_near_surface(points: Points, tree: "cKDTree[None]", rng: np.random.Generator) -> tuple[Array, float]:
    """Draw positions all over the cloud where an instrument may stand, (m, 3), and tell their distance [m].

    They are those of a raster that fills the cloud's box. Where the box is too large for that, because the cloud
    reaches far or its coordinates are in another unit than metres, as many are drawn around the occupied cells of that
    raster, each of them as likely as another, so that neither memory nor time grow with the box.

    Parameters
    ----------
    points
        (n, 3) the cloud [m].
    tree
        Of the same points.
    rng
        Draws the offsets of the raster.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    step = float(np.clip((np.prod(high - low + 1.0) / 6000.0) ** (1.0 / 3.0), 0.4, 2.0))
    if float(np.prod((high - low) / step + 2.0)) <= LARGEST_RASTER:
        axes = [np.arange(a, b + step, step) for a, b in zip(low, high, strict=True)]
        raster = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        raster = raster + rng.uniform(-0.3, 0.3, size=raster.shape) * step
    else:
        raster = _around_occupied_cells(points - low, step, rng) + low
    # A raster point may be half a step nearer or farther than the position it stands for.
    farthest = NEAREST_SURFACE_M[1] + 0.5 * step
    nearest = np.asarray(tree.query(raster, eps=ROUGHLY, distance_upper_bound=farthest)[0])
    raster = raster[(nearest > NEAREST_SURFACE_M[0]) & (nearest < farthest)]
    if len(raster) > MAX_CANDIDATES:
        raster = raster[np.sort(rng.permutation(len(raster))[:MAX_CANDIDATES])]
    return raster, step


def _around_occupied_cells(points: Points, step: float, rng: np.random.Generator) -> Array:
    """Draw positions in occupied cells and in their surroundings, as far as an instrument may stand from a surface."""
    cells = np.unique(np.floor(points / step), axis=0)
    chosen = cells[rng.integers(len(cells), size=DRAWN_FOR_ONE * MAX_CANDIDATES)]
    reach = NEAREST_SURFACE_M[1] / step + 0.5
    return np.asarray((chosen + 0.5 + rng.uniform(-reach, reach, size=chosen.shape)) * step)
