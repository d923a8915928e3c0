"""The grid that finds edges beside each other, against a search tree."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from algorithms.photos.line_merging_kernels import near_lines


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("extent_px", [40.0, 300.0, 1e6])
def test_pairs_on_the_grid_are_those_of_a_search_tree(seed: int, extent_px: float) -> None:
    rng = np.random.default_rng(seed)
    counts = rng.integers(1, 12, rng.integers(1, 300))
    owners = np.repeat(np.arange(len(counts)), counts)
    points = rng.uniform(-extent_px, [extent_px, 0.3 * extent_px], (len(owners), 2))
    reach = 9.0 if extent_px < 1e3 else 2e3
    pairs = owners[cKDTree(points).query_pairs(reach, output_type="ndarray")]
    expected = {(min(pair), max(pair)) for pair in pairs.tolist() if pair[0] != pair[1]}
    for known in (0, len(counts) // 3, len(counts)):
        found = near_lines(points, owners, reach, known).tolist()
        wanted = {pair for pair in expected if pair[1] >= known}
        assert len(found) == len(wanted)
        assert {tuple(pair) for pair in found} == wanted
