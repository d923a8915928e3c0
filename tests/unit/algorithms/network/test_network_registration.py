"""Many stations: what one adjustment of all makes of registered pairs."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.solver import Solution, solve
from algorithms.geometry.poses import PoseEstimate
from algorithms.network import joint_adjustment
from algorithms.network.joint_adjustment import JointAdjustment
from algorithms.network.network_registration import NetworkRegistration, register_network
from algorithms.network.pose_graph import chained_parts
from algorithms.network.track_observations import TrackKind, largest_first
from algorithms.network.tracks import build_tracks
from tests.scenes.buildings.city_block import city_block
from tests.scenes.buildings.station_networks import StationNetwork, station_network
from tests.scenes.lines.line_scenes import KEEP_ALL, pose_error

MILLIMETRE = 1e-3


def registered(network: StationNetwork) -> NetworkRegistration:
    return register_network(network.features, network.links, network.names)


def joint_of(network: StationNetwork) -> JointAdjustment:
    joint = registered(network).joint
    assert joint is not None
    return joint


def difference(first: PoseEstimate, second: PoseEstimate) -> np.ndarray:
    return pose_error(first.target_from_source, second.target_from_source)


@pytest.fixture(scope="module")
def network() -> StationNetwork:
    return station_network(np.random.default_rng(7), 6)


def test_without_noise_the_truth_comes_back() -> None:
    exact = station_network(np.random.default_rng(3), 4, noise_m=1e-9)
    result = registered(exact)
    for k in range(4):
        # 1e-7 m and rad: noise of a nanometre, tilts of small planes enlarge it
        assert np.abs(pose_error(result.poses[k].target_from_source, exact.true_pose(k))).max() < 1e-7


def test_the_order_of_stations_and_the_direction_of_pairs_change_nothing_but_the_datum(network: StationNetwork) -> None:
    order = [0, 4, 2, 5, 1, 3]
    first, second = registered(network), registered(network.renumbered(order))
    for k, station in enumerate(order):
        # a tenth of a micrometre: linearised about another station's planes
        assert np.abs(difference(first.poses[station], second.poses[k])).max() < 1e-7
        covariances = first.poses[station].covariance, second.poses[k].covariance
        np.testing.assert_allclose(covariances[0], covariances[1], rtol=1e-3, atol=1e-14)


def test_another_first_station_gives_the_same_poses_relative_to_each_other(network: StationNetwork) -> None:
    order = [3, 0, 1, 2, 4, 5]
    first, second = registered(network), registered(network.renumbered(order))
    to_new = first.poses[3].target_from_source.inv()
    for k, station in enumerate(order):
        carried = to_new * first.poses[station].target_from_source
        assert np.abs(pose_error(second.poses[k].target_from_source, carried)).max() < 1e-7


def test_the_frames_of_the_stations_do_not_matter(network: StationNetwork) -> None:
    moved = network.moved(np.random.default_rng(4))
    first, second = joint_of(network), joint_of(moved)
    assert first.solution.omega == pytest.approx(second.solution.omega, rel=1e-4)
    for k in range(1, 6):
        errors = [pose_error(joint.pose(k), net.true_pose(k)) for joint, net in ((first, network), (second, moved))]
        statistics = [e @ np.linalg.solve(j.covariance(k), e) for e, j in zip(errors, (first, second), strict=True)]
        assert statistics[0] == pytest.approx(statistics[1], rel=1e-3)


def test_redundancy_is_conditions_minus_six_for_each_further_station(network: StationNetwork) -> None:
    joint = joint_of(network)
    conditions = sum((3 if track.kind == "plane" else 4) * (len(track.members) - 1) for track in joint.tracks)
    assert joint.observation_count == conditions
    assert joint.solution.redundancy == conditions - 30


def test_more_stations_on_the_same_planes_make_the_poses_better() -> None:
    network = station_network(np.random.default_rng(11), 6)
    pair, everything = (
        register_network(n.features, n.links, n.names, KEEP_ALL).poses[1].covariance
        for n in (network.with_links((0, 1)), network)
    )
    # a positive semidefinite difference: no direction gets worse
    assert np.linalg.eigvalsh(pair - everything).min() > -1e-6 * np.abs(pair).max()


def test_a_plane_that_moved_between_two_stations_is_removed_and_bends_nothing(network: StationNetwork) -> None:
    seen = network.features[2]
    plane = int(network.plane_numbers[2][0])  # the floor, which all see
    centroids = seen.planes.centroids.copy()
    centroids[plane] += 0.05 * seen.planes.normals[plane]
    features = {**network.features, 2: replace(seen, planes=replace(seen.planes, centroids=centroids))}
    joint = joint_of(replace(network, features=features))
    assert [entry.member for entry in joint.removed][:1] == [(2, plane)]
    good = joint_of(network)
    for k in range(1, 6):
        shift = pose_error(joint.pose(k), good.pose(k))
        assert shift @ np.linalg.solve(joint.covariance(k), shift) < 16.8  # 99 % of chi-square, 6 degrees


def test_a_station_that_only_a_bridge_connects_is_registered_and_said_to_be_uncontrolled(
    network: StationNetwork,
) -> None:
    result = registered(network.with_links((0, 1), (0, 2), (1, 2), (2, 3)))
    bridge = [(3, 2), (2, 3)]
    links = network.with_links((0, 1), (0, 2), (1, 2), (2, 3)).links
    assert [links[k].stations in bridge for k in result.loops.uncontrolled] == [True]
    assert set(result.poses) == {0, 1, 2, 3}


def test_stations_without_connection_to_the_first_one_have_no_pose(network: StationNetwork) -> None:
    assert set(registered(network.with_links((0, 1), (3, 4))).poses) == {0, 1}
    alone = registered(network.with_links((3, 4)))
    assert set(alone.poses) == {0}
    assert alone.joint is None


def test_without_common_features_the_poses_are_those_of_the_pairs(network: StationNetwork) -> None:
    nothing = np.empty((0, 2), dtype=np.int64)
    links = tuple(replace(link, lines=nothing, planes=nothing) for link in network.links)
    result = registered(replace(network, links=links).with_links((0, 1), (1, 2)))
    assert result.joint is None
    assert "their poses are adjusted to the registrations of pairs" in result.remarks[0]
    first, second = (link.target_from_source for link in network.with_links((0, 1), (1, 2)).links)
    chained = first.after(second)
    np.testing.assert_allclose(result.poses[2].covariance, chained.covariance, rtol=1e-6, atol=1e-15)
    assert np.abs(difference(result.poses[2], chained)).max() < 1e-10


def test_start_values_of_some_degrees_are_enough(network: StationNetwork) -> None:
    rough = network.with_wrong_link(0, 1, 0.03, 0.1).with_wrong_link(1, 2, -0.03, 0.1)
    rough = rough.with_links((0, 1), (1, 2), (2, 3), (3, 4), (4, 5))
    good = network.with_links((0, 1), (1, 2), (2, 3), (3, 4), (4, 5))
    first, second = registered(rough), registered(good)
    for k in range(6):
        assert np.abs(difference(first.poses[k], second.poses[k])).max() < 1e-6


def test_the_fixed_station_is_the_identity_without_error(network: StationNetwork) -> None:
    fixed = registered(network).poses[0]
    np.testing.assert_array_equal(fixed.target_from_source.as_matrix(), RigidTransform.identity().as_matrix())
    np.testing.assert_array_equal(fixed.covariance, np.zeros((6, 6)))


def test_features_of_different_stations_come_back_in_one_round(monkeypatch: pytest.MonkeyPatch) -> None:
    block = city_block(24, np.random.default_rng(4))
    near = [(k, k + step) for step in (1, 2, 3) for k in range(24 - step)]
    links = block.registered(near, np.random.default_rng(5))
    parts, poses = chained_parts(links, 24)
    inside = max(parts, key=len)
    tracks = build_tracks(block.features, [link for link in links if link.target in inside], poses)
    search = joint_adjustment._Search(
        block.features,
        [largest_first(TrackKind.PLANE, members, block.features) for members in tracks.planes],
        inside, poses, KEEP_ALL,
    )  # fmt: skip
    concerned: set[int] = set()
    for number, members in enumerate(tracks.planes):
        seeing = {station for station, _ in members}
        if len(members) > 2 and not seeing & concerned:
            search.removed.add((number, members[0]))
            concerned |= seeing
    assert len(search.removed) > 1
    rounds = 0

    def counted(*given: Any, **named: Any) -> Solution:
        nonlocal rounds
        rounds += 1
        return solve(*given, **named)

    monkeypatch.setattr(joint_adjustment, "solve", counted)
    search.run(1.0)
    assert not search.removed
    assert rounds == 2
