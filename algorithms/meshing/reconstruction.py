"""Lay triangles through points: normals towards the instruments, then Poisson's equation or a rolling ball."""

import math
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from algorithms.arrays import Array, Indices, OtherPoints, Points, Scalars
from algorithms.deviations.cylinders import core_normals
from algorithms.deviations.triangles import Mesh
from algorithms.errors import InvalidInputError
from algorithms.meshing.options import SurfaceMethod
from algorithms.scans.open3d_loading import import_open3d
from algorithms.scans.voxel_grid import voxel_cells

CELLS_PER_RADIUS = 3.0
"""Points in a cube of the radius over this share a normal."""
LEAST_POINTS = 10
"""Fewer points bound nothing."""
DEEPEST, SHALLOWEST = 11, 4
"""Levels of Poisson's octree: 2048 cells along the longest axis need several gigabytes where all are full."""
MARGIN = 1.1
"""The octree is so much larger than the points."""
BALLS = (1.0, 2.0, 4.0)
"""Radii of the balls in units of the smallest."""
TANGENT_NEIGHBOURS = 15
OPPOSITE = -0.5
"""Cosine between a triangle's normal and that of the points from which it looks to the other side."""


def oriented_normals(points: Points, sensors_m: Points, radius_m: float) -> Points:
    """Fit unit normals (n, 3) and turn them to the side on which the instrument stood.

    Planes are fitted about the mean of the points of each small cube, whose points share them; a cube without a plane
    takes that of the nearest which has one. Where the instrument's place is not known, neighbours are turned alike
    (Hoppe et al. 1992), the highest one upward.

    Parameters
    ----------
    points
        (n, 3) [m].
    sensors_m
        (n, 3) where the instrument of each point stood [m]; NaN where nobody knows.
    radius_m
        Radius of the spheres in which planes are fitted [m].

    Raises
    ------
    InvalidInputError
        No sphere holds a plane.
    """
    cells = voxel_cells(points, radius_m / CELLS_PER_RADIUS)
    of_cells, _ = core_normals(points, cells.means, (radius_m,))
    fitted = np.flatnonzero(of_cells.any(axis=1))
    if not len(fitted):
        raise InvalidInputError("points", f"no plane fits them within {radius_m:g} m", "a larger `normal_radius_m`")
    known = np.isfinite(sensors_m).all(axis=1)
    if not known.all():
        of_cells[fitted] = _turned_alike(cells.means[fitted], of_cells[fitted])
    if len(fitted) < len(cells):
        _, nearest = cKDTree(cells.means[fitted]).query(cells.means)
        of_cells = of_cells[fitted[nearest]]
    turned = np.asarray(of_cells[cells.cell_of_point])
    away = np.einsum("ij,ij->i", turned[known], points[known] - sensors_m[known]) > 0.0
    turned[np.flatnonzero(known)[away]] *= -1.0
    return np.asarray(turned)


def _turned_alike(places: Points, normals: Points) -> Points:
    """Turn normals (n, 3) like their neighbours', the highest one upward."""
    open3d = import_open3d()
    cloud = _cloud(places)
    cloud.normals = open3d.utility.Vector3dVector(normals)
    if len(places) > 1:
        cloud.orient_normals_consistent_tangent_plane(min(TANGENT_NEIGHBOURS, len(places) - 1))
    turned: Array = np.array(cloud.normals)
    return turned if turned[np.argmax(places[:, 2]), 2] >= 0.0 else -turned


