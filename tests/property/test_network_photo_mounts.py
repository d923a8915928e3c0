"""Lines of one photo share the error of its mount; in a network of stations averaging does not make it vanish."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import RigidTransform

from algorithms.geometry.lines import Lines, LineSource
from algorithms.geometry.planes import Planes
from algorithms.geometry.poses import PoseEstimate
from algorithms.geometry.rotations import cross_matrices
from algorithms.network.joint_adjustment import JointAdjustment
from algorithms.network.links import StationLink
from algorithms.network.network_registration import register_network
from algorithms.network.tracks import StationFeatures
from tests.scenes.lines.line_scenes import generic_lines, observed_lines, pose_error, random_motion

pytestmark = pytest.mark.slow

STATIONS, LINES, NETWORKS = 3, 14, 12
MOUNT = np.diag(np.square([1e-3, 1e-3, 1e-3, 4e-3, 4e-3, 4e-3]))
NO_PLANES = Planes(
    np.empty((0, 3)),
    np.empty((0, 3)),
    np.empty((0, 3, 2)),
    np.empty((0, 3, 3)),
    np.empty(0),
    np.empty(0, dtype=np.int64),
    np.empty(0),
    np.empty((0, 2)),
    np.zeros(1, dtype=np.int64),
)


def of_photo(lines: Lines, rng: np.random.Generator, shown: np.ndarray) -> Lines:
    """Let some lines come from a photo whose mount is wrong by a draw from its covariance."""
    across = np.swapaxes(lines.bases, 1, 2)
    jacobians = np.zeros((len(lines), 4, 6))
    jacobians[:, :2, :3] = -across @ cross_matrices(lines.directions)
    jacobians[:, 2:, :3] = -across @ cross_matrices(lines.anchors)
    jacobians[:, 2:, 3:] = across
    jacobians[~shown] = 0.0
    moved = jacobians @ (np.sqrt(np.diag(MOUNT)) * rng.normal(size=6))
    directions = lines.directions + np.einsum("nij,nj->ni", lines.bases, moved[:, :2])
    return replace(
        lines,
        directions=directions / np.linalg.norm(directions, axis=1, keepdims=True),
        anchors=lines.anchors + np.einsum("nij,nj->ni", lines.bases, moved[:, 2:]),
        covariances=lines.covariances + jacobians @ MOUNT @ np.swapaxes(jacobians, 1, 2),
        sources=np.where(shown, int(LineSource.PHOTO_EDGE), int(LineSource.CYLINDER_AXIS)).astype(np.int32),
        photos=np.where(shown, 0, -1).astype(np.int32),
        photo_jacobians=jacobians,
    )


def adjusted(rng: np.random.Generator, photo_share: float) -> tuple[JointAdjustment, list[RigidTransform]]:
    scene = generic_lines(rng, LINES)
    poses, features = [], {}
    for k in range(STATIONS):
        pose = random_motion(rng, 3.0)
        lines = observed_lines(
            pose.apply(scene.points), pose.rotation.apply(scene.directions), rng, 0.003, fitted=False
        )
        shown = np.arange(LINES) < round(photo_share * LINES)
        features[k] = StationFeatures(NO_PLANES, of_photo(lines, rng, shown), MOUNT[None])
        poses.append(pose.inv())
    pairs = np.repeat(np.arange(LINES, dtype=np.int64)[:, None], 2, axis=1)
    links = [
        StationLink(
            target,
            source,
            PoseEstimate(poses[target].inv() * poses[source], 1e-6 * np.eye(6)),
            pairs,
            np.empty((0, 2), dtype=np.int64),
            np.zeros(3),
            3.0,
            0.003,
        )
        for target, source in ((0, 1), (0, 2), (1, 2))
    ]
    joint = register_network(features, links, ["A", "B", "C"]).joint
    assert joint is not None
    return joint, [poses[0].inv() * pose for pose in poses]


def mean_normalised_error(photo_share: float, seed: int) -> float:
    rng = np.random.default_rng(seed)
    values = []
    for _ in range(NETWORKS):
        joint, truth = adjusted(rng, photo_share)
        error = np.concatenate([pose_error(joint.pose(k), truth[k]) for k in range(1, STATIONS)])
        of_poses = joint.solution.cofactors[: len(error), : len(error)]
        values.append(error @ np.linalg.solve(of_poses, error) / len(error))
    return float(np.mean(values))


def test_poses_by_lines_of_photos_alone_are_as_uncertain_as_the_mounts() -> None:
    freedom = 6 * (STATIONS - 1) * NETWORKS
    low, high = stats.chi2.ppf([0.0005, 0.9995], freedom) / freedom
    assert low < mean_normalised_error(1.0, seed=1) < high
    joint, _ = adjusted(np.random.default_rng(2), 1.0)
    # two mounts of 1 mrad each stand between the stations
    assert np.sqrt(joint.covariance(1)[0, 0]) > np.sqrt(2.0) * 1e-3


def test_lines_of_scans_and_of_photos_together_are_as_good_as_they_say() -> None:
    freedom = 6 * (STATIONS - 1) * NETWORKS
    low, high = stats.chi2.ppf([0.0005, 0.9995], freedom) / freedom
    assert low < mean_normalised_error(0.5, seed=3) < high


def test_the_error_of_a_mount_is_found_by_what_the_scan_sees() -> None:
    joint, _ = adjusted(np.random.default_rng(4), 0.5)
    mounts = joint.solution.cofactors[-6:, -6:]
    assert (np.diag(mounts) < 0.5 * np.diag(MOUNT)).all()
    assert joint.solution.redundancy == joint.observation_count - 6 * (STATIONS - 1) - 6 * STATIONS
