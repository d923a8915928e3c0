"""Which surfaces are seen up to the very edge of a photo, so that nothing unseen lies between surface and edge.

A scanner's rows of points meet an edge in all phases, as it does not stand quite upright: although its step may be ten
pixels, some points of a surface that ends at the edge lie within a few pixels of it, and so do points of what is behind
it. Of a surface that ends before the edge no points come as near.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64

from algorithms.arrays import Array, Points, Scalars, Vector3
from algorithms.features.photo_lines.edge_bands import EdgeBands
from algorithms.features.photo_lines.side_planes import FRONT_SHARE, SidePlanes
from algorithms.features.photo_lines.side_planes_kernels import ZONE

TOUCHING, TOUCHING_PX = 0.3, (1.5, 3.0)
"""So near to the edge must points be, in spacings of points, between these limits [px]."""
WITNESSES = 3
"""So many of them: single points may be mixed, or on something else."""
APART_PX = 1.0
"""Points behind a surface's end that lie so much farther from the edge than the face between them would be seen are not
on that face [px]."""


@dataclass(frozen=True, eq=False)
class EdgeTouches:
    """What points right beside n edges say of the end of each side's plane."""

    ends_here: Bool[Array, "n 2"]
    """(n, 2) True where the plane is seen up to the edge, and from there on what lies behind it."""
    faces_px: Float64[Array, "n 2"]
    """(n, 2) how wide a face at right angles to the plane, from the edge back to what is seen behind it, looks in the
    photo [px]; 0 where that is not known."""


def edge_touches(
    bands: EdgeBands, planes: SidePlanes, projecting: Points, centre: Vector3, gap_px: float
) -> EdgeTouches:
    """Look for the points of each plane, and of what is behind it, that are nearest to the edge.

    Parameters
    ----------
    bands
        Points beside the edges.
    planes
        Planes of both sides.
    projecting
        (n, 3) normals of the projecting planes.
    centre
        (3,) projection centre [m].
    gap_px
        Points nearer to the edge made no plane.
    """
    n = len(bands)
    edges = np.repeat(np.arange(n), np.diff(bands.splits))
    near = np.flatnonzero(np.abs(bands.across) <= gap_px + ZONE * bands.spacings_px[edges])
    edges, distances, lies = edges[near], np.abs(bands.across[near]), (bands.across[near] <= 0.0).astype(np.int64)
    points = bands.points[near]
    limits = np.clip(TOUCHING * bands.spacings_px, *TOUCHING_PX)
    ends_here, faces = np.zeros((n, 2), dtype=bool), np.zeros((n, 2))
    for side in range(2):
        heights = np.einsum("mi,mi->m", points - planes.centroids[edges, side], planes.normals[edges, side])
        limit = planes.limits_m[edges, side]
        own = (lies == side) & (np.abs(heights) <= limit)
        behind, before = (lies != side) & (heights < -limit), (lies != side) & (heights > limit)
        reached = _smallest(distances, edges, own, n)
        beyond = _smallest(distances, edges, behind, n)
        count = np.bincount(edges[lies != side], minlength=n)
        hidden = np.bincount(edges[before], minlength=n) > FRONT_SHARE * count
        ends_here[:, side] = planes.exist[:, side] & (reached <= limits) & (beyond <= limits) & ~hidden
        widths = distances * _share_of_face(
            points, planes.normals[edges, side], planes.centroids[edges, side], projecting[edges], centre
        )
        width = _smallest(widths, edges, behind & (distances > widths + APART_PX), n)
        faces[:, side] = np.where(np.isfinite(width), width, 0.0)
    return EdgeTouches(ends_here, faces)


def _smallest(values: Scalars, groups: Int64[Array, "m"], chosen: Bool[Array, "m"], count: int) -> Array:
    """Give the smallest value but `WITNESSES` - 1 of each group (count,), infinite where there are fewer."""
    chosen_groups, chosen_values = groups[chosen], values[chosen]
    order = np.lexsort((chosen_values, chosen_groups))
    numbers = np.bincount(chosen_groups, minlength=count)
    enough = numbers >= WITNESSES
    smallest = np.full(count, np.inf)
    smallest[enough] = chosen_values[order][(np.cumsum(numbers) - numbers)[enough] + WITNESSES - 1]
    return smallest


def _share_of_face(
    points: Array, normals: Array, centroids: Array, projecting: Array, centre: Vector3
) -> Float64[Array, "m"]:
    """Give which share of the way from the edge to each point (m,) is its depth behind the plane, as seen in the photo.

    A ray that meets the point meets the plane at Q; where the point's foot on the plane lies nearer to the edge than Q,
    the difference is how far the depth moves the point away from the edge.
    """
    rays = points - centre
    heights = np.einsum("mi,mi->m", points - centroids, normals)
    towards = np.einsum("mi,mi->m", rays, normals)
    meets = rays * ((towards - heights) / np.where(np.abs(towards) > 1e-9, towards, 1e-9))[:, None]
    feet = rays - heights[:, None] * normals
    whole, rest = (np.einsum("mi,mi->m", x, projecting) for x in (meets, feet))
    return np.asarray(np.clip(1.0 - rest / np.where(np.abs(whole) > 1e-12, whole, 1e-12), 0.0, 1.0))