def reconstructed(points: Points, normals: Points, method: SurfaceMethod, resolution_m: float) -> Mesh:
    """Lay a mesh through points.

    open3d does the work (screened Poisson reconstruction, Kazhdan and Hoppe 2013; ball pivoting, Bernardini et al.
    1999), Poisson on one thread: on several its sums, and so the last digits, depend on their order.

    Parameters
    ----------
    points, normals
        (n, 3) near the origin [m], and unit normals to the outside.
    method
        Which of the two.
    resolution_m
        Edge of the smallest cells, or radius of the smallest ball [m].

    Raises
    ------
    InvalidInputError
        With fewer than ten points, where the resolution is too fine for the extent, or where no triangle comes out.
    """
    if len(points) < LEAST_POINTS:
        raise InvalidInputError("points", f"{len(points)} points are too few for a mesh", "ten or more")
    open3d = import_open3d()
    cloud = _cloud(points)
    cloud.normals = open3d.utility.Vector3dVector(normals)
    if method is SurfaceMethod.POISSON:
        made, _ = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
            cloud, depth=octree_depth(points, resolution_m), scale=MARGIN, n_threads=1
        )
    else:
        radii = open3d.utility.DoubleVector([each * resolution_m for each in BALLS])
        made = open3d.geometry.TriangleMesh.create_from_point_cloud_ball_pivoting(cloud, radii)
    mesh = Mesh(np.asarray(made.vertices, dtype=np.float64), np.asarray(made.triangles, dtype=np.int64))
    if not len(mesh.triangles):
        raise InvalidInputError("points", "no triangle fits them", "a larger `resolution_m` spans wider gaps")
    return used_vertices(mesh)


def octree_depth(points: Points, resolution_m: float) -> int:
    """Give the levels of an octree over the points whose smallest cells are not larger than the resolution.

    Raises
    ------
    InvalidInputError
        More than eleven levels would be needed.
    """
    extent = MARGIN * float(np.ptp(points, axis=0).max())
    depth = math.ceil(math.log2(max(extent / resolution_m, 1.0)))
    if depth > DEEPEST:
        least = extent / 2**DEEPEST
        raise InvalidInputError(
            "resolution_m",
            f"{resolution_m:.3g} m is too fine for {extent:.3g} m",
            f"at least {least:.3g} m, or crop (`cleaning.box`)",
        )
    return max(depth, SHALLOWEST)


def used_vertices(mesh: Mesh) -> Mesh:
    """Leave out the vertices that no triangle uses."""
    used, numbers = np.unique(mesh.triangles, return_inverse=True)
    return Mesh(mesh.vertices[used], np.ascontiguousarray(numbers.reshape(-1, 3)))


def near_points(mesh: Mesh, points: OtherPoints, max_gap_m: float) -> Mesh:
    """Leave out the triangles of which a corner is farther than `max_gap_m` from every point.

    Raises
    ------
    InvalidInputError
        None is left.
    """
    distances, _ = cKDTree(points).query(mesh.vertices, distance_upper_bound=max_gap_m)
    near = np.isfinite(np.asarray(distances))[mesh.triangles].all(axis=1)
    if not near.any():
        raise InvalidInputError("max_gap_m", f"no triangle lies within {max_gap_m:g} m of the points", "a larger one")
    return used_vertices(Mesh(mesh.vertices, mesh.triangles[near]))


def turned_away(mesh: Mesh, points: OtherPoints, normals: OtherPoints) -> Indices:
    """Give the triangles that look against the normal of the point nearest to their centre, by 120 degrees or more."""
    corners = mesh.vertices[mesh.triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    across /= np.maximum(np.linalg.norm(across, axis=1), np.finfo(np.float64).tiny)[:, None]
    _, nearest = cKDTree(points).query(corners.mean(axis=1))
    return np.flatnonzero(np.einsum("ij,ij->i", across, normals[nearest]) < OPPOSITE)


def triangle_areas(mesh: Mesh) -> Scalars:
    """Give the area of each triangle, (t,) [m²]."""
    corners = mesh.vertices[mesh.triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(0.5 * np.linalg.norm(across, axis=1))


def enclosed_volume(mesh: Mesh) -> float:
    """Give the volume that a closed mesh encloses, positive where its triangles look outward [m³].

    V = Σ a · (b × c) / 6 over the triangles a, b, c (the divergence theorem); about a vertex, for far origins.
    """
    corners = (mesh.vertices - mesh.vertices[0])[mesh.triangles]
    return float(np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0)


def _cloud(points: Points) -> Any:
    open3d = import_open3d()
    return open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
