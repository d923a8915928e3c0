"""Repair and lighten a mesh: small parts, holes, smoothing, fewer triangles, cuts by planes."""

from collections.abc import Sequence
from typing import Any

import mapbox_earcut
import numpy as np
from jaxtyping import Int64

from algorithms.arrays import Array, Matrix, Vector3
from algorithms.deviations.signed_distances import inside_polygon
from algorithms.deviations.triangles import Mesh
from algorithms.errors import InvalidInputError
from algorithms.geometry.lines import bases_of
from algorithms.meshing.faults import border_loops, components_of
from algorithms.meshing.reconstruction import triangle_areas, used_vertices
from algorithms.scans.open3d_loading import import_open3d

SHAKE = 1e-9
"""Of the extent of a rim; moves nothing but which triangles are made."""
TRIALS = 30
"""Of shakes; where a rim crosses itself none will do."""
LEAST_TRIANGLES = 4
"""A closed surface has no fewer."""


def without_small_components(mesh: Mesh, least_share: float) -> Mesh:
    """Leave out the parts that have a smaller share of the surface; the largest one always stays."""
    labels = components_of(mesh)
    areas = np.bincount(labels, triangle_areas(mesh))
    kept = areas >= least_share * areas.sum()
    kept[np.argmax(areas)] = True
    return used_vertices(Mesh(mesh.vertices, mesh.triangles[kept[labels]]))


def filled(mesh: Mesh, largest_m: float) -> tuple[Mesh, int]:
    """Close the holes whose rim is not longer than `largest_m`, by triangles between the vertices of the rim.

    A rim is laid out in the plane that fits it and cut into ears (Held 2001); one that crosses itself there stays open.

    Returns
    -------
    The mesh, and how many holes were closed.
    """
    caps: list[Array] = []
    for loop in border_loops(mesh):
        rim = mesh.vertices[loop]
        length = float(np.linalg.norm(rim - np.roll(rim, -1, axis=0), axis=1).sum())
        if len(loop) >= 3 and length <= largest_m:
            _, _, axes = np.linalg.svd(rim - rim.mean(axis=0), full_matrices=False)
            cap = ears_of((rim - rim.mean(axis=0)) @ axes[:2].T, [len(loop)])
            if len(cap) == len(loop) - 2:
                caps.append(loop[cap])
    return Mesh(mesh.vertices, np.concatenate([mesh.triangles, *caps])), len(caps)


def cut_by_plane(mesh: Mesh, point_m: Vector3, normal: Vector3) -> Mesh:
    """Keep what lies before a plane, and close the cut with triangles in the plane.

    Parameters and errors as `cut_open`; where the mesh is open at the plane, the cut stays open.
    """
    cut, loops = cut_open(mesh, point_m, normal)
    flat = (cut.vertices - point_m) @ across(-normal)  # so seen the rims of the outside turn left, those of holes right
    return used_vertices(Mesh(cut.vertices, np.concatenate([cut.triangles, *caps_of(loops, flat)])))


def cut_open(mesh: Mesh, point_m: Vector3, normal: Vector3) -> tuple[Mesh, Sequence[Array]]:
    """Keep what lies before a plane, and leave the cut open.

    Parameters
    ----------
    mesh
        The mesh.
    point_m, normal
        A point of the plane [m], and the direction, of any length, to the side that is kept.

    Returns
    -------
    The mesh, with vertices that nothing uses, and the rims in the plane as of `border_loops`.

    Raises
    ------
    InvalidInputError
        Nothing lies before the plane.
    """
    unit = normal / np.linalg.norm(normal)
    heights = (mesh.vertices - point_m) @ unit
    # a vertex in the plane is laid before it: no triangle then touches the plane with less than an edge
    before = heights >= 0.0
    if not before[mesh.triangles].any():
        raise InvalidInputError("cuts", "nothing of the mesh lies before the plane", "turn its normal, or move it")
    vertices, triangles, on_cut = _clipped(mesh, heights, before)
    vertices[on_cut] -= np.outer((vertices[on_cut] - point_m) @ unit, unit)
    cut = Mesh(vertices, triangles)
    of_cut = np.zeros(len(vertices), dtype=np.bool_)
    of_cut[on_cut] = True
    return cut, [loop for loop in border_loops(cut) if of_cut[loop].all()]


def across(normal: Vector3) -> Matrix:
    """Give two directions (3, 2) across a normal of any length, which turn left as seen from its tip."""
    basis = bases_of((normal / np.linalg.norm(normal))[None])[0]
    return np.asarray(basis if np.linalg.det(np.column_stack([basis, normal])) > 0.0 else basis[:, ::-1])


