"""Compiled loops of Schneider's segment detection."""

import math

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def half_circle_pieces(edges: Array, half_circle: Array) -> Array:  # noqa: C901 - one compiled loop
    """Reach from every edge pixel to the edge pixels on the half circle around it, (n, 4) int32 with x, y twice.

    `half_circle` holds the steps (x, y) to its pixels. A piece counts where the pixels between both ends are edge
    pixels too, to one pixel beside.
    """
    height, width = edges.shape
    out = np.empty((1024, 4), dtype=np.int32)
    found = 0
    for i in range(height):
        for j in range(width):
            if not edges[i, j]:
                continue
            for k in range(len(half_circle)):
                a, b = i + half_circle[k, 1], j + half_circle[k, 0]
                if a >= height or b < 0 or b >= width or not edges[a, b]:
                    continue
                steps = max(abs(a - i), abs(b - j))
                joined = True
                for s in range(1, steps):
                    y, x = i + (a - i) * s / steps, j + (b - j) * s / steps
                    near = False
                    for da in range(-1, 2):
                        yy, xx = round(y) + da, round(x)
                        near = near or (0 <= yy < height and edges[yy, xx])
                        yy, xx = round(y), round(x) + da
                        near = near or (0 <= xx < width and edges[yy, xx])
                    if not near:
                        joined = False
                        break
                if not joined:
                    continue
                if found == len(out):
                    larger = np.empty((2 * found, 4), dtype=np.int32)
                    larger[:found] = out
                    out = larger
                out[found, 0], out[found, 1], out[found, 2], out[found, 3] = j, i, b, a
                found += 1
    return out[:found].copy()


@njit(cache=True, nogil=True)
def grow_pieces(  # noqa: C901 - one compiled loop
    pieces: Array,
    shape: tuple[int, int],
    starts: Array,
    order: Array,
    tolerance_rad: float,
    across: float,
    least: float,
) -> Array:
    """Chain pieces: the end of one is the start of the next, and all agree in direction, (n, 4) float64 with x, y.

    `order` sorts the pieces by the pixel (row times columns plus column) they start at and `starts` holds these pixels
    in that order. A segment takes the continuation that turns it least, as long as that turns it by less than
    `tolerance_rad` and leads no further than `across` from its line. Segments of at least `least` are kept; no other
    starts on them, or runs along them for the most part.
    """
    height, width = shape
    used = np.zeros(len(pieces), dtype=np.bool_)
    owned = np.zeros((height, width), dtype=np.bool_)
    out = np.empty((len(pieces), 4))
    found = 0
    for p in range(len(pieces)):
        if used[p] or owned[pieces[p, 1], pieces[p, 0]]:
            continue
        used[p] = True
        x0, y0, x1, y1 = pieces[p, 0], pieces[p, 1], pieces[p, 2], pieces[p, 3]
        while True:
            direction = math.atan2(y1 - y0, x1 - x0)
            pixel = y1 * width + x1
            first = np.searchsorted(starts, pixel)
            best, best_turn = -1, tolerance_rad
            k = first
            while k < len(starts) and starts[k] == pixel:
                q = order[k]
                turn = abs(math.atan2(pieces[q, 3] - pieces[q, 1], pieces[q, 2] - pieces[q, 0]) - direction)
                turn = min(turn, 2.0 * math.pi - turn)
                off = abs((pieces[q, 3] - y0) * math.cos(direction) - (pieces[q, 2] - x0) * math.sin(direction))
                if turn < best_turn and off <= across:
                    best, best_turn = q, turn
                k += 1
            if best < 0:
                break
            used[best] = True
            x1, y1 = pieces[best, 2], pieces[best, 3]
        if (x1 - x0) ** 2 + (y1 - y0) ** 2 < least * least:
            continue
        steps = max(abs(x1 - x0), abs(y1 - y0))
        known = 0
        for k in range(steps + 1):
            known += owned[round(y0 + (y1 - y0) * k / steps), round(x0 + (x1 - x0) * k / steps)]
        if 2 * known > steps:
            continue
        for k in range(steps + 1):
            i, j = round(y0 + (y1 - y0) * k / steps), round(x0 + (x1 - x0) * k / steps)
            owned[max(0, i - 1) : i + 2, max(0, j - 1) : j + 2] = True
        out[found, 0], out[found, 1], out[found, 2], out[found, 3] = x0, y0, x1, y1
        found += 1
    return out[:found]
