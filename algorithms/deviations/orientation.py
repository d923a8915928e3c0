"""To which side of a surface distances count as positive."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree
from scipy.spatial import cKDTree

from algorithms.arrays import CorePoints, Flags, Points, Vector3
from algorithms.scans.voxel_grid import fullest_of_voxels

NEIGHBOURS = 10
MOST_PROPAGATED = 200_000
"""Places whose orientations are made consistent with each other; all others follow the nearest of them."""
STEEPEST = 0.5
"""Of the ground, as the cosine of its slope."""
LEAST_GROUND, MOST_ABOVE_OTHERS = 0.9, 0.02
"""Shares of the places that are no steeper, and of those that have another surface above or below, of a terrain."""
CELL_SPACINGS = 4.0
"""Edge of the cells in which a terrain has one height, in mean distances of neighbours."""
WEAKEST_LINK = 1e-6


class OrientedBy(StrEnum):
    """What tells the positive side."""

    STATED = "stated"
    INSTRUMENTS = "instruments"
    UP = "up"
    NEIGHBOURS = "neighbours"
    """One side is as good as the other: the sign is arbitrary."""


@dataclass(frozen=True, eq=False)
class Orientation:
    """Normals that look to the positive side."""

    normals: Points
    """(k, 3) unit normals, zero where there is no surface."""
    by: OrientedBy

    @property
    def is_arbitrary(self) -> bool:
        """Whether all signs could as well be the opposite ones."""
        return self.by is OrientedBy.NEIGHBOURS


@dataclass(frozen=True, eq=False)
class Side:
    """A side that is stated: that of a place, or the one to which a direction points."""

    point_m: Vector3 | None = None
    direction: Vector3 | None = None


def orientation(
    normals: Points, places: CorePoints, instruments_m: CorePoints | None, stated: Side | None
) -> Orientation:
    """Turn the normals of a surface to its positive side.

    To the side that is stated; else to the instruments; else upwards, where the surface is a terrain. Else the normals
    are made consistent with their neighbours', and the sign is arbitrary. O(k log k).

    Parameters
    ----------
    normals, places
        (k, 3) unit normals of either sign, zero where there is no surface, and where they stand [m].
    instruments_m
        (k, 3) where the instrument that measured each place stood [m]; None: not all are known.
    stated
        The side, or None.
    """
    if stated is not None and stated.point_m is not None:
        return Orientation(_turned(normals, stated.point_m - places), OrientedBy.STATED)
    if stated is not None and stated.direction is not None:
        return Orientation(_turned(normals, np.broadcast_to(stated.direction, normals.shape)), OrientedBy.STATED)
    if instruments_m is not None:
        return Orientation(_turned(normals, instruments_m - places), OrientedBy.INSTRUMENTS)
    if is_terrain(normals, places):
        return Orientation(_turned(normals, np.broadcast_to((0.0, 0.0, 1.0), normals.shape)), OrientedBy.UP)
    return Orientation(propagated(normals, places), OrientedBy.NEIGHBOURS)


def is_terrain(normals: Points, places: CorePoints) -> bool:
    """Check whether a surface is seen from above: nearly everywhere flat enough, and without another one above it.

    Parameters
    ----------
    normals, places
        As of `orientation`.
    """
    surface = np.einsum("ij,ij->i", normals, normals) > 0.5
    if not surface.any() or float(np.mean(np.abs(normals[surface, 2]) >= STEEPEST)) < LEAST_GROUND:
        return False
    here = places[surface]
    few = here[:: max(1, len(here) // 2000)]
    cell = CELL_SPACINGS * float(np.median(np.asarray(cKDTree(here).query(few, k=2)[0])[:, 1]))
    if cell <= 0.0:
        return False
    cells = np.floor((here[:, :2] - here[:, :2].min(axis=0)) / cell).astype(np.int64)
    order = np.lexsort((here[:, 2], cells[:, 1], cells[:, 0]))
    same = np.all(np.diff(cells[order], axis=0) == 0, axis=1)
    # the steepest ground rises within a cell by its diagonal times the slope; more is a step to another surface
    steps = same & (np.diff(here[order, 2]) > 2.0 * np.sqrt(2.0) * cell)
    above = np.unique(cells[order][1:][steps], axis=0)
    return len(above) <= MOST_ABOVE_OTHERS * len(np.unique(cells, axis=0))


def propagated(normals: Points, places: CorePoints) -> Points:
    """Make normals consistent with their neighbours' along the tree of the surest links (Hoppe and others 1992).

    Two neighbours agree when the one is the other, mirrored at the plane half way between them: so corners and the two
    faces of a thin wall are right as well. Connected parts look upwards on the whole. O(k log k).

    Parameters
    ----------
    normals, places
        As of `orientation`.
    """
    surface = np.flatnonzero(np.einsum("ij,ij->i", normals, normals) > 0.5)
    if len(surface) < 2:
        return normals.copy()
    chosen = _thinned(places[surface])
    at, along = places[surface[chosen]], normals[surface[chosen]]
    signs = _consistent_signs(at, along)
    # all others look to the side of the nearest chosen one
    nearest = np.asarray(cKDTree(at).query(places[surface])[1])
    agreement = _agreement(places[surface], normals[surface], at[nearest], along[nearest])
    turned = signs[nearest] * np.where(agreement < 0.0, -1.0, 1.0)
    turned[chosen] = signs
    result = normals.copy()
    result[surface] *= turned[:, None]
    return result


def _consistent_signs(places: CorePoints, normals: Points) -> np.ndarray:
    count = min(NEIGHBOURS + 1, len(places))
    _, found = cKDTree(places).query(places, k=count)
    first = np.repeat(np.arange(len(places)), count - 1)
    second = np.asarray(found)[:, 1:].ravel()
    agreement = _agreement(places[first], normals[first], places[second], normals[second])
    weights = 1.0 - np.abs(agreement) + WEAKEST_LINK
    low, high = np.minimum(first, second), np.maximum(first, second)
    different = low < high
    _, once = np.unique(np.stack([low, high], axis=1)[different], axis=0, return_index=True)
    low, high, weights = (each[different][once] for each in (low, high, weights))
    size = len(places)
    tree = minimum_spanning_tree(coo_array((weights, (low, high)), shape=(size, size)).tocsr())
    parts, labels = connected_components(tree, directed=False)
    signs = np.ones(size)
    roots = np.unique(labels, return_index=True)[1]
    for root in roots[:parts].tolist():
        order, before = breadth_first_order(tree, root, directed=False)
        chain, parents = order[1:], before[order[1:]]
        flips = np.where(_agreement(places[chain], normals[chain], places[parents], normals[parents]) < 0.0, -1.0, 1.0)
        for place, parent, flip in zip(chain.tolist(), parents.tolist(), flips.tolist(), strict=True):
            signs[place] = signs[parent] * flip
    upwards = np.bincount(labels, weights=signs * (normals @ (0.1, 0.01, 1.0)), minlength=parts)
    return np.asarray(signs * np.where(upwards[labels] < 0.0, -1.0, 1.0))


def _thinned(places: CorePoints) -> np.ndarray:
    """Choose places, no more than `MOST_PROPAGATED`, evenly over the surface."""
    if len(places) <= MOST_PROPAGATED:
        return np.arange(len(places))
    few = places[:: max(1, len(places) // 2000)]
    edge = float(np.median(np.asarray(cKDTree(places).query(few, k=2)[0])[:, 1]))
    while True:
        edge *= 1.5 if edge > 0.0 else 1.0
        edge = edge or 1e-3
        chosen = np.asarray(fullest_of_voxels(places, edge, np.ones(len(places))))
        if len(chosen) <= MOST_PROPAGATED:
            return chosen


def _agreement(places: Points, normals: Points, others: Points, their_normals: Points) -> np.ndarray:
    """Compare normals with those of others, mirrored at the plane half way between: 1 for the same side, -1 for not."""
    apart = others - places
    squared = np.maximum(np.einsum("ij,ij->i", apart, apart), np.finfo(float).tiny)
    along = np.einsum("ij,ij->i", apart, normals) * np.einsum("ij,ij->i", apart, their_normals)
    return np.asarray(np.einsum("ij,ij->i", normals, their_normals) - 2.0 * along / squared)


def _turned(normals: Points, towards: Points) -> Points:
    backwards: Flags = np.einsum("ij,ij->i", normals, towards) < 0.0
    return np.where(backwards[:, None], -normals, normals)
