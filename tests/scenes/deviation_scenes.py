"""Pairs of clouds of the same walls, with all errors that a comparison must know, and a plain M3C2 to compare with."""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, Generator, Points
from algorithms.deviations.joint_poses import JointPoses

DISTANCES_M = (3.0, 5.0, 8.0, 12.0, 2.5, 6.0)
"""Of the six walls from the instrument."""
STATIONS_M = np.array([[0.0, 0.0, 0.0], [1.0, 0.5, 0.0]])
NOISE_M, WAVES_M, WAVE_LENGTH_M = 0.002, 0.001, 0.4
WAVES = 12
"""Of which a field of errors is made."""
ROTATION_STD_RAD, SHIFT_STD_M = 1e-4, 8e-4


@dataclass(frozen=True, eq=False)
class CloudPair:
    """Two clouds of the same six walls in the common frame, as their registered poses put them."""

    first: Points
    second: Points
    poses: JointPoses


def pair_without_change(seed: int, *, points: int, waves_m: float = WAVES_M, pose_share: float = 1.0) -> CloudPair:
    """Simulate noise, waves of each scan's ranges, and poses with errors drawn from their joint covariance."""
    rng = np.random.default_rng(seed)
    poses = JointPoses(STATIONS_M, pose_share**2 * correlated_poses(rng))
    motions = np.linalg.cholesky(poses.covariance + 1e-24 * np.eye(12)) @ rng.normal(size=12)
    clouds = []
    for k in range(2):
        places, normals = _walls(rng, points)
        errors = rng.normal(0.0, NOISE_M, len(places))
        if waves_m:
            errors += _waves(rng, places, waves_m)
        turn, shift = motions[6 * k : 6 * k + 3], motions[6 * k + 3 : 6 * k + 6]
        measured = places + errors[:, None] * normals
        clouds.append(measured + np.cross(turn, measured - STATIONS_M[k]) + shift)
    return CloudPair(clouds[0], clouds[1], poses)


def correlated_poses(rng: Generator) -> Array:
    """Draw a covariance (12, 12) of two poses that share much of their errors."""
    mixture = rng.normal(size=(12, 12))
    mixture /= np.linalg.norm(mixture, axis=1)[:, None]
    scale = np.tile(np.repeat([ROTATION_STD_RAD, SHIFT_STD_M], 3), 2)
    return np.asarray(mixture @ mixture.T * np.outer(scale, scale))


def _waves(rng: Generator, places: Points, std_m: float) -> Array:
    """Give errors (n,) that are nearly normal, correlated by about exp(-(d / length)^2)."""
    vectors = rng.normal(0.0, np.sqrt(2.0) / WAVE_LENGTH_M, (WAVES, 3))
    phases = places @ vectors.T + rng.uniform(0.0, 2.0 * np.pi, WAVES)
    return np.asarray(np.cos(phases).sum(axis=1) * std_m * np.sqrt(2.0 / WAVES))


def _walls(rng: Generator, points: int) -> tuple[Points, Points]:
    places, normals = [], []
    for k, distance in enumerate(DISTANCES_M):
        axis, side = k // 2, 1.0 - 2.0 * (k % 2)
        normal = np.zeros(3)
        normal[axis] = -side
        wall = rng.uniform(-1.5, 1.5, (points, 3)) + 0.15 * distance
        wall[:, axis] = side * distance
        places.append(wall)
        normals.append(np.tile(normal, (points, 1)))
    return np.concatenate(places), np.concatenate(normals)


def waving_floor(lift_m: float) -> Points:
    """Give 2601 points of a waving floor in an order and with a roughness that no random generator decides."""
    u, v = (axis.ravel() for axis in np.meshgrid(np.linspace(0.0, 2.0, 51), np.linspace(0.0, 2.0, 51)))
    k = np.arange(len(u))
    rough = 0.003 * np.sin(12.9898 * k + 78.233 * lift_m)
    return np.column_stack(
        [u + 0.01 * np.sin(3.0 * k), v + 0.01 * np.cos(5.0 * k), 0.1 * np.sin(2.0 * u) + rough + lift_m]
    )


def plain_m3c2(first: Points, second: Points, core: Array, radius: float, half: float, normal_radius: float) -> Array:
    """Give distance, level of detection (1.96 std) and normal (5,) at a core point, without any index."""
    near = first[np.linalg.norm(first - core, axis=1) <= normal_radius]
    normal = np.linalg.eigh(np.cov(near.T))[1][:, 0]
    normal *= np.sign(normal[2])
    parts = []
    for cloud in (first, second):
        along = (cloud - core) @ normal
        aside = np.linalg.norm(cloud - core - along[:, None] * normal, axis=1)
        parts.append(along[(aside <= radius) & (np.abs(along) <= half)])
    level = 1.96 * np.sqrt(sum(part.var(ddof=1) / len(part) for part in parts))
    return np.array([parts[1].mean() - parts[0].mean(), level, *normal])
