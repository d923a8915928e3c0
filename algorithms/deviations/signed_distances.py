"""Signed distances of a cloud from another cloud, from a mesh and from a set of planes."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64
from scipy.spatial import cKDTree

from algorithms.arrays import Array, CorePoints, Flags, Labels, OtherPoints, Points, Scalars
from algorithms.deviations.cylinders import core_normals
from algorithms.deviations.triangles import Mesh, closest_on_triangles, edge_normals
from algorithms.errors import InvalidInputError
from algorithms.geometry.lines import bases_of
from algorithms.scans.triangle_tree import TriangleTree

LEAST_PLANARITY = 0.1
"""Points with less about them are no surface with two sides: wires, twigs, clouds of dust."""


@dataclass(frozen=True, eq=False)
class SignedDistances:
    """Of n points how far each lies from the reference."""

    distances_m: Scalars
    """(n,) positive on the side to which the reference's normals point; without sides the plain distance; NaN where
    the reference has nothing within reach [m]."""
    signed: Flags
    """(n,) whether the sign means a side."""
    nearest: Labels
    """(n,) point, triangle or plane of the reference, -1 for none."""


def from_cloud(points: Points, reference: OtherPoints, normals: OtherPoints, max_distance_m: float) -> SignedDistances:
    """Measure the distance of each point from the tangent plane of the nearest point of another cloud.

    d = n · (x − y), y the nearest reference point, n the normal there; where it has none (zero), |x − y| without sign.
    The tangent plane and not the point: otherwise the spacing of the reference would count as deviation. O(n log m).

    Parameters
    ----------
    points
        (n, 3) points [m].
    reference
        (m, 3) the other cloud [m].
    normals
        (m, 3) its unit normals, of `cloud_normals`, turned to the side that counts as positive.
    max_distance_m
        Points farther from their nearest one have no distance [m].
    """
    lengths, found = cKDTree(reference).query(points, distance_upper_bound=max_distance_m)
    near = np.isfinite(lengths)
    nearest = np.where(near, found, -1).astype(np.int32)
    distances, signed = np.full(len(points), np.nan), np.zeros(len(points), dtype=np.bool_)
    which = nearest[near]
    along = np.einsum("ij,ij->i", points[near] - reference[which], normals[which])
    sided = np.einsum("ij,ij->i", normals[which], normals[which]) > 0.5
    distances[near] = np.where(sided, along, np.asarray(lengths)[near])
    signed[near] = sided
    return SignedDistances(distances, signed, nearest)


def cloud_normals(points: Points, radius_m: float, least_planarity: float = LEAST_PLANARITY) -> Points:
    """Fit normals (n, 3) of either sign to a cloud's own points; zero where it is no surface.

    Parameters
    ----------
    points
        (n, 3) points [m].
    radius_m
        Radius of the spheres in which planes are fitted [m].
    least_planarity
        Least (l₂ − l₁) / l₃ of a surface.
    """
    normals, planarity = core_normals(points, points, (radius_m,))
    return np.where(planarity[:, None] >= least_planarity, normals, 0.0)


def from_mesh(points: Points, mesh: Mesh, max_distance_m: float) -> SignedDistances:
    """Measure the distance of each point from a triangle mesh.

    The sign is that of the angle-weighted pseudonormal of the nearest face, edge or corner (Bærentzen and Aanæs 2005,
    doi:10.1109/TVCG.2005.49), right where a plain face normal is not, and needs no closed mesh. A point whose nearest
    place lies on the border of a hole has no side: `signed` is false there and the distance positive. O(n log
    triangles).

    Parameters
    ----------
    points
        (n, 3) points [m].
    mesh
        Triangles in the same frame [m].
    max_distance_m
        Points farther off have no distance [m].
    """
    nearest = TriangleTree(mesh.vertices, mesh.triangles).nearest(points)
    places, parts = closest_on_triangles(points, mesh.vertices[mesh.triangles[nearest]])
    normals, bordering = edge_normals(mesh)
    apart = points - places
    lengths = np.linalg.norm(apart, axis=1)
    sides = np.einsum("ij,ij->i", apart, normals[nearest, parts])
    signed = ~bordering[nearest, parts]
    distances = np.where(signed & (sides < 0.0), -lengths, lengths)
    near = lengths <= max_distance_m
    return SignedDistances(
        np.where(near, distances, np.nan), signed & near, np.where(near, nearest, -1).astype(np.int32)
    )


@dataclass(frozen=True, eq=False)
class PlaneSet:
    """k planes, each bounded or not."""

    points_m: CorePoints
    """(k, 3) a point of each plane [m]."""
    normals: CorePoints
    """(k, 3) unit normals to the side that counts as positive."""
    outlines: tuple[Float64[Array, "_ 3"] | None, ...]
    """Corners (c, 3) of each plane's outline in order [m], or None: it has no end."""


def from_planes(points: Points, planes: PlaneSet, max_distance_m: float) -> SignedDistances:
    """Measure the distance of each point from the nearest plane that it lies on or before.

    d = n · (x − p) of the plane with the smallest |d| among those within whose outline the point's foot lies. O(n k).

    Parameters
    ----------
    points
        (n, 3) points [m].
    planes
        The planes, with outlines where they end.
    max_distance_m
        Points farther off have no distance [m].
    """
    best, nearest = np.full(len(points), np.inf), np.full(len(points), -1, dtype=np.int32)
    for k, (place, normal, outline) in enumerate(zip(planes.points_m, planes.normals, planes.outlines, strict=True)):
        apart = points - place
        along = apart @ normal
        better = (np.abs(along) <= max_distance_m) & (np.abs(along) < np.abs(best))
        if outline is not None and better.any():
            basis = bases_of(normal[None])[0]
            corners = (outline - place) @ basis
            better[better] = inside_polygon(apart[better] @ basis, corners)
        best[better], nearest[better] = along[better], k
    found = nearest >= 0
    return SignedDistances(np.where(found, best, np.nan), found, nearest)


def inside_polygon(places: Float64[Array, "n 2"], corners: Float64[Array, "m 2"]) -> Bool[Array, "n"]:
    """Tell which places (n,) lie inside a polygon, by the parity of crossings of a ray along the first axis.

    Raises
    ------
    InvalidInputError
        With fewer than three corners.
    """
    if len(corners) < 3:
        raise InvalidInputError("outline", f"{len(corners)} corners bound nothing", "three or more")
    inside = np.zeros(len(places), dtype=np.bool_)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        crossing = (a[1] > places[:, 1]) != (b[1] > places[:, 1])
        if crossing.any():
            u = a[0] + (places[crossing, 1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
            inside[crossing] ^= places[crossing, 0] < u
    return inside
