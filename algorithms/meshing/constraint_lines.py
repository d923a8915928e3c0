"""Keep sharp edges in a mesh: edges measured in photos or scans become edges of triangles.

The source inserts an edge as constraint into the triangulation (Ullrich, Schwarz and Kager 2003, post-processing). A
surface that smooths noise rounds an edge by about its resolution; here the vertices beside a line are laid onto the two
half-planes in which the points beside it lie, and those next to it onto the line.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, Flags, OtherPoints, Scalars, Vector3
from algorithms.deviations.triangles import Mesh
from algorithms.errors import InvalidInputError
from algorithms.geometry.lines import bases_of
from algorithms.meshing.faults import edges_of

REACH, SEEN = 2.0, 5.0
"""In units of the resolution: vertices nearer than this are moved, points nearer than this tell the half-planes."""
NEAREST = 1.0
"""Points nearer than this say nothing of the half-planes: their angle is all noise."""
BINS = 72
APART_RAD = float(np.radians(20.0))
"""Half-planes that differ by less are one."""
LEAST_SHARE = 0.05
"""A half-plane has at least this share of the points about the line."""
ALONG = 0.6
"""Vertices whose normal has a larger cosine with the line belong to the surface at its end."""
FITTING = 3


@dataclass(frozen=True, eq=False)
class ConstraintLine:
    """A straight edge of the surface."""

    start_m: Vector3
    end_m: Vector3


@dataclass(frozen=True, eq=False)
class _AboutLine:
    """Places in cylindrical coordinates about a line."""

    along_m: Scalars
    """From the start."""
    out_m: Scalars
    """From the line."""
    angles: Scalars
    """About it [rad]."""
    axis: Vector3
    basis: Array
    length_m: float

    def beside(self, out_m: float) -> Flags:
        return np.asarray((self.out_m < out_m) & (self.along_m >= 0.0) & (self.along_m <= self.length_m))


def with_edges(mesh: Mesh, points: OtherPoints, lines: Sequence[ConstraintLine], resolution_m: float) -> Mesh:
    """Lay edges of a mesh onto straight lines; triangles and their vertices' numbers stay.

    Parameters
    ----------
    mesh
        The mesh, not coarser than `resolution_m`.
    points
        (m, 3) through which it was laid [m].
    lines
        The edges, accurate to a fraction of the resolution.
    resolution_m
        Of the mesh [m].

    Raises
    ------
    InvalidInputError
        Where the points about a line do not lie in two half-planes.
    """
    vertices = mesh.vertices.copy()
    edges = edges_of(mesh).ends
    normals = _vertex_normals(mesh)
    for number, line in enumerate(lines):
        seen = _about(points, line)
        sides = _half_planes(seen, resolution_m, number)
        _lay(vertices, edges, normals, line, sides, REACH * resolution_m)
    ends = np.array([end for line in lines for end in (line.start_m, line.end_m)]).reshape(-1, 3)
    for end in ends:
        nearest = int(np.argmin(np.linalg.norm(vertices - end, axis=1)))
        if np.linalg.norm(vertices[nearest] - end) < resolution_m:
            vertices[nearest] = end
    return Mesh(vertices, mesh.triangles)


def _about(places: Array, line: ConstraintLine) -> _AboutLine:
    way = line.end_m - line.start_m
    length = float(np.linalg.norm(way))
    axis = way / length
    basis = bases_of(axis[None])[0]
    apart = places - line.start_m
    x, y = (apart @ basis).T
    return _AboutLine(apart @ axis, np.hypot(x, y), np.arctan2(y, x), axis, basis, length)


def _half_planes(seen: _AboutLine, resolution_m: float, number: int) -> tuple[float, float]:
    """Find the angles of the two half-planes from the line in which the points about it lie [rad]."""
    used = seen.beside(SEEN * resolution_m) & (seen.out_m > NEAREST * resolution_m)
    angles, out = seen.angles[used], seen.out_m[used]
    counts, borders = np.histogram(angles, BINS, (-np.pi, np.pi))
    smooth = counts + np.roll(counts, 1) + np.roll(counts, -1)
    centres = 0.5 * (borders[1:] + borders[:-1])
    found: list[float] = []
    for _ in range(2):
        free = np.all([np.abs(_turn(centres - each)) > APART_RAD for each in found], axis=0) if found else True
        best = int(np.argmax(np.where(free, smooth, -1)))
        near = np.abs(_turn(angles - centres[best])) < APART_RAD / 2.0
        if near.sum() < max(LEAST_SHARE * len(angles), 3.0):
            raise InvalidInputError(
                f"lines[{number}]",
                "the points about it do not lie in two surfaces that meet there",
                "the line must be an edge of the surface, in the coordinates of the world",
            )
        angle = float(centres[best])
        for _ in range(FITTING):
            near = np.abs(_turn(angles - angle)) < APART_RAD / 2.0
            weights = out[near] ** 2  # noise across a half-plane turns what is near the line most
            angle += float(np.sum(weights * _turn(angles[near] - angle)) / np.sum(weights))
        found.append(angle)
    return found[0], found[1]


def _lay(
    vertices: Array, edges: Array, normals: Array, line: ConstraintLine, sides: tuple[float, float], reach_m: float
) -> None:
    """Move vertices beside a line onto its half-planes, and of every edge that crosses it the nearer end onto it."""
    about = _about(vertices, line)
    moved = about.beside(reach_m) & (np.abs(normals @ about.axis) < ALONG)
    turns = np.stack([_turn(about.angles - side) for side in sides])
    second = np.abs(turns[1]) < np.abs(turns[0])
    turn = np.where(second, turns[1], turns[0])
    angle = np.where(second, sides[1], sides[0])
    out = np.maximum(about.out_m * np.cos(turn), 0.0)
    weight = np.clip(2.0 - 2.0 * about.out_m / reach_m, 0.0, 1.0)
    foot = line.start_m + about.along_m[:, None] * about.axis
    onto = foot + (out[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])) @ about.basis.T
    vertices[moved] += weight[moved, None] * (onto[moved] - vertices[moved])
    crossing = moved[edges].all(axis=1) & (second[edges[:, 0]] != second[edges[:, 1]])
    ends = edges[crossing]
    nearer = np.where(about.out_m[ends[:, 0]] <= about.out_m[ends[:, 1]], ends[:, 0], ends[:, 1])
    vertices[nearer] = foot[nearer]


def _turn(angles: Array) -> Array:
    """Bring angles to ±π."""
    return np.asarray((angles + np.pi) % (2.0 * np.pi) - np.pi)


def _vertex_normals(mesh: Mesh) -> Array:
    """Give the unit normals of the vertices, (v, 3), weighted by area."""
    corners = mesh.vertices[mesh.triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sums = np.zeros_like(mesh.vertices)
    for k in range(3):
        np.add.at(sums, mesh.triangles[:, k], across)
    return np.asarray(sums / np.maximum(np.linalg.norm(sums, axis=1), np.finfo(np.float64).tiny)[:, None])
