"""Compiled loop of plane intersections: where along a line two bounded planes are both near."""

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def _clip(u: float, v: float, du: float, dv: float, wide: float, high: float) -> tuple[float, float]:
    """Give the parameter interval of a 2-D line inside the rectangle [0, wide] x [0, high]; low > high if none."""
    low = -np.inf
    up = np.inf
    for at, step, size in ((u, du, wide), (v, dv, high)):
        if abs(step) < 1e-12:
            if at < 0.0 or at > size:
                return 1.0, 0.0
        else:
            a = -at / step
            b = (size - at) / step
            low = max(low, min(a, b))
            up = min(up, max(a, b))
    return low, up


@njit(cache=True, nogil=True)
def common_support(  # noqa: C901, PLR0912, PLR0915 - one compiled loop
    pairs: Array,
    points: Array,
    directions: Array,
    centroids: Array,
    bases: Array,
    rasters: Array,
    starts: Array,
    rows: Array,
    columns: Array,
    origins: Array,
    cell_sizes: Array,
    min_lengths: Array,
) -> Array:
    """Walk along each intersection line and find where both planes' (dilated) rasters are occupied.

    Returns (n, 4): start and end of the supported part along the direction from the given point, supported length, and
    mean position of the support [m]; runs shorter than half of `min_lengths` are left out. All zero if there is none.
    """
    n = pairs.shape[0]
    out = np.zeros((n, 4))
    at = np.empty((2, 2))
    step = np.empty((2, 2))
    for k in range(n):
        low = -np.inf
        up = np.inf
        for side in range(2):
            p = pairs[k, side]
            for axis in range(2):
                position = 0.0
                slope = 0.0
                for a in range(3):
                    position += (points[k, a] - centroids[p, a]) * bases[p, a, axis]
                    slope += directions[k, a] * bases[p, a, axis]
                at[side, axis] = (position - origins[p, axis]) / cell_sizes[p]
                step[side, axis] = slope / cell_sizes[p]
            enter, leave = _clip(at[side, 0], at[side, 1], step[side, 0], step[side, 1], columns[p], rows[p])
            low = max(low, enter)
            up = min(up, leave)
        if not up - low >= min_lengths[k]:
            continue
        stride = 0.5 * min(cell_sizes[pairs[k, 0]], cell_sizes[pairs[k, 1]])
        steps = int((up - low) / stride)
        shortest = 0.5 * min_lengths[k]
        run = -1
        first = np.inf
        last = -np.inf
        length = 0.0
        moment = 0.0
        for i in range(steps + 2):
            s = low + (i + 0.5) * stride
            inside = i <= steps and s < up
            for side in range(2):
                if not inside:
                    break
                p = pairs[k, side]
                column = int(at[side, 0] + s * step[side, 0])
                row = int(at[side, 1] + s * step[side, 1])
                inside = (
                    0 <= column < columns[p]
                    and 0 <= row < rows[p]
                    and rasters[starts[p] + row * columns[p] + column] > 0
                )
            if inside:
                if run < 0:
                    run = i
            elif run >= 0:
                if (i - run) * stride >= shortest:
                    begin = low + run * stride
                    end = low + i * stride
                    first = min(first, begin)
                    last = max(last, end)
                    length += end - begin
                    moment += 0.5 * (end * end - begin * begin)
                run = -1
        if length > 0:
            out[k, 0] = first
            out[k, 1] = last
            out[k, 2] = length
            out[k, 3] = moment / length
    return out
