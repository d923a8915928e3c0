"""Points in the order of an octree, of any number: they lie in a file in between, and little of them in memory.

The points are read twice, once to count them by cells, once to put each into the file at the place of its leaf; from
there leaf after leaf is sorted into nodes.
"""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Protocol

import numpy as np

from algorithms.arrays import Array
from algorithms.progress import Progress, ProgressSection
from algorithms.scans.octree import CELL_LEVELS, Key, OctreeSorter, morton


class OctreePoints(Protocol):
    """Records of points, and where they lie in the root of the octree."""

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of a record."""
        ...

    def pieces(self, progress: Progress) -> Iterator[Array]:
        """Give all records piece by piece, in the same order each time."""
        ...

    def cells(self, records: Array, level: int) -> Array:
        """Give the (n, 3) cells of a level in which records lie."""
        ...


@dataclass(frozen=True)
class OctreeShape:
    """How an octree is divided."""

    most_in_leaf: int
    """A node with more points is divided."""
    deepest: int = 10
    """Level of the deepest leaves."""
    cell_levels: int = CELL_LEVELS
    """2 to its power are the cells a side of a node's grid, in each of which a node has one point."""


@dataclass(frozen=True, eq=False)
class _Leaves:
    """The leaves of the octree in Morton order."""

    levels: Array
    codes: Array
    """Morton number of each at its own level."""
    starts: Array
    """Morton number of the first cell of each at the deepest level."""
    offsets: Array
    """(leaves + 1,) number of points before each."""


def octree_nodes(
    points: OctreePoints, spool: Any, shape: OctreeShape, progress: Progress
) -> Iterator[tuple[Key, Array]]:
    """Give the nodes of an octree with their records: every point in exactly one, in an order that does not change.

    Parameters
    ----------
    points
        What is to be sorted.
    spool
        An open file, to write to and read from, which will be as long as all records.
    shape
        Of the octree.
    progress
        Is told how far the first two readings are.
    """
    leaves = _leaves(points, shape, ProgressSection(progress, 0.0, 0.5))
    _spool(spool, points, shape, leaves, ProgressSection(progress, 0.5, 1.0))
    yield from _sorted_nodes(spool, points, shape, leaves)


def _leaves(points: OctreePoints, shape: OctreeShape, progress: Progress) -> _Leaves:
    """Count the points of the deepest cells and join cells to leaves that are not too large."""
    codes, counts = np.zeros(0, dtype=np.uint64), np.zeros(0, dtype=np.int64)
    for records in points.pieces(progress):
        code = morton(points.cells(records, shape.deepest))
        fresh, count = np.unique(code, return_counts=True)
        merged, inverse = np.unique(np.concatenate([codes, fresh]), return_inverse=True)
        counts = np.bincount(inverse, weights=np.concatenate([counts, count]), minlength=len(merged)).astype(np.int64)
        codes = merged
    levels = np.zeros(len(codes), dtype=np.int64)
    for level in range(shape.deepest):
        above = codes >> np.uint64(3 * (shape.deepest - level))
        _, inverse = np.unique(above, return_inverse=True)
        crowded = np.bincount(inverse, weights=counts)[inverse] > shape.most_in_leaf
        levels[crowded] = level + 1
    shifts = (3 * (shape.deepest - levels)).astype(np.uint64)
    starts, first = np.unique((codes >> shifts) << shifts, return_index=True)
    sums = np.add.reduceat(counts, first) if len(first) else counts
    return _Leaves(levels[first], codes[first] >> shifts[first], starts, np.concatenate([[0], np.cumsum(sums)]))


def _spool(spool: Any, points: OctreePoints, shape: OctreeShape, leaves: _Leaves, progress: Progress) -> None:
    """Write the records of each leaf to its place in a file."""
    size, descriptor = points.dtype.itemsize, spool.fileno()
    places = leaves.offsets[:-1].copy()
    for records in points.pieces(progress):
        leaf = np.searchsorted(leaves.starts, morton(points.cells(records, shape.deepest)), side="right") - 1
        if len(leaves.starts) < 1 << 16:
            leaf = leaf.astype(np.uint16)  # sorted by counting, in a fraction of the time
        order = np.argsort(leaf, kind="stable")
        sorted_records, leaf = records[order], leaf[order]
        ends = np.flatnonzero(np.diff(leaf)) + 1
        for start, end in pairwise([0, *ends.tolist(), len(leaf)]):
            at = leaf[start]
            _write_all(descriptor, sorted_records[start:end].tobytes(), int(places[at]) * size)
            places[at] += end - start


def _write_all(descriptor: int, data: bytes, place: int) -> None:
    written = 0
    while written < len(data):
        written += os.pwrite(descriptor, data[written:], place + written)


def _sorted_nodes(spool: Any, points: OctreePoints, shape: OctreeShape, leaves: _Leaves) -> Iterator[tuple[Key, Array]]:
    size, descriptor = points.dtype.itemsize, spool.fileno()
    sorter, rng = OctreeSorter(shape.deepest, shape.cell_levels), np.random.default_rng(0)
    for at, (start, end) in enumerate(pairwise(leaves.offsets.tolist())):
        data = os.pread(descriptor, (end - start) * size, start * size)
        records = rng.permutation(np.frombuffer(data, dtype=points.dtype))
        cells = points.cells(records, shape.deepest + shape.cell_levels)
        yield from sorter.leaf(int(leaves.levels[at]), int(leaves.codes[at]), cells, records)
    yield from sorter.ends()
