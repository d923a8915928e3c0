"""Tell flat regions from strips of something round."""

import numpy as np
from jaxtyping import Bool, Float64

from algorithms.arrays import Array, Labels, Scalars, Vectors2
from algorithms.features.planes import plane_curvature_kernels as kernels

BEND_LIMIT_RAD = float(np.deg2rad(5.0))
"""A region whose tangents turn by more from end to end is curved."""
SIGNIFICANCE = 4.0
"""Least ratio of a bend to its own standard deviation."""
LEAST_HALF_WIDTH_M = 1e-9
"""Keeps positions in half widths finite [m]."""


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
    half = np.maximum(half_widths, LEAST_HALF_WIDTH_M)
    return bent(kernels.sums_of_pieces(labels, positions, heights, weights, half), half)


def bent(sums: Float64[Array, "k 2 10"], half_widths: Float64[Array, "k 2"]) -> Bool[Array, "k"]:
    """Find regions of which the sums along either axis tell a bend."""
    curved = np.zeros(len(sums), dtype=np.bool_)
    for axis in (0, 1):
        powers, right = sums[:, axis, :5], sums[:, axis, 5:8]
        ridge = 1e-9 * np.maximum(powers[:, 0], 1e-9)[:, None, None] * np.eye(3)
        inverse = np.linalg.inv(np.stack([powers[:, k : k + 3] for k in range(3)], axis=1) + ridge)
        parabola = np.einsum("kij,kj->ki", inverse, right)
        left = np.maximum(sums[:, axis, 8] - np.einsum("ki,ki->k", parabola, right), 0.0)
        bend = 4.0 * np.abs(parabola[:, 2]) / half_widths[:, axis]
        variance = inverse[:, 2, 2] * left / np.maximum(sums[:, axis, 9] - 3.0, 1.0)
        bend_std = 4.0 * np.sqrt(variance) / half_widths[:, axis]
        curved |= (bend > BEND_LIMIT_RAD) & (bend > SIGNIFICANCE * bend_std)
    return curved
