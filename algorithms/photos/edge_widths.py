"""Which edges of a photo are wider or narrower than its single edges are.

The lens and the pixels blur every edge alike. Where two edges lie within the blur, as at a ledge or a thin strip, one
profile between them is found: wider than that of a single edge if both rise in the same direction, narrower if the
second falls. Its place is that of neither edge. Soft shadows are wider too.
"""

import numpy as np

from algorithms.arrays import Flags, Scalars

WIDTH_STD = 3.3
"""Standard deviation of the width w of an edge of contrast b along L px for noise of s grey levels: this times s √(w/L)
/ b; about √3 times that of its place, s √(2 √π w / L) / b for the Gaussian profile."""
KNOWN_STD = 0.03
"""Edges whose widths have a smaller standard deviation, in parts of it, tell the width of single edges."""
FEW = 8
"""Fewer such edges do not tell it."""
CORE, CORE_QUANTILE = 0.3, 0.385
"""The shortest interval that holds this share of the known widths is that of single edges; half of its length is so
many standard deviations of a normal distribution."""
LEAST_TOLERANCE = 0.05
"""Widths differ by so much of themselves for reasons that do not move edges: the lens, the direction of the edge."""
SPREADS = 2.5
"""They may differ by so many times the typical deviation of the photo's edges; lenses are not equally sharp everywhere,
nor are corners of buildings."""
SIGNIFICANT = 2.5
DISPLACED = 0.4
"""√(f / (1 - f)) of an edge beside one of a seventh of the contrast; so large are the displacements on rendered photos
of buildings."""


def composite_edges(widths: Scalars, contrasts: Scalars, lengths: Scalars, photo_noise: float) -> Flags:
    """Tell which edges (n,) have a width that a single edge of this photo has not.

    Parameters
    ----------
    widths, lengths
        (n,) of the profiles across the edges, and of the edges [px].
    contrasts
        (n,) [grey levels].
    photo_noise
        Standard deviation of the photo's noise [grey levels].
    """
    stds = _stds(widths, contrasts, lengths, photo_noise)
    single = _of_single_edges(widths, stds)
    if single is None:
        return np.zeros(len(widths), dtype=bool)
    typical, deviation = single
    tolerance = max(LEAST_TOLERANCE * typical, SPREADS * deviation)
    return np.asarray(np.abs(widths - typical) > tolerance + SIGNIFICANT * stds)


def displacement_stds(widths: Scalars, contrasts: Scalars, lengths: Scalars, photo_noise: float) -> Scalars:
    """Give how far another edge within the blur may have displaced each edge (n,), as its width lets expect [px].

    Of two edges D apart, with the share f of the contrast in the second, the profile between them has the variance
    w² = w₀² + f (1 - f) D² and lies f D from the first: √(f / (1 - f)) times √(w² - w₀²). What single edges may be
    wider or narrower without being displaced, and what noise makes them, is not counted.

    Parameters
    ----------
    widths, contrasts, lengths, photo_noise
        As for `composite_edges`.
    """
    stds = _stds(widths, contrasts, lengths, photo_noise)
    single = _of_single_edges(widths, stds)
    if single is None:
        return np.zeros(len(widths))
    tolerance = LEAST_TOLERANCE * single[0] + SIGNIFICANT * stds
    allowed = np.clip(widths, single[0] - tolerance, single[0] + tolerance)
    return np.asarray(DISPLACED * np.sqrt(np.abs(widths**2 - allowed**2)))


def _stds(widths: Scalars, contrasts: Scalars, lengths: Scalars, photo_noise: float) -> Scalars:
    """Give the standard deviations of widths (n,) [px]."""
    scatter = np.sqrt(widths / np.maximum(lengths, 1.0))
    return np.asarray(WIDTH_STD * photo_noise * scatter / np.maximum(contrasts, 1e-9))


def _of_single_edges(widths: Scalars, stds: Scalars) -> tuple[float, float] | None:
    """Give the typical width of single edges and its deviation [px], or None where too few widths are known."""
    known = stds < KNOWN_STD * widths
    if np.count_nonzero(known) < FEW:
        return None
    ordered = np.sort(widths[known])
    count = max(2, round(CORE * len(ordered)))
    lengths_of = ordered[count - 1 :] - ordered[: len(ordered) - count + 1]
    first = int(np.argmin(lengths_of))
    typical = 0.5 * (ordered[first] + ordered[first + count - 1])
    return float(typical), float(0.5 * lengths_of[first] / CORE_QUANTILE)
