"""The texture of the ground moves weighted sums of pixels as much as its covariance says."""

import numpy as np
from scipy import ndimage

from algorithms.targets.photo_textures import texture_covariance


def test_the_covariance_of_weighted_sums_is_that_of_the_texture_whatever_its_length() -> None:
    rng = np.random.default_rng(4)
    rows, columns = np.mgrid[-30:31, -30:31]
    inside = np.maximum(np.abs(rows), np.abs(columns)) < 6
    # what lies beside the two pairs of sides moves a square along its axes
    weights = np.stack([columns, rows]) * ((np.maximum(np.abs(rows), np.abs(columns)) < 8) & ~inside)
    for smoothed in (0.0, 2.0):
        sums, stated = [], []
        for _ in range(60):
            noise = rng.normal(0.0, 10.0, rows.shape)
            # longer along rows, as joints of bricks are
            ground = 90.0 + 0.2 * rows + ndimage.gaussian_filter(noise, (smoothed, 2.0 * smoothed), mode="wrap")
            sums.append(np.einsum("kij,ij->k", weights, ground - 0.2 * rows))
            stated.append(texture_covariance(np.where(inside, 200.0, ground), ~inside, weights))
        expected, mean = np.cov(np.transpose(sums)), np.mean(stated, axis=0)
        # a variance of 60 is known to 18 %
        assert np.all(np.abs(np.diag(mean) / np.diag(expected) - 1.0) < 0.5)


def test_too_little_ground_tells_no_texture() -> None:
    ground = np.zeros((9, 9), dtype=bool)
    ground[:2] = True
    assert texture_covariance(np.ones((9, 9)), ground, np.ones((2, 9, 9))) is None
