"""Scenes that a user gives: a triangle mesh, or planes with outlines."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, Points
from algorithms.errors import InvalidInputError
from algorithms.simulation.materials import Material
from algorithms.simulation.parts import Part
from algorithms.simulation.scene import Scene, scene_from_parts

FLAT_M = 0.01
"""Corners of a plane's outline lie within this of one plane, or within a thousandth of its size."""
LEAST_AREA_M2 = 1e-6
ON_LINE = 1e-12


@dataclass(frozen=True, eq=False)
class GivenPlane:
    """A plane surface."""

    name: str
    outline_m: Points
    """(k, 3) corners in order, k >= 3 [m]."""
    material: Material


def scene_of_mesh(name: str, vertices: Points, triangles: Array, material: Material) -> Scene:
    """Make a scene of a triangle mesh of one material.

    Parameters
    ----------
    name
        Of the scene.
    vertices, triangles
        (v, 3) corners [m], and (t, 3) corners of each triangle; no triangle without area.
    material
        Of all triangles.
    """
    return scene_from_parts(name, [Part(vertices, triangles, np.empty((0, 2, 3)), material)], ())


def scene_of_planes(name: str, planes: Sequence[GivenPlane]) -> Scene:
    """Make a scene of planes with outlines.

    Parameters
    ----------
    name
        Of the scene.
    planes
        At least one.

    Raises
    ------
    InvalidInputError
        An outline is not flat, has no area, or crosses itself.
    """
    parts = []
    for plane in planes:
        triangles = triangles_of_outline(plane.outline_m, plane.name)
        edges = np.stack([plane.outline_m, np.roll(plane.outline_m, -1, axis=0)], axis=1)
        parts.append(Part(plane.outline_m, triangles, edges, plane.material))
    return scene_from_parts(name, parts, ())


def triangles_of_outline(corners_m: Points, name: str) -> Array:
    """Cut a simple plane polygon into triangles, ear by ear.

    Parameters
    ----------
    corners_m
        (k, 3) in order [m]; the polygon may have re-entrant corners.
    name
        Of the plane, for the refusal.

    Returns
    -------
    (k - 2, 3) corner numbers.

    Raises
    ------
    InvalidInputError
        The outline is not flat, has no area, or crosses itself.
    """
    centre = corners_m.mean(axis=0)
    local = corners_m - centre
    doubled = np.cross(local, np.roll(local, -1, axis=0)).sum(axis=0)
    area = 0.5 * float(np.linalg.norm(doubled))
    if area < LEAST_AREA_M2:
        raise InvalidInputError(name, "the outline encloses no area", "corners in order around the plane")
    normal = doubled / (2.0 * area)
    if float(np.abs(local @ normal).max()) > max(FLAT_M, 1e-3 * float(np.abs(local).max())):
        raise InvalidInputError(name, "the corners of the outline do not lie in one plane")
    first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    first /= np.linalg.norm(first)
    flat = np.column_stack([local @ first, local @ np.cross(normal, first)])
    left = list(range(len(flat)))
    triangles = []
    while len(left) > 3:
        ear = next((k for k in range(len(left)) if _is_ear(flat, left, k)), None)
        if ear is None:
            raise InvalidInputError(name, "the outline crosses itself", "corners in order around the plane")
        triangles.append((left[ear - 1], left[ear], left[(ear + 1) % len(left)]))
        del left[ear]
    triangles.append((left[0], left[1], left[2]))
    found, covered = _with_area(flat, np.array(triangles, dtype=np.int64))
    if abs(covered - area) > 1e-6 * area:
        raise InvalidInputError(name, "the outline crosses itself", "corners in order around the plane")
    return found


def _is_ear(flat: Array, left: Sequence[int], k: int) -> bool:
    """Tell whether a corner can be cut off: it points outwards, and no other corner lies in its triangle."""
    a, b, c = (flat[left[(k + step) % len(left)]] for step in (-1, 0, 1))
    if _turn(a, b, c) <= ON_LINE:
        return bool(_turn(a, b, c) > -ON_LINE)  # a corner on a straight side
    ends = {left[k - 1], left[k], left[(k + 1) % len(left)]}
    others = flat[[n for n in left if n not in ends]]
    inside = (_turn(a, b, others) >= 0.0) & (_turn(b, c, others) >= 0.0) & (_turn(c, a, others) >= 0.0)
    return not bool(np.any(inside))


def _turn(a: Array, b: Array, c: Array) -> Array:
    return np.asarray((b[0] - a[0]) * (c[..., 1] - a[1]) - (b[1] - a[1]) * (c[..., 0] - a[0]))


def _with_area(flat: Array, triangles: Array) -> tuple[Array, float]:
    """Leave out triangles between corners on one straight side, and give the area of the others."""
    a, b, c = (flat[triangles[:, k]] for k in range(3))
    twice = np.abs((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0]))
    return np.asarray(triangles[twice > ON_LINE]), float(0.5 * twice.sum())
