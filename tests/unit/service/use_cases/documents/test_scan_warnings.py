"""What a job says of a scan that it uses."""

import numpy as np
import pytest

from algorithms.scans.scale_plausibility import scale_warnings
from service.use_cases.documents.scan_warnings import warnings_of_scan


@pytest.fixture(scope="module")
def doubt() -> str:
    """Give what is said of a room in millimetres."""
    rng = np.random.default_rng(1)
    points = rng.uniform(0.0, 1.0, (20_000, 3))
    axis = rng.integers(3, size=len(points))
    points[np.arange(len(points)), axis] = rng.integers(2, size=len(points))
    (words,) = scale_warnings(points * [8000.0, 6000.0, 3000.0], None, rng)
    return words


def test_a_doubt_about_metres_is_told_while_no_unit_is_stated(doubt: str) -> None:
    assert warnings_of_scan("a.ply", [{"index": 0, "warnings": [doubt]}], 0, None) == [f"a.ply: {doubt}"]


def test_a_stated_unit_answers_a_doubt_about_metres_and_nothing_else(doubt: str) -> None:
    said = warnings_of_scan("a.ply", [{"index": 0, "warnings": ["3 isolated points", doubt]}], 0, "mm")
    assert said == [
        "a.ply: 3 isolated points",
        "a.ply: the coordinates were converted from mm to metres, as the request states",
    ]
