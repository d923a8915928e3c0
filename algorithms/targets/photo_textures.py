"""How the texture of what lies beside a target in a photo moves what is measured there."""

import numpy as np

from algorithms.arrays import Array

LEAST_PIXELS = 50
"""Fewer pixels tell no texture."""


def texture_covariance(grey: Array, ground: Array, weights: Array) -> Array | None:
    """Give the covariance (k, k) that the texture of the ground, and the noise in it, gives to weighted sums of pixels.

    The texture is taken for one random field around the target: how bright pixels are together, at each distance and in
    each direction, is measured where the ground is seen. The sum of w_i w_j c(i - j) over all pixels is then one over
    all waves of their spectra, whatever the texture's length and direction (joints of bricks).

    Parameters
    ----------
    grey
        (rows, columns) brightness around the target.
    ground
        Which of its pixels (rows, columns) show the ground.
    weights
        (k, rows, columns) of the pixels behind which the ground lies.

    Returns
    -------
    The covariance, or None where too few pixels show the ground.
    """
    rows, columns = np.nonzero(ground)
    if len(rows) < LEAST_PIXELS:
        return None
    design = np.column_stack([np.ones(len(rows)), rows, columns])
    values = grey[rows, columns].astype(np.float64)
    field = np.zeros(grey.shape)
    field[rows, columns] = values - design @ np.linalg.lstsq(design, values, rcond=None)[0]
    # twice as large, nothing meets itself around the rim
    size = tuple(2 * length for length in grey.shape)
    power = np.abs(np.fft.fft2(field, size)) ** 2 / len(rows)
    waves = np.fft.fft2(weights, size).reshape(len(weights), -1)
    return np.asarray(((waves * power.ravel()) @ waves.conj().T).real / power.size)
