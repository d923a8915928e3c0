"""Compiled walk along lines through the edge pixels of a binary image."""

import math

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def follow_lines(  # noqa: C901, PLR0912 - one compiled loop
    edges: Array,
    gx: Array,
    gy: Array,
    angles: Array,
    distances: Array,
    gap: int,
    least: float,
    across: int,
    alike: float,
) -> Array:
    """Walk along x cos φ + y sin φ = r pixel by pixel and give the pieces covered by edge pixels, (n, 4).

    Edge pixels count whose gradient makes an angle of cosine `alike` or more with the normal, in either sense. A piece
    of which more than half the pixels belong to pieces of earlier lines is the same edge once more and left out.
    """
    height, width = edges.shape
    out = np.empty((64, 4))
    found = 0
    owned = np.zeros((height, width), dtype=np.bool_)
    path = np.empty((width + height, 2), dtype=np.int64)
    for k in range(len(angles)):
        c, s, r = math.cos(angles[k]), math.sin(angles[k]), distances[k]
        # one step a column for flat lines, one a row for steep ones: every pixel is met once
        flat = abs(s) >= abs(c)
        steps = width if flat else height
        first, last, missed, hits, known = -1, -1, 0, 0, 0
        for step in range(steps + 1):
            hit = False
            if step < steps:
                other = (r - step * c) / s if flat else (r - step * s) / c
                nearest = math.floor(other + 0.5)
                for beside in range(-across, across + 1):
                    place = nearest + beside
                    i, j = (place, step) if flat else (step, place)
                    if hit or not (0 <= i < height and 0 <= j < width and edges[i, j]):
                        continue
                    x, y = gx[i, j], gy[i, j]
                    hit = abs(x * c + y * s) >= alike * math.sqrt(x * x + y * y)
                    if hit:
                        path[hits, 0], path[hits, 1] = i, j
                        hits += 1
                        known += owned[i, j]
            if hit:
                if first < 0:
                    first = step
                last, missed = step, 0
                continue
            missed += 1
            if first >= 0 and (missed > gap or step == steps):
                length = (last - first) / (abs(s) if flat else abs(c))
                if length >= least and 2 * known <= hits:
                    for h in range(hits):
                        i, j = path[h, 0], path[h, 1]
                        for a in range(max(0, i - 1), min(height, i + 2)):
                            for b in range(max(0, j - 1), min(width, j + 2)):
                                owned[a, b] = True
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
                first, hits, known = -1, 0, 0
    return out[:found].copy()