def _clipped(mesh: Mesh, heights: Array, before: Array) -> tuple[Array, Array, Array]:
    """Give vertices, triangles and new vertices of what lies before the plane."""
    sides = before[mesh.triangles]
    count = sides.sum(axis=1)
    new: dict[tuple[int, int], int] = {}
    places: list[Array] = []

    def crossing(one: int, other: int) -> int:
        key = (min(one, other), max(one, other))
        if key not in new:
            a, b = key
            share = heights[a] / (heights[a] - heights[b])
            new[key] = len(mesh.vertices) + len(places)
            places.append(mesh.vertices[a] + share * (mesh.vertices[b] - mesh.vertices[a]))
        return new[key]

    cut: list[tuple[int, int, int]] = []
    for triangle, inside in zip(
        mesh.triangles[(count == 1) | (count == 2)], sides[(count == 1) | (count == 2)], strict=True
    ):
        lone = int(np.argmax(inside) if inside.sum() == 1 else np.argmin(inside))
        a, b, c = np.roll(triangle, -lone).tolist()
        ab, ca = crossing(a, b), crossing(c, a)
        cut += [(a, ab, ca)] if inside.sum() == 1 else [(ab, b, c), (ab, c, ca)]
    vertices = np.concatenate([mesh.vertices, np.array(places).reshape(-1, 3)])
    triangles = np.concatenate([mesh.triangles[count == 3], np.array(cut, dtype=np.int64).reshape(-1, 3)])
    return vertices, triangles, np.arange(len(mesh.vertices), len(vertices))


def caps_of(loops: Sequence[Array], flat: Matrix) -> Sequence[Array]:
    """Triangulate rims in a plane, in the sense in which they run: those within an odd number of others bound holes.

    Parameters
    ----------
    loops
        Vertices of each rim.
    flat
        (v, 2) all vertices in the plane [m].
    """
    inside = np.array(
        [[one is not two and bool(inside_polygon(flat[one[:1]], flat[two])[0]) for two in loops] for one in loops]
    ).reshape(len(loops), len(loops))
    depths = inside.sum(axis=1)
    caps = []
    for k in np.flatnonzero(depths % 2 == 0).tolist():
        rings = [loops[k], *(loops[j] for j in np.flatnonzero(inside[:, k] & (depths == depths[k] + 1)).tolist())]
        ring = np.concatenate(rings)
        caps.append(ring[ears_of(flat[ring], [len(each) for each in rings])])
    return caps


def ears_of(places: Matrix, lengths: Sequence[int]) -> Int64[Array, "_ 3"]:
    """Triangulate a polygon with holes, in the sense in which its first ring runs."""
    ends = np.cumsum(lengths).astype(np.uint32)
    rng = np.random.default_rng(0)
    wanted = len(places) + 2 * (len(lengths) - 1) - 2
    ears = np.empty((0, 3), dtype=np.int64)
    for _ in range(TRIALS):
        # the library drops vertices on a straight line, which the triangles beside the rim have: none lies on one any
        # more; where two slivers cross by rounding it gives up on one, and another shake lays them otherwise
        shaken = places + rng.uniform(-SHAKE, SHAKE, places.shape) * np.ptp(places)
        ears = mapbox_earcut.triangulate_float64(shaken, ends).astype(np.int64).reshape(-1, 3)
        if len(ears) == wanted:
            break
    outer = places[: lengths[0]]
    turn = _twice_area(outer[:, 0], outer[:, 1])
    x, y = places[ears, 0], places[ears, 1]
    turns = (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0])
    return ears if turns.sum() * turn >= 0.0 else ears[:, ::-1]


def _twice_area(x: Array, y: Array) -> float:
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def smoothed_mesh(mesh: Mesh, passes: int) -> Mesh:
    """Smooth by Taubin's two alternating means (1995), which keep the size; open3d does the work."""
    if passes == 0:
        return mesh
    made = _legacy(mesh).filter_smooth_taubin(number_of_iterations=passes)
    return Mesh(np.asarray(made.vertices, dtype=np.float64), mesh.triangles)


def decimated(mesh: Mesh, share: float) -> Mesh:
    """Keep a share of the triangles by quadric error metrics (Garland and Heckbert 1997), by open3d.

    Its older function, because VTK's and fast-simplification's now and then leave edges of three triangles.
    """
    wanted = int(share * len(mesh.triangles))
    if share >= 1.0 or wanted < LEAST_TRIANGLES:
        return mesh
    made = _legacy(mesh).simplify_quadric_decimation(wanted)
    return used_vertices(Mesh(np.asarray(made.vertices), np.asarray(made.triangles).astype(np.int64)))


def _legacy(mesh: Mesh) -> Any:
    open3d = import_open3d()
    return open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(mesh.vertices), open3d.utility.Vector3iVector(mesh.triangles.astype(np.int32))
    )
