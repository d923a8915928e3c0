"""Loops over points and grid cells of the layered normal distributions transform, compiled."""

import math

import numba as nb
import numpy as np

from algorithms.arrays import Array

LEAST_POINTS = 5
"""Cells with fewer points have no distribution."""


@nb.njit(cache=True, nogil=True)
def cell_distributions(
    points: Array,
    layers: Array,
    low: Array,
    cell: float,
    least_std: float,
    means: Array,
    precisions: Array,
    found: Array,
) -> None:
    """Give every cell of four grids, shifted by half a cell each, mean and inverse covariance of its points.

    Parameters
    ----------
    points, layers
        (n, 2) [m] and (n,) which layer each belongs to.
    low, cell
        (2,) lower corner of the first grid and edge of the cells [m].
    least_std
        Smaller standard deviations are enlarged to this [m].
    means, precisions, found
        (4, layers, rows, columns, 2), (.., 3) as xx, xy, yy, and (..) True where there are enough points.
    """
    rows, columns = found.shape[2], found.shape[3]
    sums = np.zeros((4, found.shape[1], rows, columns, 6))
    for n in range(len(points)):
        for grid in range(4):
            x, y = _column(points[n, 0], low[0], cell, grid & 1), _column(points[n, 1], low[1], cell, grid >> 1)
            if 0 <= x < columns and 0 <= y < rows:
                at = sums[grid, layers[n], y, x]
                # about the cell's corner: far coordinates lose no digits
                u, v = points[n, 0] - low[0] - x * cell, points[n, 1] - low[1] - y * cell
                at[0] += 1.0
                at[1] += u
                at[2] += v
                at[3] += u * u
                at[4] += u * v
                at[5] += v * v
    floor = least_std * least_std
    for grid in range(4):
        for layer in range(found.shape[1]):
            for y in range(rows):
                for x in range(columns):
                    at = sums[grid, layer, y, x]
                    found[grid, layer, y, x] = at[0] >= LEAST_POINTS
                    if at[0] < LEAST_POINTS:
                        continue
                    u, v = at[1] / at[0], at[2] / at[0]
                    means[grid, layer, y, x, 0] = u + low[0] + x * cell
                    means[grid, layer, y, x, 1] = v + low[1] + y * cell
                    xx, xy, yy = at[3] / at[0] - u * u, at[4] / at[0] - u * v, at[5] / at[0] - v * v
                    # eigenvalues from below, so that walls, which are lines, keep a width
                    half, gap = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
                    big, small = max(half + gap, floor), max(half - gap, floor)
                    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
                    c, s = math.cos(angle), math.sin(angle)
                    precisions[grid, layer, y, x, 0] = c * c / big + s * s / small
                    precisions[grid, layer, y, x, 1] = c * s * (1.0 / big - 1.0 / small)
                    precisions[grid, layer, y, x, 2] = s * s / big + c * c / small


@nb.njit(cache=True, nogil=True)
def score(
    pose: Array, points: Array, layers: Array, low: Array, cell: float, means: Array, precisions: Array, found: Array,
    derivatives: Array,
) -> float:  # fmt: skip
    """Score a pose, with gradient, Hessian and the sum of the points' squared gradients.

    The score is the sum over points and grids of exp(-q'Aq/2), q = R x + t - mean, a quarter each (Biber and Strasser
    2003, eqs. 3 to 9; the sign is such that more is better).

    Parameters
    ----------
    pose
        (3,) translation [m] and heading [rad].
    points, layers
        (n, 2) source points [m], (n,) their layers.
    low, cell, means, precisions, found
        Of the target, as of `cell_distributions`.
    derivatives
        (7, 3) is given the gradient, the Hessian (rows 1 to 3), and the sum of outer products of the points' gradients.
    """
    derivatives[:] = 0.0
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    rows, columns = found.shape[2], found.shape[3]
    total = 0.0
    own = np.empty(3)
    for n in range(len(points)):
        px, py = points[n, 0], points[n, 1]
        rx, ry = cosine * px - sine * py, sine * px + cosine * py
        mx, my = rx + pose[0], ry + pose[1]
        own[:] = 0.0
        for grid in range(4):
            x, y = _column(mx, low[0], cell, grid & 1), _column(my, low[1], cell, grid >> 1)
            if not (0 <= x < columns and 0 <= y < rows) or not found[grid, layers[n], y, x]:
                continue
            a = precisions[grid, layers[n], y, x]
            qx, qy = mx - means[grid, layers[n], y, x, 0], my - means[grid, layers[n], y, x, 1]
            bx, by = a[0] * qx + a[1] * qy, a[1] * qx + a[2] * qy
            exponent = 0.5 * (qx * bx + qy * by)
            if exponent > 25.0:
                continue
            e = 0.25 * math.exp(-exponent)
            total += e
            # derivatives of q: (1, 0), (0, 1), (-ry, rx); second by heading twice: (-rx, -ry)
            bt = -bx * ry + by * rx
            ax, ay = -a[0] * ry + a[1] * rx, -a[1] * ry + a[2] * rx
            own[0] -= e * bx
            own[1] -= e * by
            own[2] -= e * bt
            derivatives[1, 0] += e * (bx * bx - a[0])
            derivatives[1, 1] += e * (bx * by - a[1])
            derivatives[1, 2] += e * (bx * bt - ax)
            derivatives[2, 1] += e * (by * by - a[2])
            derivatives[2, 2] += e * (by * bt - ay)
            derivatives[3, 2] += e * (bt * bt - (-ry * ax + rx * ay) + bx * rx + by * ry)
        for i in range(3):
            derivatives[0, i] += own[i]
            for j in range(3):
                derivatives[4 + i, j] += own[i] * own[j]
    derivatives[2, 0] = derivatives[1, 1]
    derivatives[3, 0] = derivatives[1, 2]
    derivatives[3, 1] = derivatives[2, 2]
    return total


@nb.njit(cache=True, nogil=True, inline="always")
def _column(value: float, low: float, cell: float, shifted: int) -> int:
    return math.floor((value - low) / cell + 0.5 * shifted)
