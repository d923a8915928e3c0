"""The true straight edges of a virtual photo, with what they are."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Flags, Indices, Labels, Scalars, Vectors2
from algorithms.simulation.rendering_candidates import body_edges, shadow_edges, texture_edges, tube_outlines
from algorithms.simulation.rendering_edges import EdgeSamples, sample_edges
from algorithms.simulation.rendering_shading import Shading, Sights
from algorithms.simulation.scene import Scene
from algorithms.simulation.sun import MORNING, Daylight
from algorithms.simulation.virtual_camera import VirtualCamera

STEP_PX = 1.0
"""Edges are looked at in such steps."""
BESIDE_PX = 1.0
"""Both sides of an edge are looked at in this distance from it."""
CLEAR_PX = (0.05, 0.5, 2.0, 3.0)
"""An edge stands alone where nothing else changes at these distances from it either."""
ON_FACE_M = 1e-6
"""Within this a point lies on a face."""
MAX_GAP_PX = 3.0
"""Interruptions up to this do not end an edge: something thin passes in front of it."""
SAME_PX = 0.5
"""A piece that lies within this along a longer one is the same edge."""


class EdgeKind(IntEnum):
    """Why there is an edge in the photo."""

    GEOMETRY = 0
    """An edge of a body: two faces meet, or one ends."""
    MATERIAL = 1
    """Another material, or a field of a texture, begins on one plane."""
    SHADOW = 2
    """The shadow of something ends on one plane."""
    OUTLINE = 3
    """A round body ends: a straight edge of the photo, but another line in space for every station."""


@dataclass(frozen=True, eq=False)
class TrueEdges:
    """n visible straight edges of one photo, longest first."""

    ideal: Array
    """(n, 2, 2) first and last visible point, in ideal pixels; `Camera.image_from_ideal` leads to the photo."""
    world: Array
    """(n, 2, 3) the same points in the world [m]."""
    kinds: Labels
    """(n,) `EdgeKind` values."""
    contrasts: Scalars
    """(n,) median difference between both sides, 1 px off the edge, without blur and vignetting [grey levels]."""
    alone: Scalars
    """(n,) share of the length along which nothing else begins within 3 px on either side. Blur moves the place of
    other edges: a sill 2 px below a wall's foot, or a strip narrower than a pixel, is not seen as what it is."""

    def __len__(self) -> int:
        return len(self.kinds)

    def __getitem__(self, which: Array) -> "TrueEdges":
        """Select edges by an index array or mask."""
        return TrueEdges(
            self.ideal[which], self.world[which], self.kinds[which], self.contrasts[which], self.alone[which]
        )

    @property
    def lengths_px(self) -> Scalars:
        """(n,) lengths in the photo without distortion."""
        return np.asarray(np.linalg.norm(self.ideal[:, 1] - self.ideal[:, 0], axis=1))


def visible_edges(
    scene: Scene,
    world_from_camera: RigidTransform,
    camera: VirtualCamera,
    daylight: Daylight = MORNING,
    *,
    min_length_px: float = 10.0,
    min_contrast: float = 4.0,
) -> TrueEdges:
    """Find the straight edges that a photo really shows.

    Every edge of a body, outline of a tube, line of a texture and edge of a shadow is followed through the photo.
    Rays one pixel to its left and right decide: the edge is seen where its point in space lies on a face that one of
    them meets, where neither meets anything in front of it, and where both sides differ in brightness.

    Parameters
    ----------
    scene, world_from_camera, camera, daylight
        As of `render_photo`. The camera's noise, blur and gamma do not matter.
    min_length_px
        Shorter pieces are left out.
    min_contrast
        Weaker pieces are left out [grey levels].
    """
    shading = Shading(scene, daylight)
    eye = np.asarray(world_from_camera.translation)
    bodies, (outlines, tubes) = body_edges(scene), tube_outlines(scene, eye)
    textures, textured = texture_edges(shading)
    shadows, shaded = shadow_edges(shading)
    families = (
        (EdgeKind.GEOMETRY, bodies, np.full(len(bodies), -1, dtype=np.int64)),
        (EdgeKind.OUTLINE, outlines, shading.tube_surfaces[tubes]),
        (EdgeKind.MATERIAL, textures, textured),
        (EdgeKind.SHADOW, shadows, shaded),
    )
    pieces = [
        _visible_pieces(shading, world_from_camera, camera, kind, lines, surfaces, min_length_px, min_contrast)
        for kind, lines, surfaces in families
    ]
    merged = TrueEdges(
        np.concatenate([p.ideal for p in pieces]),
        np.concatenate([p.world for p in pieces]),
        np.concatenate([p.kinds for p in pieces]),
        np.concatenate([p.contrasts for p in pieces]),
        np.concatenate([p.alone for p in pieces]),
    )
    return _once(merged[np.argsort(-merged.lengths_px, kind="stable")])


