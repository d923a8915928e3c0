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
def _block_fit(
    points: Array, index: Array, sensor: Array, own: Array, block: Array, i: int, j: int, closed: bool, out: Array
) -> bool:
    """Lay a plane through the points of a block, and see where it meets the beam of the pixel.

    Inverse depths along the beam are linear in the directions for points of a plane, so the plane follows from a
    linear fit of three unknowns. Writes (predicted range, its standard deviation for points of standard deviation 1,
    standard deviation of the block's points along the beam); False where points are missing or the block is no surface.
    """
    rows, columns = index.shape
    r = math.sqrt(own[0] * own[0] + own[1] * own[1] + own[2] * own[2])
    dx, dy, dz = own[0] / r, own[1] / r, own[2] / r
    # any two axes across the beam
    if abs(dz) < 0.9:
        norm = math.sqrt(dx * dx + dy * dy)
        ax, ay, az = -dy / norm, dx / norm, 0.0
    else:
        norm = math.sqrt(dy * dy + dz * dz)
        ax, ay, az = 0.0, -dz / norm, dy / norm
    bx, by, bz = dy * az - dz * ay, dz * ax - dx * az, dx * ay - dy * ax
    count = block.shape[0]
    s, t, w = np.empty(count), np.empty(count), np.empty(count)
    ms, mt, mw = 0.0, 0.0, 0.0
    for k in range(count):
        row, column = i + block[k, 0], j + block[k, 1]
        if closed:
            column %= columns
        if row < 0 or row >= rows or column < 0 or column >= columns:
            return False
        p = index[row, column]
        if p < 0:
            return False
        x, y, z = points[p, 0] - sensor[0], points[p, 1] - sensor[1], points[p, 2] - sensor[2]
        depth = x * dx + y * dy + z * dz
        if depth <= 0.0:
            return False
        s[k] = (x * ax + y * ay + z * az) / depth
        t[k] = (x * bx + y * by + z * bz) / depth
        w[k] = 1.0 / depth
        ms += s[k]
        mt += t[k]
        mw += w[k]
    ms /= count
    mt /= count
    mw /= count
    ss, st, tt, sw, tw = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(count):
        cs, ct, cw = s[k] - ms, t[k] - mt, w[k] - mw
        ss += cs * cs
        st += cs * ct
        tt += ct * ct
        sw += cs * cw
        tw += ct * cw
    det = ss * tt - st * st
    if det <= 1e-6 * (ss + tt) * (ss + tt):
        return False
    gs, gt = (tt * sw - st * tw) / det, (ss * tw - st * sw) / det
    squares = 0.0
    for k in range(count):
        residual = w[k] - mw - gs * (s[k] - ms) - gt * (t[k] - mt)
        squares += (residual / (w[k] * w[k])) ** 2
    predicted = mw - gs * ms - gt * mt
    if predicted <= 0.0:
        return False
    leverage = 1.0 / count + (tt * ms * ms - 2.0 * st * ms * mt + ss * mt * mt) / det
    out[0] = 1.0 / predicted
    # the points of the block lie at other ranges than the pixel
    out[1] = math.sqrt(leverage) * (mw / predicted) ** 2
    out[2] = math.sqrt(squares / (count - 3))
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
    rows, columns = index.shape
    fit = np.empty(3)
    own = np.empty(3)
    for i in range(first_row, end_row):
        for j in range(columns):
            out[i, j] = False
            p = index[i, j]
            if p < 0:
                continue
            r = ranges[i, j]
            limit = times * noise_m / (r * r)
            if not (_bent(ranges, i, j, 1, closed, limit) or _bent(ranges, i, j, 2, closed, limit)):
                continue
            for axis in range(3):
                own[axis] = points[p, axis] - sensor[axis]
            surfaces = 0
            explained = False
            for b in range(blocks.shape[0]):
                if not _block_fit(points, index, sensor, own, blocks[b], i, j, closed, fit):
                    continue
                if fit[2] > rough * noise_m:
                    continue
                surfaces += 1
                if abs(fit[0] - r) <= times * noise_m * math.sqrt(1.0 + fit[1] * fit[1]):
                    explained = explained or b < beside
            out[i, j] = surfaces > 0 and explained == 0
