"""Compiled walk along lines through the edge pixels of a binary image."""

import math

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def follow_lines(edges: Array, angles: Array, distances: Array, gap: int, least: float, across: int) -> Array:
    """Walk along x cos φ + y sin φ = r pixel by pixel and give the pieces covered by edge pixels, (n, 4)."""
    height, width = edges.shape
    out = np.empty((64, 4))
    found = 0
    for k in range(len(angles)):
        c, s, r = math.cos(angles[k]), math.sin(angles[k]), distances[k]
        # one step a column for flat lines, one a row for steep ones: every pixel is met once
        flat = abs(s) >= abs(c)
        steps = width if flat else height
        first, last, missed = -1, -1, 0
        for step in range(steps + 1):
            hit = False
            if step < steps:
                other = (r - step * c) / s if flat else (r - step * s) / c
                nearest = int(math.floor(other + 0.5))
                for beside in range(-across, across + 1):
                    place = nearest + beside
                    if flat:
                        hit = hit or (0 <= place < height and edges[place, step])
                    else:
                        hit = hit or (0 <= place < width and edges[step, place])
            if hit:
                if first < 0:
                    first = step
                last, missed = step, 0
                continue
            missed += 1
            if first >= 0 and (missed > gap or step == steps):
                length = (last - first) / (abs(s) if flat else abs(c))
                if length >= least:
                    if found == len(out):
                        larger = np.empty((2 * found, 4))
                        larger[:found] = out
                        out = larger
                    if flat:
                        out[found, 0], out[found, 1] = first, (r - first * c) / s
                        out[found, 2], out[found, 3] = last, (r - last * c) / s
                    else:
                        out[found, 0], out[found, 1] = (r - first * s) / c, first
                        out[found, 2], out[found, 3] = (r - last * s) / c, last
                    found += 1
                first = -1
    return out[:found].copy()