def _visible_pieces(
    shading: Shading,
    world_from_camera: RigidTransform,
    camera: VirtualCamera,
    kind: EdgeKind,
    lines: Array,
    surfaces: Indices,
    min_length_px: float,
    min_contrast: float,
) -> TrueEdges:
    """Follow lines (e, 2, 3) of one kind, which lie on surfaces (e,) where these are known."""
    samples = sample_edges(lines, world_from_camera, camera.camera, STEP_PX)
    inside = camera.camera.inside(camera.camera.image_from_ideal(samples.ideal))
    samples = samples[inside]
    points = world_from_camera.apply(samples.points)
    across = _normals(samples)
    sides = tuple(
        _look(shading, world_from_camera, camera, samples.ideal + side_px * across)
        for side_px in (-BESIDE_PX, BESIDE_PX)
    )
    distances = np.linalg.norm(samples.points, axis=1)
    mine = surfaces[samples.edges]
    if kind is EdgeKind.OUTLINE:
        on_faces = [_surfaces(shading, side) == mine for side in sides]
    else:
        on_faces = [_on_face(shading, side, points) for side in sides]
    in_front = [(side.ranges_m < distances * (1.0 - 1e-9)) & ~on for side, on in zip(sides, on_faces, strict=True)]
    grey = [255.0 * camera.exposure * side.colors.mean(axis=1) for side in sides]
    contrasts = np.abs(grey[0] - grey[1])
    one_plane = (sides[0].triangles >= 0) & (_surfaces(shading, sides[0]) == _surfaces(shading, sides[1]))
    same_light = sides[0].lit == sides[1].lit
    seen = (on_faces[0] | on_faces[1]) & ~in_front[0] & ~in_front[1] & (contrasts >= min_contrast)
    kinds = np.full(len(seen), int(kind), dtype=np.int32)
    if kind in {EdgeKind.MATERIAL, EdgeKind.SHADOW}:
        seen &= one_plane & (_surfaces(shading, sides[0]) == mine)
        seen &= same_light if kind is EdgeKind.MATERIAL else ~same_light
    elif kind is EdgeKind.GEOMETRY:
        # Bodies may join in one plane: then it is the material that changes, or light that ends just there.
        kinds[one_plane] = np.where(same_light[one_plane], EdgeKind.MATERIAL, EdgeKind.SHADOW)
    else:
        seen &= ~one_plane
    alone = np.zeros(len(seen), dtype=bool)
    alone[seen] = _stands_alone(shading, world_from_camera, camera, samples.ideal[seen], across[seen])
    return _pieces(samples, points, seen, kinds, contrasts, alone, min_length_px)


def _normals(samples: EdgeSamples) -> Vectors2:
    """Give the unit vector (n, 2) across the edge at each point."""
    starts = np.flatnonzero(np.diff(samples.edges, prepend=-1))
    ends = np.flatnonzero(np.diff(samples.edges, append=-1))
    along = np.repeat(samples.ideal[ends] - samples.ideal[starts], ends - starts + 1, axis=0)
    lengths = np.linalg.norm(along, axis=1, keepdims=True)
    return np.asarray(np.column_stack([-along[:, 1], along[:, 0]]) / np.maximum(lengths, 1e-9))


