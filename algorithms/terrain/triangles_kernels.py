"""Compiled loops over points and the triangles that they lie in."""

import math

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def seen_from_triangles(points: Array, vertices: Array, triangles: Array, inside: Array) -> tuple[Array, Array, Array]:
    """Give distance, largest angle and height of points over their triangles, each (n,); infinity and 0 where none is.

    Parameters
    ----------
    points
        (n, 3) [m].
    vertices, triangles
        (m, 3) [m], and (t, 3) their numbers.
    inside
        (n,) triangle of each point, -1 for none.

    Returns
    -------
    Distance from the plane (positive above) [m], largest angle between the plane and the lines to the corners [rad],
    height of the triangle at the point [m].
    """
    n = len(points)
    distances = np.full(n, np.inf)
    angles = np.zeros(n)
    heights = np.full(n, np.nan)
    for i in range(n):
        t = inside[i]
        if t < 0:
            continue
        a = triangles[t, 0]
        b = triangles[t, 1]
        c = triangles[t, 2]
        ux = vertices[b, 0] - vertices[a, 0]
        uy = vertices[b, 1] - vertices[a, 1]
        uz = vertices[b, 2] - vertices[a, 2]
        vx = vertices[c, 0] - vertices[a, 0]
        vy = vertices[c, 1] - vertices[a, 1]
        vz = vertices[c, 2] - vertices[a, 2]
        nx = uy * vz - uz * vy
        ny = uz * vx - ux * vz
        nz = ux * vy - uy * vx
        size = math.sqrt(nx * nx + ny * ny + nz * nz)
        if nz == 0.0 or size == 0.0:
            continue
        if nz < 0.0:
            size = -size
        nx /= size
        ny /= size
        nz /= size
        dx = points[i, 0] - vertices[a, 0]
        dy = points[i, 1] - vertices[a, 1]
        dz = points[i, 2] - vertices[a, 2]
        distance = nx * dx + ny * dy + nz * dz
        distances[i] = distance
        heights[i] = points[i, 2] - distance / nz
        largest = 0.0
        for k in range(3):
            v = triangles[t, k]
            length = math.sqrt(
                (points[i, 0] - vertices[v, 0]) ** 2
                + (points[i, 1] - vertices[v, 1]) ** 2
                + (points[i, 2] - vertices[v, 2]) ** 2
            )
            if length > 0.0:
                largest = max(largest, math.asin(min(1.0, abs(distance) / length)))
        angles[i] = largest
    return distances, angles, heights


@njit(cache=True, nogil=True)
def least_in_triangles(inside: Array, measures: Array, accepted: Array, count: int) -> Array:
    """Give the number of the accepted point with the least measure in each of `count` triangles, -1 for none."""
    out = np.full(count, -1, np.int64)
    for i in range(len(inside)):
        t = inside[i]
        if t >= 0 and accepted[i] and (out[t] < 0 or measures[i] < measures[out[t]]):
            out[t] = i
    return out


@njit(cache=True, nogil=True)
def walk_to_triangles(points: Array, vertices: Array, triangles: Array, neighbours: Array, start: Array) -> Array:
    """Find the triangle of each point (n,) by walking over edges from `start` (n,), -1 for none.

    Corners may go round in either direction. A walk that crosses an edge of the border ends there.
    """
    n = len(points)
    out = np.full(n, -1, np.int64)
    last = 0
    for i in range(n):
        t = start[i] if start[i] >= 0 else last
        x = points[i, 0]
        y = points[i, 1]
        for turn in range(len(triangles) + 1):
            worst = -1e-9
            side = -1
            for k in range(3):
                a = triangles[t, (k + 1 + turn) % 3]
                b = triangles[t, (k + 2 + turn) % 3]
                c = triangles[t, (k + turn) % 3]
                ex = vertices[b, 0] - vertices[a, 0]
                ey = vertices[b, 1] - vertices[a, 1]
                own = ex * (vertices[c, 1] - vertices[a, 1]) - ey * (vertices[c, 0] - vertices[a, 0])
                place = ex * (y - vertices[a, 1]) - ey * (x - vertices[a, 0])
                share = place / own if own != 0.0 else 0.0
                if share < worst:
                    worst = share
                    side = (k + turn) % 3
            if side < 0:
                out[i] = t
                last = t
                break
            t = neighbours[t, side]
            if t < 0:
                break
    return out
