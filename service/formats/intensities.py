"""Ranges of intensities: those that begin below zero, and whole numbers or shares that formats want."""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, Floats32

LARGEST_16_BIT = 65535.0
FULL_SCALES = (1.0, 255.0, 4095.0, LARGEST_16_BIT)
"""Largest intensities of shares and of 8, 12 and 16 bits."""
LEAST_PTS, LARGEST_PTS = -2048.0, 2047.0
"""Range of intensities in PTS."""
LOWEST_DECIBELS = -100.0
"""Least intensity that may be a reflectance in decibels: one of 1e-10 comes back from nothing."""
HALF_RANGES = (2048.0, 4096.0, 32768.0)
"""Halves of the ranges that begin below zero: of PTS, of some writers of PTS, and of signed integers."""


@dataclass(frozen=True)
class SignedRange:
    """Range of intensities that begins below zero, such as -2048 … 2047 or -2047 … 2048 of PTS."""

    least: float
    largest: float

    def shares(self, intensity: Floats32) -> Floats32:
        """Return intensities (n,) as shares of the range, 0 … 1."""
        shares = (intensity.astype(np.float64) - self.least) / (self.largest - self.least)
        return np.clip(shares, 0.0, 1.0).astype(np.float32)


def signed_range(limits: tuple[float, float] | None) -> SignedRange | None:
    """Return the range that intensities of a scan have below and above zero; None where they need no other scale.

    Parameters
    ----------
    limits
        Least and largest of the whole scan. Small numbers below zero are decibels, which stay.
    """
    if limits is None or limits[0] >= LOWEST_DECIBELS:
        return None
    half = next((each for each in HALF_RANGES if -each <= limits[0] and limits[1] <= each), None)
    if half is None:
        return SignedRange(*limits)
    is_above = limits[1] > half - 1.0
    return SignedRange(1.0 - half if is_above and limits[0] > -half else -half, half if is_above else half - 1.0)


def in_unsigned_range(intensity: Floats32 | None, below_zero: SignedRange | None) -> Floats32 | None:
    """Return intensities (n,) as shares where their range begins below zero, else as they are."""
    return intensity if intensity is None or below_zero is None else below_zero.shares(intensity)


def limits_of(intensity: Floats32 | None) -> tuple[float, float] | None:
    """Return least and largest intensity; None where none is known."""
    if intensity is None or len(intensity) == 0:
        return None
    least, largest = float(np.nanmin(intensity, initial=np.inf)), float(np.nanmax(intensity, initial=-np.inf))
    return (least, largest) if np.isfinite([least, largest]).all() else None


def range_in_words(limits: tuple[float, float] | None) -> tuple[str, ...]:
    """Describe what intensities below zero are taken for."""
    if limits is None or limits[0] >= 0.0:
        return ()
    seen, found = f"intensities from {limits[0]:.6g} to {limits[1]:.6g}", signed_range(limits)
    if found is not None:
        return (f"{seen} are read as shares from 0 to 1 of the range {found.least:.0f} … {found.largest:.0f}",)
    return (f"{seen} are taken for decibels where brightness is compared",)


def unit_intensities(intensity: Floats32, limits: tuple[float, float] | None, full_scale: float | None = None) -> Array:
    """Bring intensities to 0 … 1 of the largest number that a format has.

    Parameters
    ----------
    intensity
        As in the scan.
    limits
        Least and largest of the whole cloud. Numbers below zero are stretched from the least to the largest.
    full_scale
        Number that becomes 1; None: that of shares, 8, 12 or 16 bits which holds the largest.
    """
    low, high = _scale(limits, full_scale)
    return np.clip((np.nan_to_num(intensity.astype(np.float64)) - low) / (high - low), 0.0, 1.0)


def sixteen_bit(limits: tuple[float, float] | None, full_scale: float | None) -> float:
    """Return the number that becomes the largest of 16 bits: integers stay as they are, shares are stretched."""
    if full_scale is None and limits is not None and 0.0 < limits[1] <= 1.0:
        return 1.0
    return LARGEST_16_BIT


def is_rescaled(limits: tuple[float, float] | None, full_scale: float | None, largest: float) -> bool:
    """Check whether intensities get other numbers where a format has them from 0 to `largest`."""
    return limits is not None and _scale(limits, full_scale) != (0.0, largest)


def _scale(limits: tuple[float, float] | None, full_scale: float | None) -> tuple[float, float]:
    if limits is None:
        return 0.0, full_scale or LARGEST_16_BIT
    least, largest = limits
    if least < 0.0 or largest > LARGEST_16_BIT:
        return least, largest if largest > least else least + 1.0
    return 0.0, full_scale or next(each for each in FULL_SCALES if largest <= each)
