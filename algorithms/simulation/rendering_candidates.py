"""Lines of a scene that a photo may show as edges: of bodies, tubes, textures and shadows."""

import numpy as np

from algorithms.arrays import Array, Indices, Points, Vector3
from algorithms.simulation.rendering_shading import Shading
from algorithms.simulation.scene import Scene

BESIDE_M = 2e-3
"""Sun rays pass an edge at this distance to find what lies in its shadow."""
FLAT_COSINE = 0.02
"""Faces that the sun grazes at less than this receive no shadow worth looking for."""
SUN_DISTANCE_M = 1e7
"""From so far away all outlines of a scene are those of parallel light."""
RAYS_PER_EDGE = 49
"""Sun rays on each side of an edge."""


def body_edges(scene: Scene) -> Array:
    """Give all edges (e, 2, 3) of bodies and the rims of open sheets once, smooth joints included [m]."""
    sides = scene.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    _, first, count = np.unique(np.sort(sides, axis=1), axis=0, return_index=True, return_counts=True)
    rims = scene.vertices[sides[first[count == 1]]]
    edges = np.concatenate([scene.part_edges, rims])
    flip = np.array([tuple(b) < tuple(a) for a, b in np.round(edges, 6)], dtype=bool)
    ordered = np.where(flip[:, None, None], edges[:, ::-1], edges)
    _, first = np.unique(np.round(ordered.reshape(-1, 6), 6), axis=0, return_index=True)
    return np.asarray(ordered[np.sort(first)])


def tube_outlines(scene: Scene, eye: Vector3) -> tuple[Array, Indices]:
    """Give the lines (e, 2, 3) in which planes through the eye (3,) touch tubes, and the tube (e,) of each [m].

    Two for every tube that does not contain the eye. With the eye's distance D from the axis the touching points
    stand at arccos(r / D) on both sides of its direction.
    """
    outlines, tubes = [], []
    for number, tube in enumerate(scene.cylinders):
        start, end = np.array(tube.start_m), np.array(tube.end_m)
        axis = (end - start) / np.linalg.norm(end - start)
        towards = eye - start - ((eye - start) @ axis) * axis
        distance = np.linalg.norm(towards)
        if distance <= tube.radius_m:
            continue
        towards /= distance
        cosine = tube.radius_m / distance
        across = np.sqrt(1.0 - cosine**2) * np.cross(axis, towards)
        outlines += [tube.radius_m * (cosine * towards + side * across) + np.array([start, end]) for side in (1, -1)]
        tubes += [number, number]
    return np.array(outlines).reshape(-1, 2, 3), np.array(tubes, dtype=np.int64)


def texture_edges(shading: Shading) -> tuple[Array, Indices]:
    """Give the lines (e, 2, 3) of all textures and the surface (e,) on which each of them lies [m].

    They run across the box around all faces of one material in one plane; gaps between the faces are not cut out.
    """
    scene, (axes_u, axes_v) = shading.scene, shading.face_axes
    lines, surfaces = [np.empty((0, 2, 3))], [np.empty(0, dtype=np.int64)]
    for number, material in enumerate(scene.materials):
        if material.texture is None:
            continue
        mine = scene.material_ids == number
        for surface in np.unique(shading.surfaces[mine]):
            faces = np.flatnonzero(mine & (shading.surfaces == surface))
            u, v, normal = axes_u[faces[0]], axes_v[faces[0]], scene.normals[faces[0]]
            corners = scene.vertices[scene.triangles[faces]].reshape(-1, 3) @ np.column_stack([u, v])
            flat = material.texture.edges(corners.min(axis=0), corners.max(axis=0))
            lines.append(flat[:, :, :1] * u + flat[:, :, 1:] * v + scene.offsets_m[faces[0]] * normal)
            surfaces.append(np.full(len(flat), surface, dtype=np.int64))
    return np.concatenate(lines), np.concatenate(surfaces)


def shadow_edges(shading: Shading) -> tuple[Array, Indices]:
    """Give the lines (e, 2, 3) to which the sun may throw the edges of bodies, and the surface (e,) of each [m]."""
    scene, towards = shading.scene, shading.daylight.towards_sun
    if not shading.daylight.shines:
        return np.empty((0, 2, 3)), np.empty(0, dtype=np.int64)
    outlines, _ = tube_outlines(scene, np.asarray(scene.vertices.mean(axis=0) + SUN_DISTANCE_M * towards))
    edges = np.concatenate([body_edges(scene), outlines])
    thrown, faces = _receivers(shading, edges)
    normals, offsets = scene.normals[faces], scene.offsets_m[faces]
    facing = normals @ towards
    kept = (np.abs(facing) > FLAT_COSINE) & (shading.tubes[faces] < 0)
    thrown, faces, normals, offsets, facing = (a[kept] for a in (thrown, faces, normals, offsets, facing))
    ends = edges[thrown]
    heights = (np.einsum("eki,ei->ek", ends, normals) - offsets[:, None]) / facing[:, None]
    # Only what stands on the sunny side of the face throws a shadow on it.
    share = heights[:, 0] / np.where(heights[:, 0] == heights[:, 1], 1.0, heights[:, 0] - heights[:, 1])
    crossing = ends[:, 0] + share[:, None] * (ends[:, 1] - ends[:, 0])
    cut = np.where((heights < 0.0)[:, :, None], crossing[:, None, :], ends)
    shadows = cut - np.maximum(heights, 0.0)[:, :, None] * towards
    real = np.any(heights > 0.0, axis=1) & (np.linalg.norm(shadows[:, 1] - shadows[:, 0], axis=1) > BESIDE_M)
    return shadows[real], shading.surfaces[faces[real]]


def _receivers(shading: Shading, edges: Array) -> tuple[Indices, Indices]:
    """Find what sun rays meet that pass closely by an edge: numbers of edges (k,) and of triangles (k,) behind them.

    Of all triangles of one surface behind one edge one is named.
    """
    towards = shading.daylight.towards_sun
    across = np.cross(edges[:, 1] - edges[:, 0], towards)
    lengths = np.linalg.norm(across, axis=1)
    numbers = np.flatnonzero(lengths > 1e-9)
    across = across[numbers] / lengths[numbers, None]
    shares = (np.arange(RAYS_PER_EDGE) + 0.5) / RAYS_PER_EDGE
    along = edges[numbers, None, 0] + shares[:, None] * (edges[numbers, None, 1] - edges[numbers, None, 0])
    starts = np.concatenate([along + side * BESIDE_M * across[:, None, :] for side in (1.0, -1.0)], axis=1)
    which = np.repeat(numbers, 2 * RAYS_PER_EDGE)
    origins: Points = starts.reshape(-1, 3)
    # A face that carries the edge is met at once, beyond it lies the receiver: the ray starts a little below.
    hits = shading.shadow_caster.cast(origins - BESIDE_M * towards, np.broadcast_to(-towards, origins.shape).copy())
    found = hits.found
    pairs = np.column_stack([which[found], shading.surfaces[hits.triangles[found]]])
    _, first = np.unique(pairs, axis=0, return_index=True)
    return which[found][first].astype(np.int64), hits.triangles[found][first]
