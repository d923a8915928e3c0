"""Poses of stations from two adjustments: to the lines and planes they share, and to the registrations of pairs.

The first knows that a wall seen by five stations is one wall, the second knows the surfaces, which in thin scans tell
far more than lines and planes do. Both rest on the same scans, so neither adds to the other: of the two only a mixture
counts (covariance intersection, Julier and Uhlmann 1997), mixed as the registrations of the pairs found it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy import sparse
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.inverse import Information, Inverse
from algorithms.adjustment.problem import Problem
from algorithms.adjustment.solver import Solution
from algorithms.adjustment.weights import whitening_of
from algorithms.arrays import Array, Matrix
from algorithms.geometry.poses import PoseEstimate
from algorithms.geometry.rotations import cross_matrices
from algorithms.network.joint_adjustment import JointAdjustment
from algorithms.network.links import StationLink
from algorithms.network.pose_graph import observed_links
from algorithms.probabilities import chi2_isf

CONTRADICTION_ALPHA = 0.001
"""Probability with which two good estimates are taken to contradict each other."""
LEAST_SHARE = 0.01
"""An adjustment with less of the information is left out: what little it tells is not worth its errors."""


@dataclass(frozen=True, eq=False)
class StationCovariances:
    """Covariances of the poses of k stations: those of each, and all together where that is asked for."""

    inverse: Inverse
    """Of normal equations whose first 6 k unknowns are the poses."""
    count: int
    """k."""
    factor: float
    """Variance factor."""

    def of_each(self) -> Float64[Array, "k 6 6"]:
        """Give the covariance of every pose by itself."""
        return np.asarray(self.factor * self.inverse.blocks(np.arange(6 * self.count).reshape(-1, 6)))

    def together(self) -> Matrix:
        """Give the covariance (6 k, 6 k) of all poses. O(k²) of memory."""
        return np.asarray(self.factor * self.inverse.whole()[: 6 * self.count, : 6 * self.count])

    def scaled(self, factor: float) -> "StationCovariances":
        """Multiply them by a factor."""
        return StationCovariances(self.inverse, self.count, self.factor * factor)


@dataclass(frozen=True, eq=False)
class FusedStations:
    """Poses of all stations but the first, in its frame."""

    poses: tuple[PoseEstimate, ...]
    """In the order of the stations."""
    feature_share: float
    """Weight of the adjustment to lines and planes, 0..1; the rest is that of the registrations."""
    factor: float
    """By which covariances were multiplied because the two adjustments differ by more than chance; 1: they do not."""
    covariances: StationCovariances
    """Of all of them."""


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


def fused_stations(
    joint: JointAdjustment | None,
    graph: Solution,
    share: float,
    links: Sequence[StationLink] = (),
    stations: Sequence[int] = (),
) -> FusedStations:
    """Mix the poses of the two adjustments: N = ω N1 + (1 - ω) N2, which never promises too much (MATH 6.6).

    N1 and N2 are the normal equations, which many stations leave sparse; mounts of photos, which only the first has,
    stay among its unknowns. Stations that the first leaves open are attached to its own by the registrations that touch
    them, which so count whole.

    Parameters
    ----------
    joint
        Of lines and planes; None, or not settled: the poses are those of the registrations.
    graph
        Of the registrations.
    share
        ω.
    links
        The registrations of the graph.
    stations
        Its stations in their order; none: those of `joint`.
    """
    base = [graph.unknowns.poses[k] for k in range(1, len(graph.unknowns.poses))]
    size = 6 * len(base)
    if joint is None or not joint.solution.converged or share < LEAST_SHARE:
        alone = StationCovariances(graph.inverse, len(base), 1.0)
        return FusedStations(_estimates(base, np.zeros(size), alone), 0.0, 1.0, alone)
    only_features = share > 1.0 - LEAST_SHARE
    if set(stations) <= set(joint.stations):
        adjusted = [joint.solution.unknowns.poses[k] for k in range(1, len(base) + 1)]
        away = np.concatenate([_motion(pose, own) for pose, own in zip(adjusted, base, strict=True)])
        if only_features:
            features = StationCovariances(joint.solution.inverse, len(base), joint.variance_factor)
            return FusedStations(_estimates(base, away, features), 1.0, 1.0, features)
        known = joint.solution.information.scaled(1.0 / joint.variance_factor)
        told = _reduced(known, away)
    else:
        known, told = _with_attached(joint, graph, links, stations)
        inverse = known.inverse()
        away = inverse.times(told)[:size]
        if only_features:
            features = StationCovariances(inverse, len(base), 1.0)
            return FusedStations(_estimates(base, away, features), 1.0, 1.0, features)
    registered = np.concatenate([graph.information.times(away), np.zeros(len(told) - size)])
    # (C1 + C2)⁻¹ = N1 (N1 + N2)⁻¹ N2
    both = known.mixed(1.0, graph.information, 1.0).inverse()
    differing, degrees = float(told @ both.times(registered)), 6 * (len(joint.stations) - 1)
    factor = differing / degrees if differing > chi2_isf(CONTRADICTION_ALPHA, degrees) else 1.0
    mixture = known.mixed(share, graph.information, 1.0 - share).inverse()
    covariances = StationCovariances(mixture, len(base), factor)
    return FusedStations(_estimates(base, mixture.times(share * told)[:size], covariances), share, factor, covariances)


def _with_attached(
    joint: JointAdjustment, graph: Solution, links: Sequence[StationLink], stations: Sequence[int]
) -> tuple[Information, Array]:
    """Give N1 of all stations, those that lines and planes leave open by the registrations that touch them, and N1 x.

    x are the motions from the poses of the graph, followed by the errors of mounts.
    """
    inside = set(joint.stations)
    size, mounts = 6 * (len(stations) - 1), joint.solution.unknowns.count - 6 * (len(joint.stations) - 1)
    carried = _carried(joint, graph, stations, mounts)
    place = {station: k for k, station in enumerate(stations)}
    of_graph = [graph.unknowns.poses[place[station]] for station in joint.stations]
    to_own = of_graph[0].inv()
    away = np.concatenate([
        _motion(joint.solution.unknowns.poses[k], to_own * of_graph[k]) for k in range(1, len(of_graph))
    ])  # fmt: skip
    own = joint.solution.information.scaled(1.0 / joint.variance_factor)
    touching = [link for link in links if not inside.issuperset(link.stations)]
    system = Problem((observed_links(touching, stations),)).linearised(graph.unknowns)
    whitening = whitening_of(system)
    jacobian = sparse.csr_array(whitening.matrix @ system.jacobian)
    told = carried.T @ _reduced(own, away)
    told[:size] -= jacobian.T @ whitening.apply(system.residuals)
    known = Information(sparse.csc_array(carried.T @ sparse.csc_array(own.matrix) @ carried))
    return known.mixed(1.0, Information(sparse.csc_array(jacobian.T @ jacobian)), 1.0), np.asarray(told)


def _carried(joint: JointAdjustment, graph: Solution, stations: Sequence[int], mounts: int) -> sparse.csr_array:
    """Say how the unknowns of an adjustment of some stations answer to those of all of them.

    P = P_f⁻¹ P_k in the frame of its fixed station f: turns by R_fᵀ (w_k - w_f), shifts by
    R_fᵀ (d_k - d_f + S(t_k - t_f) w_f).
    """
    place = {station: k for k, station in enumerate(stations)}
    at = np.array([place[station] for station in joint.stations], dtype=np.int64)
    matrices = np.asarray(graph.unknowns.poses.as_matrix())[at]
    back, apart = matrices[0, :3, :3].T, matrices[1:, :3, 3] - matrices[0, :3, 3]
    count, size = len(apart), 6 * (len(stations) - 1)
    turned = np.kron(np.eye(2), back)
    by_fixed = np.tile(-turned, (count, 1, 1))
    by_fixed[:, 3:, :3] = back @ cross_matrices(apart)
    rows = np.broadcast_to((6 * np.arange(count)[:, None] + np.arange(6))[:, :, None], (count, 6, 6)).ravel()
    columns, values = [], []
    for first, blocks in ((at[1:], np.tile(turned, (count, 1, 1))), (np.repeat(at[:1], count), by_fixed)):
        if (first > 0).all():  # the first station of all has no unknowns
            columns.append(np.broadcast_to(6 * (first[:, None, None] - 1) + np.arange(6), (count, 6, 6)).ravel())
            values.append(blocks.ravel())
    entries = (np.concatenate(values), (np.tile(rows, len(values)), np.concatenate(columns)))
    poses = sparse.coo_array(entries, shape=(6 * count, size))
    return sparse.csr_array(sparse.block_diag([poses, sparse.eye_array(mounts)]) if mounts else poses)


def _reduced(known: Information, away: Array) -> Array:
    """Give N1 times a motion of the stations, mounts of photos eliminated; zero for these (MATH 6.4)."""
    u, size = known.matrix.shape[0], len(away)
    motion = np.concatenate([away, np.zeros(u - size)])
    if u > size:
        mounts = Information(known.matrix[size:, size:])
        motion[size:] = -mounts.inverse().times(known.times(motion)[size:])
    told = known.times(motion)
    told[size:] = 0.0
    return told


def _motion(pose: RigidTransform, base: RigidTransform) -> Array:
    turn = (pose.rotation * base.rotation.inv()).as_rotvec()
    return np.concatenate([turn, np.asarray(pose.translation) - np.asarray(base.translation)])


def _estimates(
    base: Sequence[RigidTransform], motions: Array, covariances: StationCovariances
) -> tuple[PoseEstimate, ...]:
    found = []
    for pose, motion, own in zip(base, motions.reshape(-1, 6), covariances.of_each(), strict=True):
        turn, shift = motion[:3], motion[3:]
        moved = RigidTransform.from_components(
            np.asarray(pose.translation) + shift, Rotation.from_rotvec(turn) * pose.rotation
        )
        found.append(PoseEstimate(moved, own))
    return tuple(found)
