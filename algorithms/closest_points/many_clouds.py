"""Iterative closest points of many clouds at once: every round pairs all clouds anew and moves them together."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Points
from algorithms.closest_points.iteration import HALF_WIDTH, MAD_TO_STD
from algorithms.closest_points.simultaneous import CloudPairs, orient_simultaneously
from algorithms.errors import TooFewCorrespondencesError
from algorithms.progress import Progress

LEAST_PAIRS = 12
"""Pairs of two clouds below which these are no neighbours."""
LEAST_SPREAD_M = 1e-9


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points of one station with their normals."""

    name: str
    points: Points
    """(n, 3) in a frame of its own [m]."""
    normals: Points
    """(n, 3) unit normals; zero where the points are no surface: such points take no part."""


@dataclass(frozen=True)
class RoundFigures:
    """One round."""

    misfit_m: float
    """Weighted rms distance along the normals before it [m]."""
    step_m: float
    """Largest rms displacement of a cloud by it [m]."""
    pairs: int


@dataclass(frozen=True, eq=False)
class OrientedClouds:
    """Where all clouds came to."""

    world_from_cloud: tuple[RigidTransform, ...]
    rounds: tuple[RoundFigures, ...]
    neighbours: tuple[tuple[int, int], ...]
    """Which clouds had pairs, or ties, at last."""
    converged: bool


def orient_clouds(
    clouds: Sequence[Cloud],
    starts: Sequence[RigidTransform],
    *,
    fixed: Collection[int],
    ties: Sequence[CloudPairs] = (),
    max_distance_m: float,
    max_angle_rad: float,
    max_rounds: int,
    least_step_m: float,
    progress: Progress,
) -> OrientedClouds:
    """Move all clouds but the fixed ones until they lie on each other (Hofer and Pottmann 2004, equations 15 to 19).

    Distances count along the normals (as in their equation 20 for two clouds), large ones less (robust weights).

    Parameters
    ----------
    clouds, starts
        Two or more, and world from each.
    fixed
        Numbers of those that stay, at least one.
    ties
        Correspondences that stay the same in all rounds, such as details found in photos.
    max_distance_m, max_angle_rad
        Points farther apart, or whose normals differ by more, are no pair.
    max_rounds, least_step_m
        When to stop.
    progress
        Is told the rounds.

    Raises
    ------
    TooFewCorrespondencesError
        A cloud that may move lies on no other.
    DegenerateGeometryError
        The pairs leave a motion of a cloud free.
    """
    trees = [cKDTree(cloud.points) for cloud in clouds]
    poses, rounds = tuple(starts), list[RoundFigures]()
    pairs: list[CloudPairs] = []
    while len(rounds) < max_rounds and (not rounds or rounds[-1].step_m >= least_step_m):
        progress.report(len(rounds) / max_rounds, "moving the clouds")
        pairs = [
            found
            for i, j in permutations(range(len(clouds)), 2)
            if (found := _pairs(clouds, trees, poses, i, j, max_distance_m, max_angle_rad)) is not None
        ]
        pairs += ties
        met = {number for each in pairs for number in (each.first, each.second)}
        for number, cloud in enumerate(clouds):
            if number not in met and number not in fixed:
                raise TooFewCorrespondencesError(0, LEAST_PAIRS, f"points of {cloud.name} near another cloud")
        moved = orient_simultaneously(pairs, poses, fixed=fixed, max_iterations=1)
        count = sum(len(each.points) for each in pairs)
        rounds.append(RoundFigures(moved.misfits_m[0], moved.steps_m[0], count))
        poses = moved.world_from_cloud
    neighbours = tuple(sorted({(min(each.first, each.second), max(each.first, each.second)) for each in pairs}))
    return OrientedClouds(poses, tuple(rounds), neighbours, bool(rounds and rounds[-1].step_m < least_step_m))


def _pairs(
    clouds: Sequence[Cloud],
    trees: Sequence[cKDTree],
    poses: Sequence[RigidTransform],
    first: int,
    second: int,
    max_distance_m: float,
    max_angle_rad: float,
) -> CloudPairs | None:
    """Pair the points of the first cloud with the nearest ones of the second; None for clouds far apart."""
    between = poses[second].inv() * poses[first]
    there = between.apply(clouds[first].points)
    distances, found = trees[second].query(there, distance_upper_bound=max_distance_m)
    near = np.flatnonzero(np.isfinite(distances))
    if len(near) < LEAST_PAIRS:
        return None
    found = np.asarray(found)[near]
    normals = clouds[second].normals[found]
    cosines = np.abs(np.einsum("ij,ij->i", between.rotation.apply(clouds[first].normals[near]), normals))
    alike = cosines > np.cos(max_angle_rad)
    near, found, normals = near[alike], found[alike], normals[alike]
    if len(near) < LEAST_PAIRS:
        return None
    along = np.abs(np.einsum("ij,ij->i", there[near] - clouds[second].points[found], normals))
    spread = max(MAD_TO_STD * float(np.median(along)), LEAST_SPREAD_M)
    weights = (1.0 + (along / (HALF_WIDTH * spread)) ** 4) ** -2.0
    return CloudPairs(
        first, second, clouds[first].points[near], clouds[second].points[found], np.asarray(weights), normals
    )
