"""The octree: every point in exactly one node, one point a cell."""

import numpy as np

from algorithms.scans.octree import CELL_LEVELS, OctreeSorter, cells_of, morton


def test_no_two_points_of_a_node_share_a_cell_unless_it_is_a_leaf() -> None:
    rng = np.random.default_rng(2)
    deepest, level = 5, 3
    cells = rng.integers(0, 2 ** (deepest + CELL_LEVELS), (20_000, 3))
    code = morton(cells >> (deepest + CELL_LEVELS - level)).astype(np.int64)
    records = np.arange(len(cells))
    sorter, nodes = OctreeSorter(deepest), {}
    for leaf in np.unique(code):
        chosen = np.flatnonzero(code == leaf)
        nodes |= dict(sorter.leaf(level, int(leaf), cells[chosen], records[chosen]))
    nodes |= dict(sorter.ends())
    assert sorted(np.concatenate(list(nodes.values())).tolist()) == records.tolist()
    for key, numbers in nodes.items():
        own = cells[numbers] >> (deepest + CELL_LEVELS - key[0])
        assert (own == key[1:]).all()  # each point lies in its node
        if key[0] < level:
            assert len(np.unique(morton(cells[numbers] >> (deepest - key[0])))) == len(numbers)


def test_morton_numbers_tell_their_cells() -> None:
    cells = np.random.default_rng(1).integers(0, 2**10, (100, 3))
    assert [cells_of(int(code), 10) for code in morton(cells)] == [tuple(cell) for cell in cells.tolist()]
