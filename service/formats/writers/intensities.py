"""Intensities of any scale in the whole numbers that LAS and PTS want."""

import numpy as np

from algorithms.arrays import Array, Floats32

LARGEST_16_BIT = 65535.0


def unit_intensities(intensity: Floats32, limits: tuple[float, float] | None) -> Array:
    """Bring intensities to 0 … 1 of the largest number that a format has.

    Parameters
    ----------
    intensity
        As in the file.
    limits
        Least and largest of the whole cloud. Up to 1 they are a share; others up to 65535 are taken as they are; all
        else is stretched from its least to its largest.
    """
    low, high = _scale(limits)
    return np.clip((np.nan_to_num(intensity.astype(np.float64)) - low) / (high - low), 0.0, 1.0)


def is_stretched(limits: tuple[float, float] | None) -> bool:
    """Tell whether the scale of the intensities is changed for whole numbers of 16 bits."""
    return limits is not None and _scale(limits) != (0.0, LARGEST_16_BIT)


def _scale(limits: tuple[float, float] | None) -> tuple[float, float]:
    if limits is None:
        return 0.0, LARGEST_16_BIT
    least, largest = limits
    if least < 0.0 or largest > LARGEST_16_BIT:
        return least, largest if largest > least else least + 1.0
    return 0.0, 1.0 if 0.0 < largest <= 1.0 else LARGEST_16_BIT
