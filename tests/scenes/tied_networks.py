"""Simulated networks of stations with targets, scans' registrations and control points."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.hybrid.joint_poses import JointPoses, joint_poses
from algorithms.adjustment.hybrid.station_frames import relative_to
from algorithms.adjustment.hybrid.tied_stations import KnownPoints, SeenPoints, TiedStations

TARGET_STD_M, CONTROL_STD_M = 0.002, 0.003


@dataclass(frozen=True, eq=False)
class TiedScene:
    """A network and the truth."""

    problem: TiedStations
    poses: tuple[RigidTransform, ...]
    points: np.ndarray
    """(n, 3) true places of the points [m]."""


def tied_scene(
    rng: np.random.Generator, *, stations: int = 4, control: int = 5, ties: int = 4, scans: bool = True
) -> TiedScene:
    """Set stations up in a site of 60 m, each of which sees about three quarters of the points."""
    points = np.column_stack([rng.uniform(-30.0, 30.0, (control + ties, 2)), rng.uniform(0.0, 8.0, control + ties)])
    poses = tuple(
        RigidTransform.from_components(
            np.array([*rng.uniform(-20.0, 20.0, 2), 1.5]),
            Rotation.from_euler("ZYX", [rng.uniform(-np.pi, np.pi), *rng.normal(0.0, 0.02, 2)]),
        )
        for _ in range(stations)
    )
    seen_by, seen = [], []
    for station in range(stations):
        visible = np.flatnonzero(rng.random(len(points)) < 0.75)
        seen_by += [station] * len(visible)
        seen += visible.tolist()
    for point in range(len(points)):  # every point is seen twice at least
        for station in range(stations):
            if sum(p == point for p in seen) < 2 and (station, point) not in zip(seen_by, seen, strict=True):
                seen_by.append(station)
                seen.append(point)
    at, of = np.array(seen_by, dtype=np.int64), np.array(seen, dtype=np.int64)
    exact = np.array([poses[s].inv().apply(points[p]) for s, p in zip(at, of, strict=True)])
    covariances = np.array([_along_and_across(place) for place in exact])
    values = exact + np.einsum("nij,nj->ni", np.linalg.cholesky(covariances), rng.normal(size=exact.shape))
    known = np.arange(control)
    stds = CONTROL_STD_M * np.array([1.0, 1.0, 2.0])
    given = points[known] + stds * rng.normal(size=(control, 3))
    observed: tuple[JointPoses, ...] = (registered_scans(rng, poses),) if scans else ()
    problem = TiedStations(
        SeenPoints(at, of, values, covariances),
        KnownPoints(known, given, np.tile(np.diag(stds**2), (control, 1, 1))),
        observed,
    )
    return TiedScene(problem, poses, points)


def registered_scans(rng: np.random.Generator, poses: tuple[RigidTransform, ...]) -> JointPoses:
    """Register all stations to the first, with errors that are correlated between them."""
    k = len(poses) - 1
    mixed = np.eye(6 * k) + 0.3 * rng.normal(size=(6 * k, 6 * k)) / np.sqrt(6 * k)
    stds = np.tile([1e-4, 1e-4, 1e-4, 0.003, 0.003, 0.003], k)
    root = stds[:, None] * mixed
    error = root @ rng.normal(size=6 * k)
    relative, _ = relative_to(poses, np.zeros((6 * (k + 1), 6 * (k + 1))), 0)
    noisy = {
        number: RigidTransform.from_components(
            np.asarray(pose.translation) + error[6 * j + 3 : 6 * j + 6],
            Rotation.from_rotvec(error[6 * j : 6 * j + 3]) * pose.rotation,
        )
        for j, (number, pose) in enumerate(list(enumerate(relative))[1:])
    }
    return joint_poses(0, noisy, root @ root.T)


def motion_errors(found: tuple[RigidTransform, ...], truth: tuple[RigidTransform, ...]) -> np.ndarray:
    """Give (6 p,) rotation vectors on the left and translations from the true poses to those found."""
    return np.concatenate([
        np.concatenate([
            (a.rotation * b.rotation.inv()).as_rotvec(), np.asarray(a.translation) - np.asarray(b.translation)
        ])
        for a, b in zip(found, truth, strict=True)
    ])  # fmt: skip


def _along_and_across(place: np.ndarray) -> np.ndarray:
    beam = place / np.linalg.norm(place)
    along = np.outer(beam, beam)
    return TARGET_STD_M**2 * along + (0.5 * TARGET_STD_M) ** 2 * (np.eye(3) - along)
