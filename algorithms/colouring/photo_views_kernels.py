"""Compiled loops of the depth test and of sampling photos."""

import math

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def shown_points(
    points: Array,
    normals: Array,
    pixels: Array,
    cell_px: float,
    width: int,
    height: int,
    margin: float,
    relative: float,
    out: Array,
) -> None:
    """Write which points (camera frame) nothing hides, by a buffer of the nearest point of every cell of pixels."""
    rows, columns = int(height / cell_px) + 1, int(width / cell_px) + 1
    nearest = np.full((rows, columns), -1, dtype=np.int64)
    for k in range(points.shape[0]):
        i, j = int((pixels[k, 1] + 0.5) / cell_px), int((pixels[k, 0] + 0.5) / cell_px)
        if nearest[i, j] < 0 or points[k, 2] < points[nearest[i, j], 2]:
            nearest[i, j] = k
    for k in range(points.shape[0]):
        i, j = int((pixels[k, 1] + 0.5) / cell_px), int((pixels[k, 0] + 0.5) / cell_px)
        own = points[k]
        limit = margin + relative * own[2]
        has_normal = normals[k, 0] != 0.0 or normals[k, 1] != 0.0 or normals[k, 2] != 0.0
        out[k] = True
        for a in range(max(0, i - 1), min(rows, i + 2)):
            for b in range(max(0, j - 1), min(columns, j + 2)):
                q = nearest[a, b]
                if q < 0 or own[2] - points[q, 2] <= limit:
                    continue
                off = 0.0
                for axis in range(3):
                    off += normals[k, axis] * (points[q, axis] - own[axis])
                if not has_normal or abs(off) > limit:
                    out[k] = False


@njit(cache=True, nogil=True)
def interpolate(image: Array, pixels: Array, out: Array) -> None:
    """Interpolate an image (h, w, 3) at pixels (m, 2) into (m, 3); beyond the rim the rim goes on."""
    height, width = image.shape[0], image.shape[1]
    for k in range(pixels.shape[0]):
        x = min(max(pixels[k, 0], 0.0), width - 1.0)
        y = min(max(pixels[k, 1], 0.0), height - 1.0)
        j, i = min(math.floor(x), max(width - 2, 0)), min(math.floor(y), max(height - 2, 0))
        u, v = x - j, y - i
        right, below = min(j + 1, width - 1), min(i + 1, height - 1)
        for c in range(3):
            upper = (1.0 - u) * image[i, j, c] + u * image[i, right, c]
            lower = (1.0 - u) * image[below, j, c] + u * image[below, right, c]
            out[k, c] = (1.0 - v) * upper + v * lower
