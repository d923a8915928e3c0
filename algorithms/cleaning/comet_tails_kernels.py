"""Compiled loops that ask of every pixel off the run of its neighbours whether a surface beside it goes on there."""

import math

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def _inverse(ranges: Array, i: int, j: int, closed: bool) -> float:
    """Give the inverse range of a pixel, 0 where there is none."""
    rows, columns = ranges.shape
    if closed:
        j %= columns
    if i < 0 or i >= rows or j < 0 or j >= columns or ranges[i, j] <= 0.0:
        return 0.0
    return 1.0 / np.float64(ranges[i, j])


@njit(cache=True, nogil=True)
def _bent(ranges: Array, i: int, j: int, step: int, closed: bool, limit: float) -> bool:
    """Tell whether a pixel lies off the lines through its neighbours in its row and column, or misses one."""
    own = 2.0 / np.float64(ranges[i, j])
    for along_row in (False, True):
        a = _inverse(ranges, i if along_row else i - step, j - step if along_row else j, closed)
        b = _inverse(ranges, i if along_row else i + step, j + step if along_row else j, closed)
        if a == 0.0 or b == 0.0 or abs(a + b - own) > limit:
            return True
    return False


@njit(cache=True, nogil=True)
def _axes_across(direction: Array, out: Array) -> None:
    """Write two axes across a unit direction into (2, 3)."""
    dx, dy, dz = direction
    if abs(dz) < 0.9:
        norm = math.sqrt(dx * dx + dy * dy)
        ax, ay, az = -dy / norm, dx / norm, 0.0
    else:
        norm = math.sqrt(dy * dy + dz * dz)
        ax, ay, az = 0.0, -dz / norm, dy / norm
    out[0, 0], out[0, 1], out[0, 2] = ax, ay, az
    out[1, 0], out[1, 1], out[1, 2] = dy * az - dz * ay, dz * ax - dx * az, dx * ay - dy * ax


@njit(cache=True, nogil=True)
def _seen_along(
    points: Array, index: Array, sensor: Array, axes: Array, block: Array, i: int, j: int, closed: bool, out: Array
) -> bool:
    """Write direction (2) and inverse depth along the beam of the pixel of a block's points; False where one misses."""
    rows, columns = index.shape
    for k in range(block.shape[0]):
        row, column = i + block[k, 0], j + block[k, 1]
        if closed:
            column %= columns
        if row < 0 or row >= rows or column < 0 or column >= columns or index[row, column] < 0:
            return False
        ray = points[index[row, column]] - sensor
        depth = ray[0] * axes[2, 0] + ray[1] * axes[2, 1] + ray[2] * axes[2, 2]
        if depth <= 0.0:
            return False
        for axis in range(2):
            out[axis, k] = (ray[0] * axes[axis, 0] + ray[1] * axes[axis, 1] + ray[2] * axes[axis, 2]) / depth
        out[2, k] = 1.0 / depth
    return True


@njit(cache=True, nogil=True)
def _plane_fit(seen: Array, out: Array) -> bool:
    """Lay a plane through the points of a block, and see where it meets the beam of the pixel.

    Inverse depths along the beam are linear in the directions for points of a plane, so the plane follows from a
    linear fit of three unknowns. Writes (predicted range, its standard deviation for points of standard deviation 1,
    standard deviation of the block's points along the beam); False where the points do not tell a plane.
    """
    count = seen.shape[1]
    ms, mt, mw = seen[0].mean(), seen[1].mean(), seen[2].mean()
    s, t, w = seen[0] - ms, seen[1] - mt, seen[2] - mw
    ss, st, tt = (s * s).sum(), (s * t).sum(), (t * t).sum()
    sw, tw = (s * w).sum(), (t * w).sum()
    det = ss * tt - st * st
    if det <= 1e-6 * (ss + tt) * (ss + tt):
        return False
    gs, gt = (tt * sw - st * tw) / det, (ss * tw - st * sw) / det
    predicted = mw - gs * ms - gt * mt
    if predicted <= 0.0:
        return False
    residuals = (w - gs * s - gt * t) / (seen[2] * seen[2])
    leverage = 1.0 / count + (tt * ms * ms - 2.0 * st * ms * mt + ss * mt * mt) / det
    out[0] = 1.0 / predicted
    # the points of the block lie at other ranges than the pixel
    out[1] = math.sqrt(leverage) * (mw / predicted) ** 2
    out[2] = math.sqrt((residuals * residuals).sum() / (count - 3))
    return True


@njit(cache=True, nogil=True)
def hanging_pixels(
    points: Array,
    index: Array,
    ranges: Array,
    sensor: Array,
    blocks: Array,
    noise_m: float,
    times: float,
    rough: float,
    beside: int,
    closed: bool,
    first_row: int,
    end_row: int,
    out: Array,
) -> None:
    """Mark the pixels of some rows that none of the first blocks explains although some block is a surface."""
    fit, seen, axes = np.empty(3), np.empty((3, blocks.shape[1])), np.empty((3, 3))
    for i in range(first_row, end_row):
        for j in range(index.shape[1]):
            out[i, j] = False
            if index[i, j] < 0:
                continue
            r = ranges[i, j]
            limit = times * noise_m / (r * r)
            if not (_bent(ranges, i, j, 1, closed, limit) or _bent(ranges, i, j, 2, closed, limit)):
                continue
            axes[2] = (points[index[i, j]] - sensor) / r
            _axes_across(axes[2], axes[:2])
            surfaces = 0
            explained = False
            for b in range(blocks.shape[0]):
                if not _seen_along(points, index, sensor, axes, blocks[b], i, j, closed, seen):
                    continue
                if not _plane_fit(seen, fit) or fit[2] > rough * noise_m:
                    continue
                surfaces += 1
                if b < beside and abs(fit[0] - r) <= times * noise_m * math.sqrt(1.0 + fit[1] * fit[1]):
                    explained = True
                    break
            out[i, j] = surfaces > 0 and not explained
