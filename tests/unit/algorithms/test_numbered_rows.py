"""Rows are numbered as numpy numbers them, whatever their integers."""

import numpy as np
import pytest

from algorithms.numbered_rows import numbered_rows


@pytest.mark.parametrize("high", [1, 7, 1 << 20, 1 << 31, 1 << 61])
@pytest.mark.parametrize("columns", [1, 3, 5])
def test_rows_are_numbered_as_numpy_does(high: int, columns: int) -> None:
    rng = np.random.default_rng(1)
    rows = rng.integers(-high, high, (400, columns))[rng.integers(0, 400, 1000)]
    different, of_row = numbered_rows(rows)
    expected, numbers = np.unique(rows, axis=0, return_inverse=True)
    np.testing.assert_array_equal(different, expected)
    np.testing.assert_array_equal(of_row, numbers.ravel())


def test_no_rows_have_no_numbers() -> None:
    different, of_row = numbered_rows(np.empty((0, 3), dtype=np.int64))
    assert different.shape == (0, 3)
    assert of_row.shape == (0,)
