"""What single rays of a camera see: surface, light and colour."""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, Flags, Indices, Points, Vector3
from algorithms.simulation.ray_casting import RayCaster
from algorithms.simulation.scene import Scene
from algorithms.simulation.sun import Daylight
from algorithms.simulation.textures import face_axes

SHADOW_FROM_M = 1e-3
"""Nearer to a surface single precision finds the surface itself."""
LIFT_M = 1e-4
"""What is so near is looked for from this far above the surface; from there alone, all shadows would be too short."""
ON_TUBE = 1e-3
"""Relative to its radius, how near to a tube's mantle the corners of its facets lie."""
SUN_RIM = np.array([(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)])
"""Places that tell whether all of the sun is seen."""
SKY = -1
"""Number of the surface that is none."""


@dataclass(frozen=True, eq=False)
class Sights:
    """What n rays see."""

    colors: Points
    """(n, 3) radiances, 1 for a white face turned to the sun."""
    triangles: Indices
    """(n,) triangles of the scene, -1 for the sky."""
    ranges_m: Array
    """(n,) distances, inf for the sky [m]."""
    lit: Flags
    """(n,) True in the sun."""
    fields: Indices
    """(n,) field of the surface's texture."""


class Shading:
    """A scene in daylight, ready to be looked at."""

    def __init__(self, scene: Scene, daylight: Daylight) -> None:
        """Build the search trees."""
        self.scene = scene
        self.daylight = daylight
        self._caster = RayCaster(scene)
        # Panes let the sun through.
        solid = np.flatnonzero(~scene.is_glass)
        self.shadow_caster = self._caster if len(solid) == len(scene.triangles) else RayCaster(scene, solid)
        """Of everything that throws shadows."""
        self.face_axes = face_axes(scene.normals)
        """Axes u and v of textures on each triangle, (t, 3) each."""
        self._albedos = np.array([material.albedo for material in scene.materials])
        self.tubes = tube_facets(scene)
        """(t,) number of the tube to which each triangle's facet belongs, -1 for plane faces."""
        first_tube = scene.plane_ids.max(initial=0) + 1
        self.tube_surfaces = first_tube + np.arange(len(scene.cylinders))
        """(c,) number of each tube among the surfaces."""
        self.surfaces = np.where(self.tubes >= 0, first_tube + self.tubes, scene.plane_ids)
        """(t,) number of each triangle's plane or tube."""

    def look(self, origin: Vector3, directions: Points, towards_sun: Points | None = None) -> Sights:
        """Follow rays from an origin (3,) along unit directions (n, 3) in the world.

        Shadows are those of the middle of the sun, or of its places in directions `towards_sun`, one for each ray.
        """
        hits = self._caster.cast(origin, directions)
        found = np.flatnonzero(hits.found)
        colors = np.broadcast_to(np.array(self.daylight.sky_color), directions.shape).copy()
        lit, fields = np.zeros(len(directions), dtype=bool), np.full(len(directions), SKY, dtype=np.int64)
        rays, triangles = directions[found], hits.triangles[found]
        points = origin + hits.ranges_m[found, None] * rays
        normals = self._normals(points, triangles, rays)
        albedos, fields[found] = self._albedos_at(points, triangles)
        light = self.daylight.skylight(normals)
        facing = normals @ self.daylight.towards_sun
        towards = self.daylight.towards_sun if towards_sun is None else towards_sun[found]
        sunny = self._in_sun(points, normals, np.broadcast_to(towards, points.shape))
        light[sunny] += self.daylight.sun_share * facing[sunny, None]
        lit[found] = sunny
        colors[found] = albedos * light
        return Sights(colors, hits.triangles, hits.ranges_m, lit, fields)

    def in_half_shadow(self, origin: Vector3, directions: Points, sights: Sights) -> Flags:
        """Tell which rays (n,) see places that one of four places on the sun's rim lights unlike its middle."""
        half = np.zeros(len(directions), dtype=bool)
        found = np.flatnonzero(sights.triangles >= 0)
        rays = directions[found]
        points = origin + sights.ranges_m[found, None] * rays
        normals = self._normals(points, sights.triangles[found], rays)
        for towards in self.daylight.towards_disc(SUN_RIM):
            half[found] |= self._in_sun(points, normals, np.broadcast_to(towards, points.shape)) != sights.lit[found]
        return half

    def labels(self, sights: Sights) -> Indices:
        """Give each ray (n,) a number that differs wherever a photo could show an edge between two of them."""
        found = sights.triangles >= 0
        surface = np.where(found, self.surfaces[sights.triangles], SKY)
        material = np.where(found, self.scene.material_ids[sights.triangles], SKY)
        label = (surface * (len(self.scene.materials) + 1) + material) * 2 + sights.lit
        # Products wrap around beyond 64 bits; that two neighbours then agree by chance is out of the question.
        return np.asarray(label * np.int64(1_000_003) + sights.fields)

    def _normals(self, points: Points, triangles: Indices, rays: Points) -> Points:
        """Give unit normals on the side that is looked at; on tubes those of the cylinder, not of the facet."""
        normals = self.scene.normals[triangles]
        tubes = self.tubes[triangles]
        for number in np.unique(tubes[tubes >= 0]):
            tube, here = self.scene.cylinders[number], tubes == number
            start, axis = np.array(tube.start_m), np.array(tube.end_m) - np.array(tube.start_m)
            axis /= np.linalg.norm(axis)
            outward = points[here] - start
            outward -= (outward @ axis)[:, None] * axis
            outward /= np.linalg.norm(outward, axis=1, keepdims=True)
            normals[here] = outward * np.sign(np.einsum("ij,ij->i", outward, normals[here]))[:, None]
        away = np.einsum("ij,ij->i", self.scene.normals[triangles], rays) > 0.0
        normals[away] *= -1.0
        return np.asarray(normals)

    def _albedos_at(self, points: Points, triangles: Indices) -> tuple[Points, Indices]:
        """Give colours (n, 3) and numbers of the fields (n,) of textures at points (n, 3) of triangles (n,)."""
        materials = self.scene.material_ids[triangles]
        albedos, fields = self._albedos[materials], np.zeros(len(points), dtype=np.int64)
        for number, material in enumerate(self.scene.materials):
            if material.texture is None:
                continue
            here = np.flatnonzero(materials == number)
            u = np.einsum("ij,ij->i", self.face_axes[0][triangles[here]], points[here])
            v = np.einsum("ij,ij->i", self.face_axes[1][triangles[here]], points[here])
            albedos[here], fields[here] = material.texture.paint(u, v, self._albedos[number])
        return albedos, fields

    def _in_sun(self, points: Points, normals: Points, towards: Points) -> Flags:
        """Tell from which points (n, 3) of surfaces with normals (n, 3) the sun can be seen."""
        sunny = np.asarray(normals @ self.daylight.towards_sun > 0.0) & self.daylight.shines
        candidates = np.flatnonzero(sunny)
        if len(candidates):
            feet, rays = points[candidates], towards[candidates]
            hidden = self.shadow_caster.occluded(feet, rays, SHADOW_FROM_M)
            # a wall throws its shadow from its foot on: a thread of sunlight there would shift the edge in photos
            hidden |= self.shadow_caster.occluded(
                feet + LIFT_M * normals[candidates], rays, 0.0, SHADOW_FROM_M + LIFT_M
            )
            sunny[candidates] = ~hidden
        return np.asarray(sunny)


def tube_facets(scene: Scene) -> Indices:
    """Give the number of the tube to whose mantle each triangle (t,) belongs, -1 for other faces."""
    numbers = np.full(len(scene.triangles), -1, dtype=np.int64)
    for number, tube in enumerate(scene.cylinders):
        start, axis = np.array(tube.start_m), np.array(tube.end_m) - np.array(tube.start_m)
        length = np.linalg.norm(axis)
        axis /= length
        along = (scene.vertices - start) @ axis
        across = np.linalg.norm(scene.vertices - start - along[:, None] * axis, axis=1)
        near = np.abs(across - tube.radius_m) < np.maximum(ON_TUBE * tube.radius_m, 2e-4)
        near &= (along > -ON_TUBE) & (along < length + ON_TUBE)
        mantle = near[scene.triangles].all(axis=1) & (np.abs(scene.normals @ axis) < 1e-6)
        numbers[mantle] = number
    return numbers
