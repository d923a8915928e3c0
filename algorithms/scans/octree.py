"""Which node of an octree each point belongs to, found in one pass with little memory.

Points come leaf by leaf in Morton order. A node's grid has 2 to the power of `cell_levels` cells a side; a point goes
to the highest node whose cell at that place is still empty, else to its leaf. Only the grids of the ancestors of the
present leaf are in memory, and whatever the order of the leaves, the answer is the same: no two leaves share a cell
unless they share its first point.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from algorithms.arrays import Array
from algorithms.scans.voxel_grid_kernels import first_of_each

CELL_LEVELS = 7
"""128 cells a side of a node: as many points as a picture of it needs."""
DEEPEST = 21
"""Levels that a 64-bit Morton number can tell apart."""

Key = tuple[int, int, int, int]
"""Level, x, y, z."""


def morton(cells: Array) -> Array:
    """Interleave the bits of (n, 3) cell numbers of up to 21 bits, x lowest."""
    code = np.zeros(len(cells), dtype=np.uint64)
    for axis in range(3):
        code |= _spread(cells[:, axis].astype(np.uint64)) << np.uint64(axis)
    return code


def cells_of(code: int, level: int) -> tuple[int, int, int]:
    """Give the cell (x, y, z) of a Morton number of a level."""
    x = y = z = 0
    for bit in range(level):
        x |= (code >> (3 * bit) & 1) << bit
        y |= (code >> (3 * bit + 1) & 1) << bit
        z |= (code >> (3 * bit + 2) & 1) << bit
    return x, y, z


def _spread(values: Array) -> Array:
    """Put two zero bits between the bits of a number."""
    x = values & np.uint64(0x1FFFFF)
    for shift, mask in (
        (32, 0x1F00000000FFFF), (16, 0x1F0000FF0000FF), (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3), (2, 0x1249249249249249),
    ):  # fmt: skip
        x = (x | (x << np.uint64(shift))) & np.uint64(mask)
    return x


@dataclass(eq=False)
class _Ancestor:
    key: Key
    taken: set[int] = field(default_factory=set)
    records: list[Array] = field(default_factory=list)


@dataclass(eq=False)
class OctreeSorter:
    """Hand over nodes as they are complete: a leaf at once, an inner node when its last leaf has come."""

    deepest: int
    """Level of the cells by which points come."""
    cell_levels: int = CELL_LEVELS
    """2 to its power are the cells a side of a node's grid."""
    path: list[_Ancestor] = field(default_factory=list)

    def leaf(self, level: int, code: int, cells: Array, records: Array) -> Iterator[tuple[Key, Array]]:
        """Take the points of a leaf; give the nodes that are complete.

        Parameters
        ----------
        level, code
            Of the leaf: level and Morton number.
        cells
            (n, 3) cell numbers of the points at level `deepest + cell_levels`.
        records
            (n,) what is stored of each, in an order that is random in space.
        """
        key = (level, *cells_of(code, level))
        yield from self._left(key)
        while len(self.path) < level:
            depth = len(self.path)
            x, y, z = (number >> (level - depth) for number in key[1:])
            self.path.append(_Ancestor((depth, x, y, z)))
        codes = morton(cells).astype(np.int64)
        for ancestor in self.path:
            depth = ancestor.key[0]
            in_ancestor = codes >> 3 * (self.deepest - depth)
            chosen = first_of_each(in_ancestor)
            if ancestor.taken:
                of_chosen = in_ancestor[chosen].tolist()
                chosen = chosen[np.fromiter((cell not in ancestor.taken for cell in of_chosen), bool, len(of_chosen))]
            if len(chosen):
                ancestor.records.append(records[chosen])
                if level - depth > self.cell_levels:  # cells that are larger than a leaf are shared by later leaves
                    ancestor.taken.update(in_ancestor[chosen].tolist())
                rest = np.ones(len(records), dtype=np.bool_)
                rest[chosen] = False
                codes, records = codes[rest], records[rest]
        if len(records):
            yield key, records

    def ends(self) -> Iterator[tuple[Key, Array]]:
        """Give the nodes that are left when the last leaf has come."""
        while self.path:
            yield from _complete(self.path.pop())

    def _left(self, key: Key) -> Iterator[tuple[Key, Array]]:
        """Complete the ancestors that are none of a leaf."""
        level = key[0]
        while self.path:
            last = self.path[-1].key
            shift = level - last[0]
            if shift > 0 and tuple(number >> shift for number in key[1:]) == last[1:]:
                return
            yield from _complete(self.path.pop())


def _complete(ancestor: _Ancestor) -> Iterator[tuple[Key, Array]]:
    if ancestor.records:
        yield ancestor.key, np.concatenate(ancestor.records)
