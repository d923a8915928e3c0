"""Intersect the cone of a contour, measured in one photo, with a mesh.

Points of an occluding contour and the projection centre make a general cone that touches the object; cut with the
model it gives an edge that the scanner misses (Haring 2003, ch. 6). A tangent ray of a model with errors passes beside
it or pierces it, so no point of intersection is well defined: here the ray takes the depth of the model's own outline,
where triangles that look towards the camera meet others that look away, next to it in the photo.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy.spatial import cKDTree

from algorithms.arrays import Array, Points, Scalars
from algorithms.colouring.photo_views import PlacedPhoto
from algorithms.deviations.triangles import Mesh
from algorithms.meshing.faults import edges_of
from algorithms.scans.triangle_tree import TriangleTree

NEAREST_EDGES = 8
"""Edges of the outline whose middles are nearest in the photo are looked at."""
OFF_SURFACE = 0.05
"""Rays start this share of an edge before the outline, so that it does not hide itself."""


@dataclass(frozen=True, eq=False)
class ContourOnModel:
    """Points of a contour on the model."""

    points_m: Points
    """(n, 3) on the cone, at the depth of the outline [m]; NaN where no outline is near."""
    gaps_px: Scalars
    """(n,) distance from the outline in the photo, positive where the contour lies outside the model [px]; NaN."""
    gaps_m: Scalars
    """(n,) the same across the ray [m]; NaN."""


def contour_on_model(
    mesh: Mesh, photo: PlacedPhoto, pixels: Float64[Array, "n 2"], largest_gap_px: float
) -> ContourOnModel:
    """Lay the points of a contour on the model.

    Parameters
    ----------
    mesh
        The model in the frame of the photo's pose, normals outward [m].
    photo
        In which the contour was measured.
    pixels
        (n, 2) columns and rows of the contour.
    largest_gap_px
        An outline farther off than this is that of something else.
    """
    count = len(pixels)
    points, gaps_px, gaps_m = np.full((count, 3), np.nan), np.full(count, np.nan), np.full(count, np.nan)
    outline, sides = _outline(mesh, photo)
    if not len(outline):
        return ContourOnModel(points, gaps_px, gaps_m)
    camera, pose = photo.camera, photo.common_from_camera
    ends = camera.ideal_from_camera(outline.reshape(-1, 3)).reshape(-1, 2, 2)
    inner = camera.ideal_from_camera(sides)
    ideal = camera.ideal_from_image(np.asarray(pixels, dtype=np.float64))
    _, near = cKDTree(ends.mean(axis=1)).query(ideal, k=min(NEAREST_EDGES, len(ends)))
    near = np.asarray(near).reshape(count, -1)
    along = ends[near, 1] - ends[near, 0]
    apart = ideal[:, None] - ends[near, 0]
    lengths = np.maximum(np.einsum("nkc,nkc->nk", along, along), np.finfo(np.float64).tiny)
    shares = np.clip(np.einsum("nkc,nkc->nk", apart, along) / lengths, 0.0, 1.0)
    away = apart - shares[..., None] * along
    distances = np.linalg.norm(away, axis=2)
    best = np.argmin(distances, axis=1)
    row = np.arange(count)
    edge, share, gap = near[row, best], shares[row, best], distances[row, best]
    # the inverse of depth is linear in the photo
    depth = 1.0 / ((1.0 - share) / outline[edge, 0, 2] + share / outline[edge, 1, 2])
    rays = camera.rays_from_ideal(ideal)
    on_cone = rays * (depth / rays[:, 2])[:, None]
    inward = np.einsum("nc,nc->n", away[row, best], inner[edge] - ends[edge].mean(axis=1))
    signs = np.where(inward > 0.0, -1.0, 1.0)
    found = gap <= largest_gap_px
    points[found] = pose.apply(on_cone[found])
    gaps_px[found] = (signs * gap)[found]
    gaps_m[found] = (signs * gap * depth / camera.fx)[found]
    return ContourOnModel(points, gaps_px, gaps_m)


def _outline(mesh: Mesh, photo: PlacedPhoto) -> tuple[Array, Array]:
    """Give the visible edges of the outline (e, 2, 3) in the camera's frame, and a place (e, 3) inside of each."""
    camera, pose = photo.camera, photo.common_from_camera
    vertices = pose.inv().apply(mesh.vertices)
    corners = vertices[mesh.triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    seen = np.einsum("ij,ij->i", across, corners[:, 0]) < 0.0
    edges = edges_of(mesh)
    facing = np.bincount(edges.of_side[seen].ravel(), minlength=len(edges.counts))
    inner = np.zeros(len(edges.counts), dtype=np.int64)
    inner[edges.of_side[seen].ravel()] = np.repeat(np.flatnonzero(seen), 3)
    # of the two triangles one is seen; at the rim of an open surface the only one may be
    chosen = np.flatnonzero((facing == 1) & (edges.counts <= 2) & camera.projectable(vertices)[edges.ends].all(axis=1))
    ends = vertices[edges.ends[chosen]]
    inside = corners[inner[chosen]].mean(axis=1)
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    middles = ends.mean(axis=1)
    outward = middles - inside
    outward /= np.maximum(np.linalg.norm(outward, axis=1), np.finfo(np.float64).tiny)[:, None]
    starts = middles + OFF_SURFACE * lengths[:, None] * outward
    hidden = TriangleTree(vertices, mesh.triangles).meets_any(starts, -starts, near=1e-6, far=1.0)
    return ends[~hidden], inside[~hidden]