def _look(shading: Shading, world_from_camera: RigidTransform, camera: VirtualCamera, ideal: Vectors2) -> Sights:
    """Look through ideal pixels (n, 2)."""
    rays = camera.camera.rays_from_ideal(ideal) @ world_from_camera.rotation.as_matrix().T
    return shading.look(np.asarray(world_from_camera.translation), np.asarray(rays))


def _stands_alone(
    shading: Shading, world_from_camera: RigidTransform, camera: VirtualCamera, ideal: Vectors2, across: Vectors2
) -> Flags:
    """Tell at which points (n, 2) both sides of an edge remain what they are from its rim up to 3 px away."""
    alone = np.ones(len(ideal), dtype=bool)
    for side in (-1.0, 1.0):
        beside = shading.labels(_look(shading, world_from_camera, camera, ideal + side * BESIDE_PX * across))
        for distance in CLEAR_PX:
            there = shading.labels(_look(shading, world_from_camera, camera, ideal + side * distance * across))
            alone &= beside == there
    return alone


def _surfaces(shading: Shading, side: Sights) -> Indices:
    """Give the number (n,) of the plane or tube that each ray met, -1 for the sky."""
    return np.asarray(np.where(side.triangles >= 0, shading.surfaces[side.triangles], -1))


def _on_face(shading: Shading, side: Sights, points: Array) -> Flags:
    """Tell whether the faces that rays met contain the points (n, 3) beside which they passed."""
    normals, offsets = shading.scene.normals[side.triangles], shading.scene.offsets_m[side.triangles]
    heights = np.abs(np.einsum("ni,ni->n", normals, points) - offsets)
    return np.asarray((side.triangles >= 0) & (heights < ON_FACE_M))


def _pieces(
    samples: EdgeSamples,
    points: Array,
    seen: Flags,
    kinds: Labels,
    contrasts: Scalars,
    alone: Flags,
    min_length_px: float,
) -> TrueEdges:
    """Join the points of each edge that are seen, and of one kind, to pieces."""
    keep = np.flatnonzero(seen)
    gap = np.linalg.norm(np.diff(samples.ideal[keep], axis=0), axis=1) > MAX_GAP_PX + STEP_PX
    breaks = gap | (np.diff(samples.edges[keep]) != 0) | (np.diff(kinds[keep]) != 0)
    groups = [g for g in np.split(keep, np.flatnonzero(breaks) + 1) if len(g) > 1]
    groups = [g for g in groups if np.linalg.norm(samples.ideal[g[-1]] - samples.ideal[g[0]]) >= min_length_px]
    ends = np.array([(g[0], g[-1]) for g in groups], dtype=np.int64).reshape(-1, 2)
    return TrueEdges(
        samples.ideal[ends],
        points[ends],
        kinds[ends[:, 0]],
        np.array([np.median(contrasts[g]) for g in groups], dtype=np.float64),
        np.array([np.mean(alone[g]) for g in groups], dtype=np.float64),
    )


def _once(edges: TrueEdges) -> TrueEdges:
    """Leave out pieces that lie along another one: shorter, or as long but listed later."""
    kept = np.ones(len(edges), dtype=bool)
    for k in range(1, len(edges)):
        starts, ends = edges.ideal[:k][kept[:k], 0], edges.ideal[:k][kept[:k], 1]
        run = ends - starts
        lengths = np.linalg.norm(run, axis=1)
        directions = run / lengths[:, None]
        inside = np.ones(len(starts), dtype=bool)
        for point in edges.ideal[k]:
            offset = point - starts
            along = np.einsum("ni,ni->n", offset, directions)
            across = np.abs(offset[:, 0] * directions[:, 1] - offset[:, 1] * directions[:, 0])
            inside &= (across < SAME_PX) & (along > -SAME_PX) & (along < lengths + SAME_PX)
        kept[k] = not inside.any()
    return edges[kept]
