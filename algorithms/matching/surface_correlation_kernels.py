"""Compiled loops that put surface and free space on a raster, and find the peaks of a correlation."""

import math
from typing import Any

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def mark_surface(
    points: Array, normals: Array, axes: Array, low: Array, cell_m: float, reach: int, out: Array
) -> Any:  # pragma: no cover - compiled
    """Mark the cells within `reach` cells of surface points, by the axis and the side that their normals face.

    `out` (6, nx, ny, nz) is for normals along the three axes, then against them.
    """
    _, nx, ny, nz = out.shape
    for p in range(points.shape[0]):
        best, facing = -1.0, 0
        for a in range(3):
            cosine = normals[p, 0] * axes[a, 0] + normals[p, 1] * axes[a, 1] + normals[p, 2] * axes[a, 2]
            if abs(cosine) > best:
                best = abs(cosine)
                facing = a if cosine > 0.0 else a + 3
        i = int((points[p, 0] - low[0]) / cell_m)
        j = int((points[p, 1] - low[1]) / cell_m)
        k = int((points[p, 2] - low[2]) / cell_m)
        for u in range(max(i - reach, 0), min(i + reach + 1, nx)):
            for v in range(max(j - reach, 0), min(j + reach + 1, ny)):
                for w in range(max(k - reach, 0), min(k + reach + 1, nz)):
                    out[facing, u, v, w] = 1.0


@njit(cache=True, nogil=True)
def mark_free(
    rotation: Array,
    low: Array,
    cell_m: float,
    nearest_m: Array,
    sensor: Array,
    cell_rad: float,
    margin_m: float,
    margin_relative: float,
    out: Array,
) -> Any:  # pragma: no cover - compiled
    """Mark the cells whose centres a scan looked through; `rotation` turns the scan into the raster's frame."""
    nx, ny, nz = out.shape
    rows, columns = nearest_m.shape
    for i in range(nx):
        x = low[0] + (i + 0.5) * cell_m
        for j in range(ny):
            y = low[1] + (j + 0.5) * cell_m
            for k in range(nz):
                z = low[2] + (k + 0.5) * cell_m
                a = rotation[0, 0] * x + rotation[1, 0] * y + rotation[2, 0] * z - sensor[0]
                b = rotation[0, 1] * x + rotation[1, 1] * y + rotation[2, 1] * z - sensor[1]
                c = rotation[0, 2] * x + rotation[1, 2] * y + rotation[2, 2] * z - sensor[2]
                distance = math.sqrt(a * a + b * b + c * c)
                if distance == 0.0:
                    continue
                row = min(int(math.acos(min(max(c / distance, -1.0), 1.0)) / cell_rad), rows - 1)
                column = min(int((math.atan2(b, a) + math.pi) / cell_rad), columns - 1)
                nearest = nearest_m[row, column]
                if nearest < np.inf and distance < nearest - margin_m - margin_relative * nearest:
                    out[i, j, k] = 1.0


@njit(cache=True, nogil=True)
def meet(
    along: Array, against: Array, theirs_along: Array, theirs_against: Array, share: np.float32, whole: Array
) -> Any:  # pragma: no cover - compiled
    """Multiply transforms (n,) of surface that faces along an axis and against it with those of the other scan.

    `theirs_along` becomes the transform of what meets, times a share; to `whole` the other scan's surface is added.
    """
    for k in range(whole.size):
        first, second = theirs_along[k], theirs_against[k]
        whole[k] += first + second
        theirs_along[k] = share * (along[k] * np.conj(first) + against[k] * np.conj(second))


@njit(cache=True, nogil=True)
def contradict(
    free: Array, surface: Array, their_free: Array, their_surface: Array, through: np.float32, hidden: np.float32
) -> Any:  # pragma: no cover - compiled
    """Make `their_free` the transform of what stands where the other instrument looked through, by two shares."""
    for k in range(free.size):
        seen_by_us = through * free[k] * np.conj(their_surface[k])
        their_free[k] = seen_by_us + hidden * surface[k] * np.conj(their_free[k])


