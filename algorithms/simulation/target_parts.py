"""Meshes of survey targets: spheres, black-and-white boards, retro-reflective squares and cylinders, and what is taken
for one.
"""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Array, Vector3
from algorithms.simulation.curved_parts import tube
from algorithms.simulation.materials import Material
from algorithms.simulation.parts import Part, polygons

SPHERE_STEPS = 240
"""Facets around a sphere: of 0.1 m radius they lie within 0.02 mm of it."""
FOIL_SAGITTA_M = 1e-5
"""So near to a cylinder its facets lie that its foil fades across it as on a round one, not by steps."""
SPHERE_PAINT = Material("sphere paint", 0.85)
BOARD_BLACK = Material("board black", 0.08)
BOARD_WHITE = Material("board white", 0.85)
RETRO = Material("retro-reflective foil", 8.0, color=(0.6, 0.6, 0.6))
"""Throws the beam back to the instrument: many times a white wall's signal."""


def sphere(centre_m: Sequence[float], radius_m: float, material: Material = SPHERE_PAINT) -> Part:
    """Build a sphere of facets whose mean distance from the centre is the radius."""
    rows = SPHERE_STEPS // 2
    latitudes = np.linspace(-0.5 * np.pi, 0.5 * np.pi, rows + 1)
    longitudes = 2.0 * np.pi * np.arange(SPHERE_STEPS) / SPHERE_STEPS
    grid = np.stack(
        [
            np.cos(latitudes)[:, None] * np.cos(longitudes),
            np.cos(latitudes)[:, None] * np.sin(longitudes),
            np.repeat(np.sin(latitudes)[:, None], SPHERE_STEPS, axis=1),
        ],
        axis=-1,
    )
    # a square facet of half side a lies a²/3 r below its corners' sphere on the average of its points, at most a²/r
    half = np.pi / SPHERE_STEPS
    radius = radius_m * (1.0 + 2.0 * half**2 / 3.0)
    number = np.arange((rows + 1) * SPHERE_STEPS).reshape(rows + 1, SPHERE_STEPS)
    low, high = number[:-1], number[1:]
    low_next, high_next = np.roll(low, -1, axis=1), np.roll(high, -1, axis=1)
    triangles = np.concatenate(
        [
            np.stack([low, low_next, high_next], axis=-1)[1:].reshape(-1, 3),
            np.stack([low, high_next, high], axis=-1)[:-1].reshape(-1, 3),
        ]
    )
    return Part(
        vertices=np.asarray(centre_m) + radius * grid.reshape(-1, 3),
        triangles=triangles.astype(np.int64),
        edges=np.empty((0, 2, 3)),
        material=material,
    )


def facing(
    centre_m: Sequence[float] | Array, towards: Sequence[float] | Array, turn_rad: float = 0.0
) -> RigidTransform:
    """Give the pose of a plane target: its x and y axes in its plane, z towards the given direction."""
    normal = np.asarray(towards, dtype=np.float64) / np.linalg.norm(towards)
    up = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    x = np.cross(up, normal)
    x /= np.linalg.norm(x)
    rotation = Rotation.from_matrix(np.column_stack([x, np.cross(normal, x), normal]))
    return RigidTransform.from_components(
        np.asarray(centre_m, dtype=np.float64), rotation * Rotation.from_rotvec([0.0, 0.0, turn_rad])
    )


def _rectangle(pose: RigidTransform, low: tuple[float, float], high: tuple[float, float]) -> Array:
    (x0, y0), (x1, y1) = low, high
    return np.asarray(pose.apply(np.array([[x0, y0, 0.0], [x1, y0, 0.0], [x1, y1, 0.0], [x0, y1, 0.0]])))


def checker_board(world_from_board: RigidTransform, size_m: float) -> list[Part]:
    """Build a board of four squares, black and white in turns, that meet in its centre (the pose's origin)."""
    h = 0.5 * size_m
    black = [_rectangle(world_from_board, (-h, -h), (0.0, 0.0)), _rectangle(world_from_board, (0.0, 0.0), (h, h))]
    white = [_rectangle(world_from_board, (-h, 0.0), (0.0, h)), _rectangle(world_from_board, (0.0, -h), (h, 0.0))]
    return [polygons(black, BOARD_BLACK), polygons(white, BOARD_WHITE)]


def plate(world_from_plate: RigidTransform, width_m: float, height_m: float, material: Material = RETRO) -> Part:
    """Build a rectangle of one material about the pose's origin: a retro-reflective square, a sign, a number plate."""
    corner = (0.5 * width_m, 0.5 * height_m)
    return polygons([_rectangle(world_from_plate, (-corner[0], -corner[1]), corner)], material)


def retro_cylinder(centre_m: Vector3, size_m: float) -> list[Part]:
    """Build an upright cylinder as wide as it is high, about its centre: foil around it, dark lids."""
    half = np.array([0.0, 0.0, 0.5 * size_m])
    x, y, low = (float(v) for v in np.asarray(centre_m) - half)
    foil = tube((x, y, low), (x, y, low + size_m), 0.5 * size_m, RETRO, capped=False, sagitta_m=FOIL_SAGITTA_M)
    bottom, top = np.split(foil.vertices[:-2], 2)
    return [foil, polygons([bottom[::-1], top], BOARD_BLACK, with_edges=False)]
