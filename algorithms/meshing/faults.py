"""What is wrong with a mesh, fault by fault, with its places."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from algorithms.arrays import Array, Flags, Indices, Labels, Points
from algorithms.deviations.triangles import Mesh
from algorithms.meshing.reconstruction import triangle_areas
from algorithms.scans.triangle_tree import TriangleTree

MOST_PLACES = 20
"""So many places of one kind are listed."""
SMALL_COMPONENT = 0.01
"""Parts with a smaller share of the surface are small."""
EDGES_AT_ONCE = 200_000
ENDS = 1e-6
"""Nearer to the ends of the edge or the sides of the triangle, as a share of their lengths, a crossing is a touch."""


@dataclass(frozen=True, eq=False)
class MeshFault:
    """Faults of one kind."""

    kind: str
    """`border-loop`, `non-manifold-edge`, `contradicting-edge`, `self-intersection`, `small-component`, `flipped`."""
    count: int
    places_m: Points
    """(k, 3) of the first ones, at most twenty [m]."""


@dataclass(frozen=True, eq=False)
class MeshEdges:
    """The edges of a mesh and their triangles."""

    ends: Array
    """(e, 2) vertices, ascending."""
    of_side: Array
    """(t, 3) edge of the sides AB, BC, CA of each triangle."""
    counts: Array
    """(e,) triangles at each edge."""
    turns: Array
    """(e,) how often it is run upward less how often downward; 0 where two triangles agree."""


def edges_of(mesh: Mesh) -> MeshEdges:
    """List the edges; O(t log t)."""
    ends = np.stack([mesh.triangles, np.roll(mesh.triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    upward = ends[:, 0] < ends[:, 1]
    keys = np.sort(ends, axis=1)
    packed = keys[:, 0] * len(mesh.vertices) + keys[:, 1]
    _, first, numbers, counts = np.unique(packed, return_index=True, return_inverse=True, return_counts=True)
    turns = np.bincount(numbers.ravel(), np.where(upward, 1.0, -1.0))
    return MeshEdges(keys[first], numbers.reshape(-1, 3), counts, turns)


def border_loops(mesh: Mesh, edges: MeshEdges | None = None) -> Sequence[Array]:
    """Give the rims of holes, each (k,) vertices in the order in which new triangles would run along them.

    Rims that meet in a vertex are separated there. Where triangles beside a rim look to opposite sides, or more than
    two meet, what is given may be a part of a rim.
    """
    found = edges_of(mesh) if edges is None else edges
    sides = np.argwhere(found.counts[found.of_side] == 1)
    starts = mesh.triangles[sides[:, 0], (sides[:, 1] + 1) % 3]
    ends = mesh.triangles[sides[:, 0], sides[:, 1]]
    onward: dict[int, list[int]] = {}
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        onward.setdefault(start, []).append(end)
    loops: list[Array] = []
    for start in sorted(onward):
        while onward[start]:
            loops.extend(_simple_loops(start, onward))
    return loops


def _simple_loops(start: int, onward: dict[int, list[int]]) -> Sequence[Array]:
    """Walk along the rim from a vertex until it ends, and cut the way where it crosses itself."""
    path, loops = [start], []
    where = {start: 0}
    while onward.get(path[-1]):
        vertex = onward[path[-1]].pop()
        if vertex in where:
            loops.append(np.array(path[where[vertex] :], dtype=np.int64))
            for left in path[where[vertex] + 1 :]:
                del where[left]
            del path[where[vertex] + 1 :]
        else:
            where[vertex] = len(path)
            path.append(vertex)
    return [*loops, np.array(path, dtype=np.int64)] if len(path) > 1 else loops


def components_of(mesh: Mesh, edges: MeshEdges | None = None) -> Labels:
    """Find the parts that hang together by edges: the number of its part for each triangle, (t,)."""
    found = edges_of(mesh) if edges is None else edges
    count = len(mesh.triangles)
    rows = np.repeat(np.arange(count), 3)
    incidence = coo_array(
        (np.ones(3 * count, dtype=np.int8), (rows, found.of_side.ravel())), shape=(count, len(found.counts))
    ).tocsr()
    _, labels = connected_components(incidence @ incidence.T, directed=False)
    return np.asarray(labels, dtype=np.int32)


def self_intersections(mesh: Mesh, edges: MeshEdges | None = None) -> Indices:
    """Give the triangles that an edge of another one pierces, of triangles that share no vertex with that edge.

    Two triangles that cross in a line pierce each other by an edge. Surfaces that touch or lie in each other are not
    counted. O(t log t).
    """
    found = edges_of(mesh) if edges is None else edges
    tree = TriangleTree(mesh.vertices, mesh.triangles)
    pierced: list[Array] = []
    for start in range(0, len(found.ends), EDGES_AT_ONCE):
        ends = found.ends[start : start + EDGES_AT_ONCE]
        segments, triangles = tree.crossings(mesh.vertices[ends[:, 0]], mesh.vertices[ends[:, 1]])
        own = ends[segments]
        rows = mesh.triangles[triangles]
        apart = (rows[:, :, None] != own[:, None, :]).all(axis=(1, 2))
        apart[apart] = _pierces(mesh.vertices[own[apart]], mesh.vertices[rows[apart]])
        pierced.append(triangles[apart])
    return np.unique(np.concatenate(pierced)) if pierced else np.empty(0, dtype=np.int64)


def _pierces(edges: Array, corners: Array) -> Flags:
    """Tell which edges (n, 2, 3) pierce their triangles (n, 3, 3) (Möller and Trumbore 1997)."""
    along = edges[:, 1] - edges[:, 0]
    ab, ac = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(along, ac)
    scale = np.einsum("ij,ij->i", ab, across)
    apart = edges[:, 0] - corners[:, 0]
    turned = np.cross(apart, ab)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.einsum("ij,ij->i", apart, across) / scale
        v = np.einsum("ij,ij->i", along, turned) / scale
        t = np.einsum("ij,ij->i", ac, turned) / scale
        return np.asarray(np.minimum.reduce([u, v, 1.0 - u - v, t, 1.0 - t]) > ENDS)


def faults_of(mesh: Mesh, flipped: Indices) -> Sequence[MeshFault]:
    """List the faults of a mesh; kinds without any are not listed.

    Parameters
    ----------
    mesh
        The mesh.
    flipped
        Triangles that look away from the instruments, of `turned_away`.
    """
    edges = edges_of(mesh)
    middles = mesh.vertices[edges.ends].mean(axis=1)
    centres = mesh.vertices[mesh.triangles].mean(axis=1)
    loops = border_loops(mesh, edges)
    labels = components_of(mesh, edges)
    areas = np.bincount(labels, triangle_areas(mesh))
    small = np.flatnonzero(areas < SMALL_COMPONENT * areas.sum())
    first_of_part = np.unique(labels, return_index=True)[1]
    kinds: Sequence[tuple[str, Array]] = [
        ("border-loop", np.array([mesh.vertices[loop].mean(axis=0) for loop in loops]).reshape(-1, 3)),
        ("non-manifold-edge", middles[edges.counts > 2]),
        ("contradicting-edge", middles[(edges.counts == 2) & (edges.turns != 0.0)]),
        ("self-intersection", centres[self_intersections(mesh, edges)]),
        ("small-component", centres[first_of_part[small]]),
        ("flipped", centres[flipped]),
    ]
    return [MeshFault(kind, len(places), places[:MOST_PLACES]) for kind, places in kinds if len(places)]