@njit(cache=True, nogil=True, error_model="numpy")
def weigh(
    along: Array,
    across: Array,
    upwards: Array,
    violation: Array,
    floor: float,
    penalty: float,
    credit: float,
    least_score: float,
    out: Array,
) -> Any:  # pragma: no cover - compiled
    """Score every shift: geometric mean of three supports, less for what stands in free space; 0 where it is low.

    In single precision, as the transforms: roots and powers take a third of the time. Each
    support is credited with a share of their mean, lest one direction that hardly occurs rules all out.
    """
    nothing, third = np.float32(0.0), np.float32(1.0 / 3.0)
    credited, scale = np.float32(credit / 3.0), np.float32(1.0 / (1.0 + credit))
    lowest, least_total = np.float32((least_score * (1.0 + credit)) ** 3), np.float32(3.0 * least_score)
    allowed, price = np.float32(floor), np.float32(penalty)
    for k in range(out.size):
        first, second, last = max(along[k], nothing), max(across[k], nothing), max(upwards[k], nothing)
        total = first + second + last
        if total < least_total:  # the geometric mean is no larger than the arithmetic one
            out[k] = nothing
            continue
        more = credited * total
        product = (first + more) * (second + more) * (last + more)
        if product < lowest:
            out[k] = nothing
            continue
        support = scale * np.exp(third * np.log(product))
        against = max(violation[k], nothing)
        beyond = against / (support + against + np.float32(1e-6)) - allowed
        out[k] = support * np.exp(-price * beyond) if beyond > nothing else support


@njit(cache=True, nogil=True)
def _tied(score: Array, i: int, j: int, k: int, tolerance: float) -> int:
    """Count the neighbours of a cell, round the edges too, that score as much; -1 where one of the 26 scores more."""
    nx, ny, nz = score.shape
    own = score[i, j, k]
    tied = 0
    for step in range(27):
        u, v, w = step // 9 - 1, step // 3 % 3 - 1, step % 3 - 1
        other = score[(i + u) % nx, (j + v) % ny, (k + w) % nz]
        if other > own * (1.0 + tolerance):
            return -1
        tied += other >= own * (1.0 - tolerance)
    return tied - 1


@njit(cache=True, nogil=True)
def _middle(score: Array, i: int, j: int, k: int, tied: int, tolerance: float) -> tuple[float, float, float]:
    """Give the middle of a cell and the neighbours that score as much; nan where one of them stands for it.

    That is the one that has more such neighbours than this cell has, of equals the first.
    """
    nx, ny, nz = score.shape
    least = score[i, j, k] * (1.0 - tolerance)
    x = y = z = 0
    for step in range(27):
        u, v, w = step // 9 - 1, step // 3 % 3 - 1, step % 3 - 1
        ni, nj, nk = (i + u) % nx, (j + v) % ny, (k + w) % nz
        if step == 13 or score[ni, nj, nk] < least:
            continue
        others = _tied(score, ni, nj, nk, tolerance)
        if others > tied or (others == tied and step < 13):
            return np.nan, np.nan, np.nan
        x += u
        y += v
        z += w
    count = tied + 1
    return i + x / count, j + y / count, k + z / count


@njit(cache=True, nogil=True)
def peaks(score: Array, least: float, tolerance: float) -> tuple[Array, Array]:
    """Find the cells that score at least `least` and no less than their neighbours.

    Scores that differ by less than a share of `tolerance` are the same but for rounding; of cells side by side that
    score the same, the one amid most of them stands for all. Returns (p, 3) cells and (p, 3) the middles of what they
    stand for.
    """
    nx, ny, nz = score.shape
    cells: list[int] = []
    middles: list[float] = []
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                tied = _tied(score, i, j, k, tolerance) if score[i, j, k] >= least else -1
                if tied < 0:
                    continue
                middle = _middle(score, i, j, k, tied, tolerance)
                if not math.isnan(middle[0]):
                    cells.extend((i, j, k))
                    middles.extend(middle)
    count = len(cells) // 3
    return np.array(cells, dtype=np.int64).reshape(count, 3), np.array(middles, dtype=np.float64).reshape(count, 3)
