"""Meshes of curved bodies: tubes and bushes."""

import numpy as np
from scipy.spatial import ConvexHull

from algorithms.geometry.lines import bases_of
from algorithms.simulation.materials import Material
from algorithms.simulation.parts import CylinderTruth, Part

MAX_SAGITTA_M = 1e-4
"""How far a facet may lie inside the circle it stands for."""
MIN_FACETS = 48
"""More than 36, so that facets meet at less than 10 degrees and are never taken for edges."""


def tube(
    start_m: tuple[float, float, float],
    end_m: tuple[float, float, float],
    radius_m: float,
    material: Material,
    *,
    capped: bool = True,
    sagitta_m: float = MAX_SAGITTA_M,
) -> Part:
    """Build a round tube as a prism.

    The facets lie within `sagitta_m` of the cylinder, and their mean distance from the axis is the radius:
    a prism with its corners at rho has the mean facet distance rho * mean(cos(pi/n) / cos(u), |u| < pi/n).
    """
    start, end = np.array(start_m, dtype=np.float64), np.array(end_m, dtype=np.float64)
    direction = (end - start) / np.linalg.norm(end - start)
    basis = bases_of(direction[None, :])[0]
    n = max(MIN_FACETS, int(np.ceil(np.pi / np.arccos(1.0 - min(sagitta_m / radius_m, 0.5)))))
    half = np.pi / n
    mean_of_unit_prism = np.cos(half) / half * np.log(np.tan(np.pi / 4 + half / 2))
    angle = 2.0 * half * np.arange(n)
    circle = radius_m / mean_of_unit_prism * np.column_stack([np.cos(angle), np.sin(angle)]) @ basis.T
    k = np.arange(n)
    following = (k + 1) % n
    mantle = np.vstack([np.column_stack([k, following, n + following]), np.column_stack([k, n + following, n + k])])
    caps = np.vstack(
        [
            np.column_stack([np.full(n, 2 * n), following, k]),
            np.column_stack([np.full(n, 2 * n + 1), n + k, n + following]),
        ]
    )
    return Part(
        vertices=np.vstack([start + circle, end + circle, start, end]),
        triangles=np.vstack([mantle, caps]) if capped else mantle,
        edges=np.empty((0, 2, 3)),
        material=material,
        cylinder=CylinderTruth(start_m, end_m, radius_m),
    )


def bush(
    centre_m: tuple[float, float, float],
    size_m: tuple[float, float, float],
    material: Material,
    rng: np.random.Generator,
    *,
    corners: int = 300,
) -> Part:
    """Build an irregular closed blob, half axes `size_m`, with a rough surface (20 % of the radius)."""
    golden = np.pi * (3.0 - np.sqrt(5.0))
    z = 1.0 - 2.0 * (np.arange(corners) + 0.5) / corners
    azimuth = golden * np.arange(corners)
    sphere = np.column_stack([np.sqrt(1 - z**2) * np.cos(azimuth), np.sqrt(1 - z**2) * np.sin(azimuth), z])
    triangles = ConvexHull(sphere).simplices.astype(np.int64)
    rough = sphere * (1.0 + 0.2 * rng.uniform(-1.0, 1.0, size=(corners, 1)))
    return Part(
        vertices=np.array(centre_m) + rough * np.array(size_m),
        triangles=triangles,
        edges=np.empty((0, 2, 3)),
        material=material,
    )
