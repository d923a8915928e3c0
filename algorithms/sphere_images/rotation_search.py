"""The rotations in which two extended Gaussian images are most alike, coarse to fine, about one axis or all three."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from algorithms.arrays import Array, Matrices3, Scalars
from algorithms.sphere_images.gaussian_image import Directions, SphereImage, correlations, sphere_image
from algorithms.sphere_images.tessellation import tessellation

COARSEST_LEVEL = 2
"""Cells of 18 degrees: the first rotations are that far apart."""
KEPT_OF_ONE_AXIS, KEPT_OF_THREE = 24, 120
"""So many rotations are followed to the next tessellation."""
BLOCK = 400
"""Rotations correlated at once: bounds the memory."""


@dataclass(frozen=True, eq=False)
class RotationPeaks:
    """Distinct rotations in which the images are alike, the best first."""

    rotations: Matrices3
    """(k, 3, 3) target from source."""
    correlations: Scalars
    """(k,) in the finest tessellation."""
    width_rad: float
    """Of its cells: no rotation is known better [rad]."""


def rotation_peaks(
    target: Directions, source: Directions, *, finest_level: int, about_vertical: bool, most: int
) -> RotationPeaks:
    """Find the rotations of highest correlation.

    Parameters
    ----------
    target, source
        Directions of both scans.
    finest_level
        Of the tessellation, above `COARSEST_LEVEL`.
    about_vertical
        Turn about the z axis only: both instruments are levelled.
    most
        So many distinct ones are given at most.
    """
    kept = KEPT_OF_ONE_AXIS if about_vertical else KEPT_OF_THREE
    image = sphere_image(target, COARSEST_LEVEL)
    width = 0.5 * image.cells.width_rad
    rotations = _about_z(np.arange(0.0, 2.0 * np.pi, width)) if about_vertical else _all_rotations(2.0 * width)
    values = _correlated(image, source, rotations)
    for level in range(COARSEST_LEVEL + 1, finest_level + 1):
        best = _distinct(rotations, values, width, kept)
        image = sphere_image(target, level)
        width = 0.5 * image.cells.width_rad
        rotations = (_neighbours(width, about_vertical=about_vertical)[:, None] @ rotations[best][None]).reshape(
            -1, 3, 3
        )
        values = _correlated(image, source, rotations)
    best = _distinct(rotations, values, 4.0 * width, most)
    return RotationPeaks(rotations[best], values[best], 2.0 * width)


def _correlated(image: SphereImage, source: Directions, rotations: Matrices3) -> Scalars:
    parts = [correlations(image, source, rotations[k : k + BLOCK]) for k in range(0, len(rotations), BLOCK)]
    return np.concatenate(parts)


def _about_z(angles: Scalars) -> Array:
    return np.asarray(Rotation.from_euler("z", angles[:, None]).as_matrix())


def _all_rotations(step_rad: float) -> Array:
    """Spread rotations evenly: axes' directions over a sphere, and turns about each."""
    axes = tessellation(COARSEST_LEVEL).centres
    to_axis = np.array([_least_turn(axis).as_matrix() for axis in axes])
    turns = _about_z(np.arange(0.0, 2.0 * np.pi, step_rad))
    return np.asarray((to_axis[:, None] @ turns[None]).reshape(-1, 3, 3))


def _least_turn(axis: Array) -> Rotation:
    """Turn the z axis to a direction, the shortest way."""
    across = np.cross([0.0, 0.0, 1.0], axis)
    sine, cosine = float(np.linalg.norm(across)), float(axis[2])
    if sine < 1e-12:
        return Rotation.identity() if cosine > 0.0 else Rotation.from_rotvec([np.pi, 0.0, 0.0])
    return Rotation.from_rotvec(across / sine * np.arctan2(sine, cosine))


def _neighbours(width_rad: float, *, about_vertical: bool) -> Array:
    """Give small turns that fill what the coarser cells left open."""
    steps = np.array([-2.0, -1.0, 0.0, 1.0, 2.0]) * width_rad
    if about_vertical:
        return _about_z(steps)
    grid = np.stack(np.meshgrid(*[steps[1:4]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    return np.asarray(Rotation.from_rotvec(grid).as_matrix())


def _distinct(rotations: Matrices3, values: Scalars, radius_rad: float, most: int) -> Array:
    """Choose the best rotations that are farther from each other than a radius."""
    chosen: list[int] = []
    for k in np.argsort(-values, kind="stable").tolist():
        traces = np.einsum("hij,ij->h", rotations[chosen], rotations[k]) if chosen else np.empty(0)
        if not (0.5 * (traces - 1.0) > np.cos(radius_rad)).any():
            chosen.append(k)
            if len(chosen) == most:
                break
    return np.array(chosen, dtype=np.int64)
