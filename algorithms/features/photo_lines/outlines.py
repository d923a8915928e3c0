"""Closed outlines that edges of photos draw on a plane of the scan: signs, joints, painted fields (seed 003, 6.6)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from algorithms.arrays import Array, Indices, Points, Vectors2
from algorithms.features.photo_lines.projection_options import SpaceEdgeKind
from algorithms.geometry.lines import Lines
from algorithms.geometry.planes import Planes

ON_PLANE_M = 0.01
"""Ends of an edge lie within this of a plane's surface, and three standard deviations of its points."""
SAME_NORMAL = float(np.cos(np.radians(5.0)))
LEAST_CORNER = float(np.sin(np.radians(15.0)))
"""Edges that meet at a flatter angle make no corner: their intersection runs away along them."""
GAP_SHARE, LEAST_GAP_M = 0.15, 0.02
"""An edge ends before its corner by no more than this share of its length, or this [m]."""
DRAWN = (SpaceEdgeKind.SURFACE_EDGE, SpaceEdgeKind.MATERIAL_EDGE)
"""Edges with one surface at both sides."""


@dataclass(frozen=True, eq=False)
class Outline:
    """A closed polygon on a plane."""

    plane: int
    """Number of the plane."""
    lines: tuple[int, ...]
    """Numbers of its edges in order; corner k is where edge k and the next one meet."""
    corners: Points
    """(k, 3) on the plane, in the frame of the lines [m]."""
    area_m2: float
    """Area [m²]."""


def outlines(lines: Lines, kinds: Indices, normals: Points, planes: Planes) -> list[Outline]:
    """Join edges on one plane to closed polygons.

    Every end of an edge goes with the nearest end of another one on the plane if each is the other's nearest and both
    edges reach the corner, where they intersect, but for a small gap; what closes is an outline. Cost O(n log n).

    Parameters
    ----------
    lines
        Lines of a scan, those of its photos among them.
    kinds
        (n,) `SpaceEdgeKind` values; -1 for lines that are of no photo.
    normals
        (n, 3) normals of the surfaces on which the edges of photos lie.
    planes
        Of the scan.
    """
    drawn = np.isin(kinds, [int(kind) for kind in DRAWN])
    starts, ends = lines.end_points
    found: list[Outline] = []
    for plane in range(len(planes)):
        normal, centroid = planes.normals[plane], planes.centroids[plane]
        reach = ON_PLANE_M + 3.0 * float(planes.noise_std_m[plane])
        on_it = drawn & (np.abs(normals @ normal) > SAME_NORMAL)
        on_it &= (np.abs((starts - centroid) @ normal) < reach) & (np.abs((ends - centroid) @ normal) < reach)
        numbers = np.flatnonzero(on_it)
        if len(numbers) < 3:
            continue
        basis = planes.bases[plane]
        flat = np.stack([(starts[numbers] - centroid) @ basis, (ends[numbers] - centroid) @ basis], axis=1)
        for edges, corners in _closed(flat):
            x, y = corners.T
            found.append(
                Outline(
                    plane=plane,
                    lines=tuple(int(numbers[edge]) for edge in edges),
                    corners=centroid + corners @ basis.T,
                    area_m2=0.5 * abs(float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))),
                )
            )
    return found


def _closed(flat: Array) -> list[tuple[Sequence[int], Vectors2]]:
    """Find the closed polygons among edges (n, 2 ends, 2); give the edges in order and the corners."""
    partners, corners = _partners(flat)
    found: list[tuple[Sequence[int], Vectors2]] = []
    done: set[int] = set()
    for first in range(len(flat)):
        edges: list[int] = []
        met: list[Array] = []
        end = 2 * first + 1
        while end // 2 not in done:
            edges.append(end // 2)
            done.add(end // 2)
            following = int(partners[end])
            if following < 0:
                break
            met.append(corners[end])
            # on to the other end of the edge that was met
            end = following ^ 1
            if end == 2 * first + 1 and len(edges) > 2:
                found.append((edges, np.array(met)))
    return found


def _partners(flat: Array) -> tuple[Indices, Vectors2]:
    """Give for every end (2 n,) the end it meets, -1 for none, and the corner between them (2 n, 2)."""
    ends = flat.reshape(-1, 2)
    _, nearest = cKDTree(ends).query(ends, k=min(len(ends), 3))
    edge = np.arange(len(ends)) // 2
    # the nearest end but for itself and the other end of the same edge
    others = np.where(nearest // 2 == edge[:, None], len(ends), nearest)
    choice = np.argmax(others < len(ends), axis=1)
    partner = others[np.arange(len(ends)), choice]
    directions = flat[:, 1] - flat[:, 0]
    lengths = np.linalg.norm(directions, axis=1)
    directions = directions / lengths[:, None]
    partners = np.full(len(ends), -1, dtype=np.int64)
    corners = np.zeros((len(ends), 2))
    for end in range(len(ends)):
        other = int(partner[end])
        if other >= len(ends) or int(partner[other]) != end or other < end:
            continue
        one, two = directions[edge[end]], directions[edge[other]]
        sine = float(one[0] * two[1] - one[1] * two[0])
        if abs(sine) < LEAST_CORNER:
            continue
        apart = ends[other] - ends[end]
        corner = ends[end] + one * float(apart[0] * two[1] - apart[1] * two[0]) / sine
        if all(
            np.linalg.norm(corner - ends[each]) <= max(LEAST_GAP_M, GAP_SHARE * lengths[edge[each]])
            for each in (end, other)
        ):
            partners[end], partners[other] = other, end
            corners[end] = corners[other] = corner
    return partners, corners
