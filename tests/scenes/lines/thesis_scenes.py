"""The scenes in which the dissertation's estimator was examined (MATH 10), and noisy views of each.

5 mm points, 20 per metre, pieces of 1 to 4 m (girders longer), different pieces in both scans; the target frame lies
7 m from the source frame, turned as in the dissertation's example 1; the lines are in front of the source scanner.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.geometry.angles import GON_PER_RAD, rotation_from_angles
from algorithms.geometry.lines import Lines, bases_of, lines_from_arrays

NOISE_M = 0.005
POINTS_PER_M = 20.0
TARGET_FROM_SOURCE = RigidTransform.from_components(
    [3.8, -5.5, 1.7], rotation_from_angles(*(np.array([3.66, -5.43, 38.39]) / GON_PER_RAD))
)


@dataclass(frozen=True, eq=False)
class ThesisScene:
    """True lines in the source frame, with the lengths of the seen pieces."""

    points: np.ndarray
    directions: np.ndarray
    shortest_m: np.ndarray
    longest_m: np.ndarray


def thesis_scene(name: str, rng: np.random.Generator) -> ThesisScene:
    """Draw one of the scenes of MATH 10."""
    if name == "3 axes":
        return _with_pieces(np.array([[6.0, 1.0, 0.0], [6.0, -2.0, 1.0], [5.0, 2.0, 2.0]]), np.eye(3)[[2, 0, 1]])
    if name == "24 rooms":
        return _with_pieces(rng.uniform([3, -6, 0], [13, 6, 4], (24, 3)), np.eye(3)[np.arange(24) % 3])
    if name == "24 facade":
        return _with_pieces(rng.uniform([20, -8, 0], [20, 8, 6], (24, 3)), np.eye(3)[np.arange(24) % 2 + 1])
    if name == "bridge 14+2":
        points = np.vstack([rng.uniform([12, -3, 1], [18, 3, 5], (14, 3)), [[15.0, -6.0, 2.0], [15.0, 6.0, 2.0]]])
        lengths = np.array([4.0] * 16), np.array([12.0] * 14 + [4.0] * 2)
        return ThesisScene(points, np.eye(3)[[1] * 14 + [2] * 2], *lengths)
    count = int(name.split(maxsplit=1)[0])
    directions = rng.normal(size=(count, 3))
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return _with_pieces(rng.uniform([3, -6, 0], [13, 6, 4], (count, 3)), unit)


def _with_pieces(points: np.ndarray, directions: np.ndarray) -> ThesisScene:
    return ThesisScene(points, directions, np.full(len(points), 1.0), np.full(len(points), 4.0))


def seen(points: np.ndarray, directions: np.ndarray, scene: ThesisScene, rng: np.random.Generator) -> Lines:
    """See a piece of each line; covariance sigma² diag(1/Sss, 1/Sss, 1/n, 1/n), Sss = n l²/12 (MATH 2.2)."""
    n = len(points)
    lengths = rng.uniform(scene.shortest_m, scene.longest_m)
    counts = POINTS_PER_M * lengths
    std = NOISE_M / np.sqrt(np.stack([counts * lengths**2 / 12.0] * 2 + [counts] * 2, axis=1))
    errors, bases = std * rng.normal(size=(n, 4)), bases_of(directions)
    anchors = points + rng.uniform(-1.0, 1.0, (n, 1)) * directions
    return lines_from_arrays(
        anchors + np.einsum("nij,nj->ni", bases, errors[:, 2:]),
        directions + np.einsum("nij,nj->ni", bases, errors[:, :2]),
        std[:, :, None] ** 2 * np.eye(4),
        np.stack([-0.5 * lengths, 0.5 * lengths], axis=1),
    )


def views(scene: ThesisScene, rng: np.random.Generator) -> tuple[Lines, Lines]:
    """See a scene from both stations, line k as line k: target and source lines."""
    pose = TARGET_FROM_SOURCE
    target = seen(pose.apply(scene.points), pose.rotation.apply(scene.directions), scene, rng)
    return target, seen(scene.points, scene.directions, scene, rng)
