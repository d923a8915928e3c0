"""Objects end in steps on all sides; what goes on smoothly into the terrain around it is a part of the terrain.

Openings cut off edges of terraces, ridges and the rims of pits with what stands on the ground. Segments tell them
apart, as in segment-based filtering (Nardinocchi, Forlani and Zingaretti 2003; Sithole and Vosselman 2005): a roof is
bounded by steps, the edge of a terrace only on its lower side.
"""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from algorithms.deviations.rasters import GridValues
from algorithms.terrain.cell_heights import GridFlags

STEP_M = 0.3
"""Neighbouring cells that differ by less go on smoothly."""
LEAST_SHARE = 0.2
"""A segment of which such a share of the rim goes on smoothly into the terrain belongs to it."""


def standing_objects(objects: GridFlags, heights: GridValues) -> GridFlags:
    """Leave out of the cells that stand out those whose segment goes on into the terrain around; O(cells).

    Parameters
    ----------
    objects
        (rows, columns) True for cells that stand out.
    heights
        (rows, columns) without gaps [m].
    """
    numbers = np.arange(heights.size).reshape(heights.shape)
    one = np.concatenate([numbers[:, :-1].ravel(), numbers[:-1].ravel()])
    other = np.concatenate([numbers[:, 1:].ravel(), numbers[1:].ravel()])
    flat, out = heights.ravel(), objects.ravel()
    smooth = np.abs(flat[one] - flat[other]) <= STEP_M
    joined = smooth & out[one] & out[other]
    links = (np.ones(int(joined.sum()), dtype=np.int8), (one[joined], other[joined]))
    _, segments = connected_components(coo_array(links, shape=(len(flat), len(flat))), directed=False)
    rim, open_ = np.zeros(len(flat)), np.zeros(len(flat))
    for a, b in ((one, other), (other, one)):
        leaving = out[a] & (segments[a] != segments[b])
        rim += np.bincount(segments[a[leaving]], minlength=len(flat))
        open_ += np.bincount(segments[a[leaving & ~out[b] & smooth]], minlength=len(flat))
    terrain = (open_ >= LEAST_SHARE * rim) & (rim > 0.0)
    return np.asarray(objects & ~terrain[segments].reshape(objects.shape))
