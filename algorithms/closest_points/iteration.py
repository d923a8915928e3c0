"""Iterative closest points: point to point, point to plane, and squared-distance approximants (equations 20 to 22)."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol, runtime_checkable

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Points, Scalars, Vector3
from algorithms.closest_points.motions import best_motion, helical_motion
from algorithms.closest_points.surface_model import SurfaceModel, stiffness
from algorithms.errors import TooFewCorrespondencesError
from algorithms.geometry.rotations import velocity_design

MAD_TO_STD = 1.4826
HALF_WIDTH = 4.0
"""Distances of so many standard deviations have half of their square root's weight (weight function of the robust
estimation by reweighting: 1/(1 + (d/h)^4) on the root of the weight)."""
LEAST_PAIRS = 12
LEAST_SPREAD_M = 1e-9


class ErrorKind(StrEnum):
    """What is minimised."""

    POINT = "point"
    """Squared distances of points from points, in closed form: converges linearly."""
    PLANE = "plane"
    """Squared distances of points from tangent planes: quadratically where the surfaces fit, with a narrow basin."""
    D2 = "d2"
    """Quadratic approximants of the squared distance from the surface: between the two, by distance and curvature."""


@dataclass(frozen=True)
class IterationLimits:
    """When points correspond, and when to stop."""

    max_distance_m: float
    """Points farther from the surface take no part [m]."""
    max_angle_rad: float = np.pi
    """Nor do those whose normals differ by more [rad]."""
    max_iterations: int = 100
    least_step_m: float = 1e-6
    """Steps that move the points by less end the iteration (rms) [m]."""
    robust: bool = True
    """Whether large distances count less."""


@dataclass(frozen=True)
class IterationStep:
    """One iteration."""

    misfit_m: float
    """Weighted rms distance before the step [m]."""
    step_m: float
    """Rms displacement of the corresponding points by the step [m]."""
    pairs: int


@dataclass(frozen=True, eq=False)
class IterationResult:
    """Where the iteration came to, and how."""

    pose: RigidTransform
    """Surface from points."""
    steps: tuple[IterationStep, ...]
    converged: bool
    normal_matrix: Array
    """(6, 6) of turn about the target's origin and shift, of the last step; zero before the first."""
    variance_m2: float
    """Weighted mean square distance at last [m²]."""

    @property
    def linear_rate(self) -> float | None:
        """Median ratio of successive steps in the second half: below 1, and constant where convergence is linear."""
        lengths = np.array([step.step_m for step in self.steps])
        if len(lengths) < 3:
            return None
        ratios = lengths[1:] / np.maximum(lengths[:-1], 1e-300)
        return float(np.median(ratios[len(ratios) // 2 :]))

    @property
    def order(self) -> float | None:
        """Order of convergence: median over three successive steps, by logarithms; 1 linear, 2 quadratic.

        Only of steps that shrink and are above the precision of the numbers.
        """
        lengths = np.array([step.step_m for step in self.steps])
        lengths = lengths[lengths > 1e-11]
        if len(lengths) < 3:
            return None
        logs = np.log(lengths)
        first, second = logs[1:-1] - logs[:-2], logs[2:] - logs[1:-1]
        shrinking = (first < -0.1) & (second < -0.1)
        return float(np.median(second[shrinking] / first[shrinking])) if shrinking.any() else None


@runtime_checkable
class Pairing(Protocol):
    """Pairs points with a surface, as `SurfaceModel.nearest` does."""

    def nearest(self, points: Points, max_distance_m: float) -> tuple[Array, Array]:
        """Give the numbers of the points that have surface near, and of the surface's points."""
        ...


def iterated(
    surface: SurfaceModel,
    points: Points,
    normals: Points,
    start: RigidTransform,
    kind: ErrorKind,
    limits: IterationLimits,
    pairing: Pairing | None = None,
) -> IterationResult:
    """Pair points with the nearest surface, take the best motion, and so on until nothing moves.

    Parameters
    ----------
    surface
        Of the target.
    points, normals
        (n, 3) of the source [m]; normals are used only to leave out pairs.
    start
        Target from source.
    kind
        What is minimised.
    limits
        When points correspond, and when to stop.
    pairing
        What pairs points with the surface, such as a `D2Tree`; None: the nearest points are searched.

    Raises
    ------
    TooFewCorrespondencesError
        When next to nothing lies near the surface.
    """
    steps: list[IterationStep] = []
    pose, converged = start, False
    matrix, variance = np.zeros((6, 6)), 0.0
    while not converged and len(steps) < limits.max_iterations:
        moved = pose.apply(points)
        own, other = (pairing or surface).nearest(moved, limits.max_distance_m)
        if limits.max_angle_rad < np.pi:
            cosines = np.einsum("ij,ij->i", pose.rotation.apply(normals[own]), surface.normals[other])
            own, other = own[cosines > np.cos(limits.max_angle_rad)], other[cosines > np.cos(limits.max_angle_rad)]
        if len(own) < LEAST_PAIRS:
            raise TooFewCorrespondencesError(len(own), LEAST_PAIRS, "points near the surface")
        here = moved[own]
        gaps = here - surface.points[other]
        along = np.einsum("ij,ij->i", gaps, surface.normals[other])
        distances = np.linalg.norm(gaps, axis=1) if kind is ErrorKind.POINT else along
        weights = _weights(distances) if limits.robust else np.ones(len(distances))
        variance = float(weights @ distances**2 / weights.sum())
        if kind is ErrorKind.POINT:
            step = best_motion(surface.points[other], here, weights)
            matrix = _normal_matrix(here, weights)
        else:
            step, matrix = _kinematic_step(surface, other, here, along, weights, kind)
        pose = step * pose
        length = float(np.sqrt(np.mean(np.sum((step.apply(here) - here) ** 2, axis=1))))
        steps.append(IterationStep(variance**0.5, length, len(own)))
        converged = length < limits.least_step_m
    return IterationResult(pose, tuple(steps), converged, matrix, variance)


def _weights(distances_m: Scalars) -> Scalars:
    spread = max(MAD_TO_STD * float(np.median(np.abs(distances_m))), LEAST_SPREAD_M)
    return np.asarray((1.0 + (np.abs(distances_m) / (HALF_WIDTH * spread)) ** 4) ** -2.0)


def _kinematic_step(
    surface: SurfaceModel, other: Array, here: Points, along: Scalars, weights: Scalars, kind: ErrorKind
) -> tuple[RigidTransform, Array]:
    """Solve for the velocity field and move by its helical motion, about the middle of the points."""
    centre: Vector3 = here.mean(axis=0)
    normal = velocity_design(here - centre, surface.normals[other])
    matrix = (normal * weights[:, None]).T @ normal
    right = -normal.T @ (weights * along)
    if kind is ErrorKind.D2:
        stiff = stiffness(along, surface.radii_m[other])
        for k in range(2):
            aside = velocity_design(here - centre, surface.axes[other, k])
            matrix = matrix + (aside * (weights * stiff[:, k])[:, None]).T @ aside
    # what nothing fixes is not moved
    solution = np.linalg.lstsq(matrix, right, rcond=1e-9)[0]
    step = helical_motion(solution[:3], solution[3:])
    there = RigidTransform.from_translation(centre) * step * RigidTransform.from_translation(-centre)
    to_centre = np.eye(6)
    to_centre[3:, :3] = -np.cross(np.eye(3), centre)
    return there, to_centre.T @ matrix @ to_centre


def _normal_matrix(here: Points, weights: Scalars) -> Array:
    matrix = np.zeros((6, 6))
    for axis in np.eye(3):
        design = velocity_design(here, np.broadcast_to(axis, here.shape))
        matrix += (design * weights[:, None]).T @ design
    return matrix
