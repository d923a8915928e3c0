"""The accumulator of points that compiled loops share."""

import numpy as np
from numba import njit

from algorithms.arrays import Array
from algorithms.scans.moments_kernels import NOTHING, with_point, write_central


@njit
def moments_of(points: Array, origin: Array, out: Array) -> None:
    sums = NOTHING
    for i in range(len(points)):
        sums = with_point(sums, points[i, 0] - origin[0], points[i, 1] - origin[1], points[i, 2] - origin[2])
    write_central(sums, origin[0], origin[1], origin[2], out)


def test_count_mean_and_central_sums_are_those_of_the_points_far_from_the_origin_too() -> None:
    centre = np.array([500_000.0, 5_000_000.0, 300.0])
    points = centre + np.random.default_rng(0).normal(size=(200, 3)) * [3.0, 0.5, 0.01]
    out = np.empty(10)
    moments_of(points, points[0], out)
    rest = points - points.mean(axis=0)
    assert out[0] == 200
    np.testing.assert_allclose(out[1:4], points.mean(axis=0), rtol=0.0, atol=2e-9)  # two steps of doubles there
    np.testing.assert_allclose(out[4:], (rest.T @ rest)[np.triu_indices(3)], rtol=1e-6, atol=1e-6)
