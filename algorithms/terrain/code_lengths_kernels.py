"""Compiled loops over triangles and the points above them: how many bits describe the points, with or without a split.

A point near the terrain is described by its distance, normally distributed; one above it by an even chance over the
heights of objects. No object lies below the terrain: what does is not told that way.
"""

import math

import numpy as np
from numba import njit

from algorithms.arrays import Array

MOST_APICES = 16
"""Points of a triangle that are tried as the apex of a tetrahedron, evenly over their heights above it."""
BELOW_BITS = 10.0
"""Added where a point lies below the terrain, and more than noise tells."""


@njit(cache=True, nogil=True)
def _bits(distance: float, std: float, object_height: float) -> float:
    """Describe a point at a distance above (below if negative) the terrain."""
    near = math.log2(std * math.sqrt(2.0 * math.pi)) + distance * distance / (2.0 * std * std * math.log(2.0))
    other = math.log2(object_height)
    if distance < 0.0:
        other += BELOW_BITS
    return min(near, other)


@njit(cache=True, nogil=True)
def _side(ax: float, ay: float, bx: float, by: float, x: float, y: float) -> float:
    """Give twice the area of a triangle in plan, positive if it goes round to the left."""
    return (bx - ax) * (y - ay) - (by - ay) * (x - ax)


@njit(cache=True, nogil=True)
def _above(a: Array, b: Array, c: Array, point: Array) -> float:
    """Give the distance of a point from the plane through three others, positive above [m]."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    size = math.sqrt(nx * nx + ny * ny + nz * nz)
    if size == 0.0 or nz == 0.0:
        return 0.0
    if nz < 0.0:
        size = -size
    return float((nx * (point[0] - a[0]) + ny * (point[1] - a[1]) + nz * (point[2] - a[2])) / size)


@njit(cache=True, nogil=True)
def _apex_bits(height: float, distance: float, members: int, std: float, slope: float) -> float:
    """Describe an apex: which of the members it is, and how far it bends the terrain, to the precision of `std`."""
    spread = max(slope * distance, std)
    bend = math.log2(spread * math.sqrt(2.0 * math.pi) / std) + (height / spread) ** 2 / (2.0 * math.log(2.0))
    return math.log2(members) + bend


@njit(cache=True, nogil=True)
def _above_facets(corners: Array, apex: Array, point: Array) -> float:
    """Give the distance of a point from that facet between an apex and two corners in which it lies in plan [m]."""
    facet = 0
    for k in range(3):
        a, b = corners[k], corners[(k + 1) % 3]
        whole = _side(a[0], a[1], b[0], b[1], apex[0], apex[1])
        first = _side(apex[0], apex[1], a[0], a[1], point[0], point[1])
        second = _side(b[0], b[1], apex[0], apex[1], point[0], point[1])
        if first * whole >= 0.0 and second * whole >= 0.0:
            facet = k
            break
    return _above(corners[facet], corners[(facet + 1) % 3], apex, point)


@njit(cache=True, nogil=True)
def _split_bits(
    points: Array, members: Array, corners: Array, apex: int, bits: float, most: float, std: float, height: float
) -> float:
    """Add to the bits of an apex those of the points over its facets, until they are `most`."""
    for i in members:
        if bits >= most:
            break
        gap = 0.0 if i == apex else _above_facets(corners, points[apex], points[i])
        bits += _bits(gap, std, height)
    return bits


@njit(cache=True, nogil=True)
def shortest_splits(
    points: Array,
    distances: Array,
    order: Array,
    starts: Array,
    vertices: Array,
    triangles: Array,
    std: float,
    slope: float,
    object_height: float,
) -> Array:
    """Give for each triangle the point whose tetrahedron over it shortens the description most, -1 for none.

    Parameters
    ----------
    points, distances
        (n, 3) [m], and (n,) above the triangles that they lie in [m].
    order, starts
        Their numbers, triangle after triangle and in each by ascending distance, and where each begins, (t + 1,).
    vertices, triangles
        (m, 3) [m], and (t, 3) their numbers.
    std, slope, object_height
        Standard deviation of ground points [m]; usual bend of the terrain, as height over distance; range of the
        heights of objects [m].
    """
    out = np.full(len(triangles), -1, np.int64)
    corners = np.empty((3, 3))
    for t in range(len(triangles)):
        members = order[starts[t] : starts[t + 1]]
        n = len(members)
        least = 0.0
        for i in members:
            least += _bits(distances[i], std, object_height)
        for k in range(3):
            corners[k] = vertices[triangles[t, k]]
        tried = min(n, MOST_APICES)
        for step in range(tried):
            apex = members[step * n // tried]
            nearest = math.inf
            for k in range(3):
                nearest = min(nearest, math.hypot(points[apex, 0] - corners[k, 0], points[apex, 1] - corners[k, 1]))
            own = _apex_bits(distances[apex], nearest, n, std, slope)
            total = _split_bits(points, members, corners, apex, own, least, std, object_height)
            if total < least:
                least = total
                out[t] = apex
    return out
