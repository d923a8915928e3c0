"""Poses of stations from two adjustments: to the lines and planes they share, and to the registrations of pairs.

The first knows that a wall seen by five stations is one wall, the second knows the surfaces, which in thin scans tell
far more than lines and planes do. Both rest on the same scans, so neither adds to the other: of the two only a mixture
counts (covariance intersection, Julier and Uhlmann 1997), mixed as the registrations of the pairs found it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg, stats
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.solver import Solution
from algorithms.arrays import Array
from algorithms.geometry.poses import PoseEstimate
from algorithms.network.joint_adjustment import JointAdjustment
from algorithms.network.links import StationLink

CONTRADICTION_ALPHA = 0.001
"""Probability with which two good estimates are taken to contradict each other."""
LEAST_SHARE = 0.01
"""An adjustment with less of the information is left out: what little it tells is not worth its errors."""


@dataclass(frozen=True, eq=False)
class FusedStations:
    """Poses of all stations but the first, in its frame."""

    poses: tuple[PoseEstimate, ...]
    """In the order of the stations."""
    feature_share: float
    """Weight of the adjustment to lines and planes, 0..1; the rest is that of the registrations."""
    factor: float
    """By which covariances were multiplied because the two adjustments differ by more than chance; 1: they do not."""
    covariance: Array
    """(6 k, 6 k) of all of them."""


def with_shared_scans(links: Sequence[StationLink]) -> list[StationLink]:
    """Enlarge the covariances of registrations, because those of stations that a third one sees too share its errors.

    k scans that all see the same surface have k errors, but k (k - 1)/2 registrations, each with the errors of two
    scans. Taken as independent these would make the poses better by k/2 than they are. Two stations registered with t
    further ones stand for k = 2 + t, so that variances grow by 1 + t/2: exact where all see the same surface, too much
    where they see different surfaces, and nothing in chains.

    Parameters
    ----------
    links
        Registrations.
    """
    neighbours: dict[int, set[int]] = {}
    for link in links:
        neighbours.setdefault(link.target, set()).add(link.source)
        neighbours.setdefault(link.source, set()).add(link.target)
    return [
        link.with_covariance_scaled(1.0 + 0.5 * len(neighbours[link.target] & neighbours[link.source]))
        for link in links
    ]


def share_of_features(links: Sequence[StationLink]) -> float:
    """Give the mean share of the information that lines and planes have in registrations; below 1 % none."""
    share = float(np.mean([link.feature_share for link in links]))
    return share if share >= LEAST_SHARE else 0.0


def fused_stations(joint: JointAdjustment | None, graph: Solution, share: float) -> FusedStations:
    """Mix the poses of the two adjustments: N = ω N1 + (1 - ω) N2, which never promises too much. O(n³) for n stations.

    Parameters
    ----------
    joint
        Of lines and planes; None, or not settled: the poses are those of the registrations.
    graph
        Of the registrations, the same stations in the same order.
    share
        ω.
    """
    base = [graph.unknowns.poses[k] for k in range(1, len(graph.unknowns.poses))]
    size = 6 * len(base)
    if joint is None or not joint.solution.converged or share < LEAST_SHARE:
        alone = graph.cofactors[:size, :size]
        return FusedStations(_estimates(base, np.zeros(size), alone), 0.0, 1.0, alone)
    away = np.concatenate(
        [_motion(joint.pose(station), own) for station, own in zip(joint.stations[1:], base, strict=True)]
    )
    features = joint.solution.cofactors[:size, :size] * joint.variance_factor
    if share > 1.0 - LEAST_SHARE:
        return FusedStations(_estimates(base, away, features), 1.0, 1.0, features)
    registrations = graph.cofactors[:size, :size]
    differing = float(away @ linalg.solve(features + registrations, away, assume_a="pos"))
    factor = differing / size if differing > stats.chi2.isf(CONTRADICTION_ALPHA, size) else 1.0
    known = share * linalg.inv(features)
    normal = known + (1.0 - share) * linalg.inv(registrations)
    mixed = linalg.solve(normal, known @ away, assume_a="sym")
    covariance = linalg.inv(normal) * factor
    return FusedStations(_estimates(base, mixed, covariance), share, factor, covariance)


def _motion(pose: RigidTransform, base: RigidTransform) -> Array:
    turn = (pose.rotation * base.rotation.inv()).as_rotvec()
    return np.concatenate([turn, np.asarray(pose.translation) - np.asarray(base.translation)])


def _estimates(base: Sequence[RigidTransform], motions: Array, covariance: Array) -> tuple[PoseEstimate, ...]:
    found = []
    for k, pose in enumerate(base):
        own = slice(6 * k, 6 * k + 6)
        turn, shift = np.split(motions[own], 2)
        moved = RigidTransform.from_components(
            np.asarray(pose.translation) + shift, Rotation.from_rotvec(turn) * pose.rotation
        )
        found.append(PoseEstimate(moved, covariance[own, own]))
    return tuple(found)
