"""Stations are chained along the best links."""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.geometry.poses import PoseEstimate
from algorithms.network.spanning_tree import StationLink, chain_poses


def pose(x: float, variance: float) -> PoseEstimate:
    motion = RigidTransform.from_components([x, 0.0, 0.0], Rotation.from_rotvec([0.0, 0.0, 0.3]))
    return PoseEstimate(motion, np.eye(6) * variance)


def test_a_station_without_accepted_pair_is_left_out() -> None:
    assert set(chain_poses(["A", "B", "C"], [StationLink("A", "B", pose(1.0, 1e-6))])) == {"A", "B"}


def test_the_better_path_is_taken_and_its_variances_grow_along_it() -> None:
    links = [
        StationLink("A", "B", pose(1.0, 1e-6)),
        StationLink("B", "C", pose(2.0, 1e-6)),
        StationLink("A", "C", pose(99.0, 1.0)),
    ]
    poses = chain_poses(["A", "B", "C"], links)
    expected = links[0].target_from_source.target_from_source * links[1].target_from_source.target_from_source
    np.testing.assert_allclose(poses["C"].target_from_source.as_matrix(), expected.as_matrix(), atol=1e-12)
    assert np.trace(poses["C"].covariance) > np.trace(poses["B"].covariance)


def test_a_link_given_the_other_way_round_is_inverted() -> None:
    direct = chain_poses(["A", "B"], [StationLink("A", "B", pose(1.0, 1e-6))])["B"]
    inverted = chain_poses(["A", "B"], [StationLink("B", "A", pose(1.0, 1e-6).inverse())])["B"]
    np.testing.assert_allclose(
        inverted.target_from_source.as_matrix(), direct.target_from_source.as_matrix(), atol=1e-12
    )
