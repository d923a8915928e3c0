"""A seed on a face of a plinth captures that face and nothing of those beside it."""

import numpy as np
import pytest

from algorithms.errors import InvalidInputError
from algorithms.meshing.captured_planes import captured
from tests.unit.algorithms.meshing.test_constraint_lines import SIZE_M, plinth


def test_a_seed_captures_its_face_but_not_the_rim() -> None:
    points, _ = plinth(0.002)
    found = points[captured(points, np.array([0.5, 0.3, 0.4]), 0.008, 10.0)]
    assert np.abs(found[:, 2] - SIZE_M[2]).max() < 0.01
    # with neither edge: points of the sides would pull the plane down
    assert found[:, 2].mean() == pytest.approx(SIZE_M[2], abs=2e-4)
    whole = (np.abs(points[:, 2] - SIZE_M[2]) < 0.01).sum()
    assert 0.75 * whole < len(found) < whole


def test_a_seed_in_the_air_and_a_heap_are_refused() -> None:
    points, _ = plinth(0.002)
    with pytest.raises(InvalidInputError, match="0 points lie within"):
        captured(points, np.array([5.0, 5.0, 5.0]), 0.008, 1.0)
    heap = np.random.default_rng(1).uniform(size=(2000, 3))
    with pytest.raises(InvalidInputError, match="no plane"):
        captured(heap, np.array([0.5, 0.5, 0.5]), 0.008, 1.0)
