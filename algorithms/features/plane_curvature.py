"""Tell flat regions from strips of something round."""

import numpy as np
from jaxtyping import Bool, Float64

from algorithms.arrays import Array, Labels, Scalars, Vectors2

BEND_LIMIT_RAD = float(np.deg2rad(5.0))
"""A region whose tangents turn by more from end to end is curved."""
SIGNIFICANCE = 4.0
"""Least ratio of a bend to its own standard deviation."""


def curved_regions(
    labels: Labels, positions: Vectors2, heights: Scalars, weights: Scalars, half_widths: Float64[Array, "k 2"]
) -> Bool[Array, "k"]:
    """Find regions that are bent: strips of pipes, tanks, vaults.

    Along each axis of a region a parabola is fitted to the heights of its pieces over its plane; its second derivative
    times the width is the angle between the tangents at the two ends. It is compared with `BEND_LIMIT_RAD` and with
    its own standard deviation.

    Parameters
    ----------
    labels
        (n,) region of every piece, 0..k-1.
    positions, heights
        (n, 2) in-plane coordinates and (n,) distances from the region's plane [m].
    weights
        (n,) weights of the pieces.
    half_widths
        (k, 2) half extents of the regions along the two axes [m].
    """
    count = len(half_widths)
    curved = np.zeros(count, dtype=np.bool_)

    def add(values: Array) -> Array:
        return np.bincount(labels, values, minlength=count)

    pieces = add(np.ones(len(labels)))
    for axis in (0, 1):
        half = np.maximum(half_widths[:, axis], 1e-9)
        u = positions[:, axis] / half[labels]
        powers = [add(weights * u**k) for k in range(5)]
        ridge = 1e-9 * np.maximum(powers[0], 1e-9)[:, None, None] * np.eye(3)
        system = np.stack([np.stack(powers[k : k + 3], axis=1) for k in range(3)], axis=1) + ridge
        right = np.stack([add(weights * heights * u**k) for k in range(3)], axis=1)
        inverse = np.linalg.inv(system)
        parabola = np.einsum("kij,kj->ki", inverse, right)
        left = np.maximum(add(weights * heights**2) - np.einsum("ki,ki->k", parabola, right), 0.0)
        bend = 4.0 * np.abs(parabola[:, 2]) / half
        bend_std = 4.0 * np.sqrt(inverse[:, 2, 2] * left / np.maximum(pieces - 3.0, 1.0)) / half
        curved |= (bend > BEND_LIMIT_RAD) & (bend > SIGNIFICANCE * bend_std)
    return curved
