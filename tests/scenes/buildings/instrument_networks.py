"""Stations of one scanner in a hall, without points: planes through patches that the instrument's errors displace."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.features.planes.plane_responses import plane_responses
from algorithms.geometry.lines import Lines
from algorithms.geometry.planes import Planes
from algorithms.geometry.point_sets import PointSet
from algorithms.network.tracks import StationFeatures, Tracks
from algorithms.scans.instrument_errors import Sweep, drift_polynomials
from algorithms.targets.common_points import TargetSet

PATCHES_A_SIDE = 6
PATCH_STD_M = 0.0005
"""Of the mean of a patch of some m²: noise of its points and waviness of the surface, as seen in well-built halls."""
TARGET_RANGE_STD_M, TARGET_ANGLE_STD_RAD = 0.0003, 1.5e-5
"""Of the centres of targets, which a scanner knows far better than single points."""
BODIES = 12
HALL_M = np.array([28.0, 18.0, 7.0])
SWEEP = Sweep(-np.pi, 2.0 * np.pi)


@dataclass(frozen=True)
class TrueErrors:
    """What is wrong with instrument and tripods."""

    vertical_index_rad: float = 0.0
    range_offset_m: float = 0.0
    range_scale: float = 0.0
    collimation_rad: float = 0.0
    trunnion_rad: float = 0.0
    drifts_rad: tuple[tuple[float, ...], ...] = ()
    """Of each station: tilt about x, about y, heading, change over the scan; then the bends of the same."""


@dataclass(frozen=True, eq=False)
class InstrumentNetwork:
    poses: tuple[RigidTransform, ...]
    features: dict[int, StationFeatures]
    tracks: Tracks

    @property
    def stations(self) -> range:
        return range(len(self.poses))

    @property
    def start(self) -> dict[int, RigidTransform]:
        return {k: self.poses[0].inv() * pose for k, pose in enumerate(self.poses)}


def recorded(arms: np.ndarray, errors: TrueErrors, drift: tuple[float, ...]) -> np.ndarray:
    """Give what an instrument with these errors records of true points about it."""
    times = SWEEP.times(arms)
    steady, bend = drift_polynomials(times)
    turns = np.zeros((2, 3))
    turns.flat[: len(drift)] = drift
    arms = Rotation.from_rotvec(-steady[:, None] * turns[0] - bend[:, None] * turns[1]).apply(arms)
    elevations = np.arctan2(arms[:, 2], np.hypot(arms[:, 0], arms[:, 1]))
    azimuths = np.arctan2(arms[:, 1], arms[:, 0])
    azimuths += errors.collimation_rad / np.cos(elevations) + errors.trunnion_rad * np.tan(elevations)
    ranges = np.linalg.norm(arms, axis=1) * (1.0 + errors.range_scale) + errors.range_offset_m
    elevations += errors.vertical_index_rad
    flat = np.cos(elevations)
    return ranges[:, None] * np.stack([flat * np.cos(azimuths), flat * np.sin(azimuths), np.sin(elevations)], axis=1)


def instrument_network(
    rng: np.random.Generator,
    errors: TrueErrors,
    stations: int = 6,
    *,
    patch_std_m: float = PATCH_STD_M,
    upper: bool = True,
    targets: int = 0,
    planes: bool = True,
) -> InstrumentNetwork:
    """Scan a hall with bodies in it from stations of different height and heading.

    Parameters
    ----------
    rng
        Of noise and places.
    errors
        Of the instrument.
    stations
        How many.
    patch_std_m
        Standard deviation of patches.
    upper
        Whether ceiling and high walls are seen; else everything lies within a metre of the instruments' height.
    targets
        How many survey targets there are all over the hall, without names.
    planes
        Whether planes are tracked; else targets stand for themselves.
    """
    rectangles = _rectangles(upper, rng)
    poses, features, seen_by = [], {}, [[] for _ in rectangles]
    for station in range(stations):
        place = np.array([4.0 + 20.0 * station / max(stations - 1, 1), 4.0 + 9.0 * (station % 2), 1.7])
        place += rng.uniform([-0.5, -0.5, -0.4], [0.5, 0.5, 0.4])
        turn = Rotation.from_rotvec([*rng.normal(0.0, 2e-4, 2), rng.uniform(-np.pi, np.pi)])
        pose = RigidTransform.from_components(place, turn)
        drift = errors.drifts_rad[station] if errors.drifts_rad else (0.0, 0.0, 0.0)
        rows = []
        for number, (middle, axes, sizes) in enumerate(rectangles):
            normal = np.cross(axes[:, 0], axes[:, 1])
            if (place - middle) @ normal < 0.5:
                continue
            seen_by[number].append((station, len(rows)))
            rows.append(_plane(middle, axes, sizes, pose, errors, drift, patch_std_m, rng))
        features[station] = _features(rows)
        poses.append(pose)
    tracks = tuple(tuple(members) for members in seen_by if len(members) > 1) if planes else ()
    points: tuple[tuple[tuple[int, int], ...], ...] = ()
    if targets:
        places = rng.uniform(
            [1.0, 1.0, 0.3], HALL_M * [1.0, 1.0, 1.0 if upper else 0.35] - [1.0, 1.0, 0.3], (targets, 3)
        )
        for station, pose in enumerate(poses):
            drift = errors.drifts_rad[station] if errors.drifts_rad else (0.0, 0.0, 0.0)
            seen = _targets(places, pose, errors, drift, rng)
            features[station] = replace(features[station], targets=seen)
        points = tuple(tuple((station, k) for station in range(stations)) for k in range(targets))
    return InstrumentNetwork(tuple(poses), features, Tracks(tracks, (), 0, 0, 0, points))


def _targets(places, pose, errors, drift, rng) -> TargetSet:
    """Measure targets: ranges to `TARGET_RANGE_STD_M`, directions to `TARGET_ANGLE_STD_RAD`."""
    true = pose.inv().apply(places)
    beams = true / np.linalg.norm(true, axis=1, keepdims=True)
    along = beams[:, :, None] * beams[:, None, :]
    across_m = TARGET_ANGLE_STD_RAD * np.linalg.norm(true, axis=1)[:, None, None]
    covariances = TARGET_RANGE_STD_M**2 * along + across_m**2 * (np.eye(3) - along)
    noise = np.einsum("nij,nj->ni", np.linalg.cholesky(covariances), rng.normal(size=true.shape))
    return TargetSet((None,) * len(places), PointSet(recorded(true, errors, drift) + noise, covariances))


def _rectangles(upper: bool, rng: np.random.Generator) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Give middles, axes and sides: the hall from inside, bodies on its floor from outside, and a sloping roof."""
    height = HALL_M[2] if upper else 2.4
    found = _faces(np.array([*HALL_M[:2], height]) / 2.0, np.array([*HALL_M[:2], height]), Rotation.identity(), -1.0)
    for _ in range(BODIES):
        size = rng.uniform([0.5, 0.4, 1.5], [2.5, 1.2, 0.6 * height + 1.0])
        middle = np.append(rng.uniform([2.0, 6.2], [26.0, 11.0]), 0.5 * size[2])
        found += _faces(middle, size, Rotation.from_rotvec([0.0, 0.0, rng.uniform(0.0, 3.0)]), 1.0)[:4]
    for side in (-1.0, 1.0):
        slope = np.stack([[0.0, side, 0.0], [-np.cos(0.6), 0.0, -side * np.sin(0.6)]], axis=1)
        found.append((np.array([14.0 + 5.0 * side, 9.0, height - 1.0]), slope, np.array([16.0, 3.0])))
    return found


