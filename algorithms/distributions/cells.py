"""A scan as normal distributions in cubic cells, and how well those of one scan lie in those of another."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Matrices3, Matrix6, Points, Vector3

LEAST_POINTS = 4
"""Cells with fewer points have no distribution."""
LEAST_STD_SHARE = 0.1
"""Distributions are at least so many cells wide along every axis: from one size of cells to the next the pose is known
to about that."""
MOST_CELLS, FAR_SHARE = 1 << 25, 0.0005
"""Of a grid; where it would have more, this share of the outermost points is left out, and then whole sides."""


@dataclass(frozen=True, eq=False)
class CellDistributions:
    """Normal distributions of the points in the cubic cells of two grids, shifted by half a cell along every axis.

    In one grid alone the middles of the cells of a plain wall form a pattern in which those of another scan catch.
    """

    cell_m: float
    """Edge of the cells [m]."""
    means: Points
    """(n, 3) of both grids, those of the first before [m]."""
    covariances: Matrices3
    """(n, 3, 3), enlarged to the least width [m²]."""
    in_first: int
    """So many are of the first grid; by these a source is described."""
    low: Vector3
    """(3,) lower corner of the first grid [m]."""
    grids: Array
    """(2, x, y, z) int32 number of each cell, -1 where there is none."""


@dataclass(frozen=True, eq=False)
class CellScore:
    """How well distributions lie in distributions, and how that changes with the pose."""

    value: float
    """Sum over pairs of cells of exp(-q/2), q the squared distance of the means over both covariances."""
    gradient: Array
    """(6,) by turn [1/rad] about the pivot, and shift [1/m]."""
    hessian: Matrix6
    outer: Matrix6
    """Sum of the outer products of the single source cells' gradients."""


def cell_distributions(points: Points, cell_m: float) -> CellDistributions:
    """Describe points by normal distributions.

    Parameters
    ----------
    points
        (n, 3), n >= 1 [m].
    cell_m
        Edge of the cells [m].
    """
    low, high = points.min(axis=0), points.max(axis=0)
    if float(np.prod((high - low) / cell_m + 3.0)) > MOST_CELLS:
        low, high = np.quantile(points, [FAR_SHARE, 1.0 - FAR_SHARE], axis=0)
    low = low - cell_m
    counts = np.ceil((high - low) / cell_m).astype(np.int64) + 2
    while float(np.prod(counts.astype(np.float64))) > MOST_CELLS:
        counts[np.argmax(counts)] //= 2
    grids = np.full((2, *counts.tolist()), -1, dtype=np.int32)
    means: list[Array] = []
    covariances: list[Array] = []
    for number, grid in enumerate(grids):
        places = np.floor((points - low) / cell_m + 0.5 * number).astype(np.int64)
        inside = ((places >= 0) & (places < counts)).all(axis=1)
        cells, centres, spreads = _moments(points[inside], places[inside], counts)
        grid.ravel()[cells] = np.arange(len(cells), dtype=np.int32) + sum(len(each) for each in means)
        means.append(centres)
        covariances.append(spreads)
    values, vectors = np.linalg.eigh(np.concatenate(covariances))
    values = np.maximum(values, (LEAST_STD_SHARE * cell_m) ** 2)
    widened = np.einsum("nij,nj,nkj->nik", vectors, values, vectors)
    return CellDistributions(cell_m, np.concatenate(means), np.ascontiguousarray(widened), len(means[0]), low, grids)


def _moments(points: Points, places: Array, counts: Array) -> tuple[Array, Array, Array]:
    """Give number, mean and covariance of the points of every cell that has enough."""
    keys = (places[:, 0] * counts[1] + places[:, 1]) * counts[2] + places[:, 2]
    if not len(keys):
        return keys, np.empty((0, 3)), np.empty((0, 3, 3))
    order = np.argsort(keys, kind="stable")
    sorted_keys, ordered = keys[order], points[order]
    firsts = np.flatnonzero(np.concatenate([[True], sorted_keys[1:] != sorted_keys[:-1]]))
    numbers = np.diff(firsts, append=len(keys))
    enough = numbers >= LEAST_POINTS
    centres = np.add.reduceat(ordered, firsts, axis=0) / numbers[:, None]
    off = ordered - np.repeat(centres, numbers, axis=0)
    rows, columns = np.triu_indices(3)
    products = np.add.reduceat(off[:, rows] * off[:, columns], firsts, axis=0)[enough]
    spreads = np.empty((len(products), 3, 3))
    spreads[:, rows, columns] = spreads[:, columns, rows] = products / (numbers[enough] - 1.0)[:, None]
    return sorted_keys[firsts[enough]], centres[enough], spreads


def cell_score(
    target: CellDistributions,
    source: CellDistributions,
    pose: RigidTransform,
    pivot_m: Vector3,
    *,
    derivatives: bool = True,
) -> CellScore:
    """Score a pose by the overlap of distributions (Stoyanov, Magnusson, Andreasson and Lilienthal 2012).

    The rotation perturbs on the left, about the pivot; the derivatives are analytic, the change of the source's
    covariances with the turn included.

    Parameters
    ----------
    target, source
        With cells of about one size.
    pose
        Target from source.
    pivot_m
        (3,) about which place of the target the pose is turned.
    derivatives
        Whether they are wanted; zero otherwise.
    """
    from algorithms.distributions import cell_kernels as kernels

    filled = np.zeros((13, 6))
    value = kernels.score(
        pose.rotation.as_matrix(), np.array(pose.translation), np.ascontiguousarray(pivot_m),
        source.means[: source.in_first], source.covariances[: source.in_first], target.grids, target.low,
        target.cell_m, target.means, target.covariances, filled, derivatives,
    )  # fmt: skip
    return CellScore(value, filled[0], filled[1:7], filled[7:])
