"""Distorted clouds differ from what was scanned by more than a motion, and by as much as they say."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.scenes.buildings.distorted_scans import DISTORTIONS

POINTS = np.random.default_rng(4).uniform(-10.0, 10.0, (2000, 3))
"""A cloud 20 m wide."""


def misfit_m(points: np.ndarray) -> float:
    """Root mean square of what the best motion leaves between a cloud and the undistorted one."""
    ours, theirs = POINTS - POINTS.mean(axis=0), points - points.mean(axis=0)
    return float(Rotation.align_vectors(ours, theirs)[1] / np.sqrt(len(points)))


@pytest.mark.parametrize("name", list(DISTORTIONS))
def test_a_factor_of_one_changes_nothing(name: str) -> None:
    np.testing.assert_array_equal(DISTORTIONS[name](POINTS, 1.0), POINTS)


@pytest.mark.parametrize("name", list(DISTORTIONS))
def test_no_motion_makes_up_for_a_distortion_and_twice_as_much_is_twice_as_bad(name: str) -> None:
    once, twice = (misfit_m(DISTORTIONS[name](POINTS, 1.0 + difference)) for difference in (0.01, 0.02))
    # One percent of coordinates of up to 10 m.
    assert 0.02 < once < 0.15
    assert twice == pytest.approx(2.0 * once, rel=0.02)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("scaled", [2.02, 4.04, 6.06]),
        ("stretched x", [2.02, 4.0, 6.0]),
        ("stretched z", [2.0, 4.0, 6.06]),
        ("sheared", [2.06, 4.0, 6.0]),
        ("bent", [2.0, 4.0, 6.004]),
    ],
)
def test_a_point_is_moved_as_stated(name: str, expected: list[float]) -> None:
    np.testing.assert_allclose(DISTORTIONS[name](np.array([[2.0, 4.0, 6.0]]), 1.01), [expected], atol=1e-12)