def _faces(middle, size, turn, sense):
    """Give the faces of a box, side walls first."""
    found = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            axes, sizes = np.eye(3)[:, [(axis + 1) % 3, (axis + 2) % 3]], size[[(axis + 1) % 3, (axis + 2) % 3]]
            if sense * side < 0.0:
                axes, sizes = axes[:, ::-1], sizes[::-1]
            found.append((middle + turn.apply(0.5 * side * size[axis] * np.eye(3)[axis]), turn.apply(axes.T).T, sizes))
    return found


def _plane(middle, axes, sizes, pose, errors, drift, patch_std_m, rng):
    """Fit a plane to displaced patches: normal, centroid, basis, covariance, response."""
    steps = (np.arange(PATCHES_A_SIDE) + 0.5) / PATCHES_A_SIDE - 0.5
    u, v = (grid.ravel() for grid in np.meshgrid(steps * sizes[0], steps * sizes[1]))
    true = pose.inv().apply(middle + u[:, None] * axes[:, 0] + v[:, None] * axes[:, 1])
    points = recorded(true, errors, drift)
    station_axes = pose.rotation.inv().apply(axes.T).T
    normal = np.cross(station_axes[:, 0], station_axes[:, 1])
    points = points + rng.normal(0.0, patch_std_m, len(points))[:, None] * normal
    centroid = true.mean(axis=0)
    for _ in range(2):
        arms = points - centroid
        jacobian = np.column_stack([-arms @ station_axes, np.ones(len(arms))])
        a1, a2, b = np.linalg.lstsq(jacobian, arms @ normal, rcond=None)[0]
        moved = centroid + b * normal
        normal = normal + station_axes @ [a1, a2]
        normal /= np.linalg.norm(normal)
        first = station_axes[:, 0] - normal * (station_axes[:, 0] @ normal)
        first /= np.linalg.norm(first)
        station_axes, centroid = np.stack([first, np.cross(normal, first)], axis=1), moved
    arms = points - centroid
    jacobian = np.column_stack([-arms @ station_axes, np.ones(len(arms))])
    weights = np.full(len(points), patch_std_m**-2)
    response = plane_responses(points, normal[None], jacobian, weights, np.array([0, len(points)]), SWEEP)[0]
    return normal, centroid, station_axes, np.linalg.inv(jacobian.T @ jacobian) * patch_std_m**2, response, sizes


def _features(rows) -> StationFeatures:
    normals, centroids, bases, covariances, responses, sizes = (np.array(column) for column in zip(*rows, strict=True))
    count = len(normals)
    planes = Planes(
        normals,
        centroids,
        bases,
        covariances,
        np.full(count, PATCH_STD_M),
        np.full(count, 36, dtype=np.int64),
        sizes.prod(axis=1),
        np.empty((0, 2)),
        np.zeros(count + 1, dtype=np.int64),
    )
    return StationFeatures(planes, Lines.empty(), plane_responses=responses, sensor_m=np.zeros(3), sweep=SWEEP)
