"""Compiled loops that join layers of cells of different sizes."""

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def _enter(neighbours: Array, cell: int, other: int) -> None:
    """Note a cell as touching another one if there is a place left."""
    for k in range(neighbours.shape[1]):
        if neighbours[cell, k] == other:
            return
        if neighbours[cell, k] < 0:
            neighbours[cell, k] = other
            return


@njit(cache=True, nogil=True)
def _members(united_of_voxel: Array, numbers: Array, listed: Array, united: int, first: int) -> tuple[Array, Array]:
    """List the smaller cells in every united one: those of u are members[splits[u]:splits[u + 1]]."""
    splits = np.zeros(united + 1, dtype=np.int64)
    for v in range(united_of_voxel.shape[0]):
        if listed[v] and numbers[v] < first:
            splits[united_of_voxel[v] + 1] += 1
    for u in range(united):
        splits[u + 1] += splits[u]
    members = np.empty(splits[united], dtype=np.int32)
    places = splits[:united].copy()
    for v in range(united_of_voxel.shape[0]):
        if listed[v] and numbers[v] < first:
            members[places[united_of_voxel[v]]] = numbers[v]
            places[united_of_voxel[v]] += 1
    return members, splits


@njit(cache=True, nogil=True)
def _nearest(members: Array, moments: Array, cell: int) -> int:
    """Give the cell among some whose mean is nearest to that of another one, the first of equals; -1 of none."""
    nearest = -1
    least = np.inf
    for other in members:
        square = 0.0
        for a in range(1, 4):
            square += (moments[other, a] - moments[cell, a]) ** 2
        if square < least:
            least = square
            nearest = other
    return nearest


@njit(cache=True, nogil=True)
def link_layer(
    united_of_voxel: Array,
    numbers: Array,
    listed: Array,
    neighbours_of_united: Array,
    parents: Array,
    first: int,
    moments: Array,
    neighbours: Array,
) -> None:
    """Enter which cells the cells of one layer touch into the (m, k) neighbours, where -1 is a free place.

    These are the cells of this layer next to each, and, of the smaller ones with a surface in each united cell around
    it, the nearest; that gets the larger cell as a neighbour too.

    Parameters
    ----------
    united_of_voxel
        (v,) united cell of every voxel in this layer.
    numbers
        (v,) cell that every voxel became, or became part of.
    listed
        (v,) True for voxels of cells with a surface.
    neighbours_of_united
        (u, 26) touching united cells, -1 for none.
    parents
        (g,) the united cells that are cells of this layer; their numbers go on from `first`.
    first
        Number of this layer's first cell; smaller ones are of layers below.
    moments
        (m, 10) of the cells.
    neighbours
        What is filled.
    """
    united = neighbours_of_united.shape[0]
    cell_of_united = np.full(united, -1, dtype=np.int32)
    for g in range(parents.shape[0]):
        cell_of_united[parents[g]] = first + g
    members, splits = _members(united_of_voxel, numbers, listed, united, first)
    for g in range(parents.shape[0]):
        cell = first + g
        for k in range(-1, neighbours_of_united.shape[1]):
            u = parents[g] if k < 0 else neighbours_of_united[parents[g], k]
            if u < 0:
                continue
            if k >= 0 and cell_of_united[u] >= 0:
                _enter(neighbours, cell, cell_of_united[u])
            other = _nearest(members[splits[u] : splits[u + 1]], moments, cell)
            if other >= 0:
                _enter(neighbours, cell, other)
                _enter(neighbours, other, cell)
