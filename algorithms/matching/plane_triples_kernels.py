"""Compiled loops over the directions of planes, and over the votes for offsets along them."""

import math
from typing import Any

import numpy as np
from numba import njit

from algorithms.arrays import Array

MOST_BINS = 1_000_000
"""At most so many bins for offsets along an axis; wider ones beyond."""


@njit(cache=True, nogil=True)
def direction_classes(
    normals: Array, weights: Array, order: Array, least_cosine: float, means: Array, totals: Array
) -> Any:  # pragma: no cover - compiled
    """Gather normals about the heaviest ones, write mean directions and weights, and tell how many there are.

    `order` lists the normals by falling weight; those within `least_cosine` of the first one left join it.
    """
    remaining = np.ones(len(normals), dtype=np.bool_)
    found = 0
    for k in order:
        if not remaining[k]:
            continue
        x = y = z = total = 0.0
        for i in range(len(normals)):
            cosine = normals[i, 0] * normals[k, 0] + normals[i, 1] * normals[k, 1] + normals[i, 2] * normals[k, 2]
            if remaining[i] and cosine > least_cosine:
                remaining[i] = False
                x += weights[i] * normals[i, 0]
                y += weights[i] * normals[i, 1]
                z += weights[i] * normals[i, 2]
                total += weights[i]
        length = max(math.sqrt(x * x + y * y + z * z), 1e-12)
        means[found, 0], means[found, 1], means[found, 2] = x / length, y / length, z / length
        totals[found] = total
        found += 1
    return found


@njit(cache=True, nogil=True)
def independent(directions: Array, least_sine: float, chosen: Array) -> Any:  # pragma: no cover - compiled
    """Write the numbers of the first three directions that are far from the span of those before; give their count."""
    basis = np.zeros((3, 3))
    count = 0
    for k in range(len(directions)):
        rest = directions[k].copy()
        for a in range(count):
            rest -= (rest @ basis[a]) * basis[a]
        length = math.sqrt(rest @ rest)
        if length > least_sine:
            basis[count] = rest / length
            chosen[count] = k
            count += 1
        if count == 3:
            break
    return count


@njit(cache=True, nogil=True)
def peaks(
    offsets: Array, weights: Array, bin_m: float, means: Array, votes: Array
) -> Any:  # pragma: no cover - compiled
    """Write the offsets with most votes: the mean within a bin's width around each peak, and its votes; their count.

    A bin counts with half of its neighbours, and peaks are at least three bins apart.
    """
    low = offsets.min()
    bin_m = max(bin_m, (offsets.max() - low) / MOST_BINS)
    bins = int((offsets.max() - low) / bin_m) + 1
    counts, sums, smooth = np.zeros(bins), np.zeros(bins), np.zeros(bins)
    for k in range(len(offsets)):
        b = int((offsets[k] - low) / bin_m)
        counts[b] += weights[k]
        sums[b] += weights[k] * offsets[k]
    for b in range(bins):
        smooth[b] = counts[b] + 0.5 * ((counts[b - 1] if b > 0 else 0.0) + (counts[b + 1] if b + 1 < bins else 0.0))
    for p in range(len(means)):
        b = int(np.argmax(smooth))
        if smooth[b] <= 0.0:
            return p
        first, end = max(0, b - 1), min(b + 2, bins)
        means[p] = sums[first:end].sum() / counts[first:end].sum()
        votes[p] = smooth[b]
        smooth[max(0, b - 2) : b + 3] = 0.0
    return len(means)
