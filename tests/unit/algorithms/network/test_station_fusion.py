"""Poses of many stations mixed from lines and planes and from registrations of pairs."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.geometry.poses import PoseEstimate
from algorithms.network.links import StationLink
from algorithms.network.network_registration import NetworkRegistration, register_network
from algorithms.network.pose_graph import adjust_pose_graph
from algorithms.network.station_fusion import fused_stations, with_shared_scans
from tests.scenes.buildings.station_networks import StationNetwork, station_network
from tests.scenes.lines.line_scenes import pose_error

STATIONS = 5
STD = np.array([1e-4] * 3 + [1e-3] * 3)


def registrations(pairs: list[tuple[int, int]], rng: np.random.Generator) -> list[StationLink]:
    """Register stations in one place that all see the same surface: each scan has one error, which its pairs share."""
    nothing = np.empty((0, 2), dtype=np.int64)
    seen = [moved(rng.normal(size=6) * STD) for _ in range(STATIONS)]
    return [
        StationLink(
            a,
            b,
            PoseEstimate(seen[a].inv() * seen[b], np.diag(2.0 * STD**2)),
            nothing,
            nothing,
            np.zeros(3),
            5.0,
            0.002,
            feature_share=0.0,
        )
        for a, b in pairs
    ]


def moved(error: np.ndarray) -> RigidTransform:
    return RigidTransform.from_components(error[3:], Rotation.from_rotvec(error[:3]))


@pytest.mark.slow
def test_registrations_of_stations_that_see_the_same_surface_do_not_count_as_independent() -> None:
    rng, nees, last = np.random.default_rng(4), [], slice(6 * (STATIONS - 2), 6 * (STATIONS - 1))
    for _ in range(120):
        links = registrations(list(combinations(range(STATIONS), 2)), rng)
        graph = adjust_pose_graph(with_shared_scans(links), list(range(STATIONS)))
        error = pose_error(graph.unknowns.poses[STATIONS - 1], RigidTransform.identity())
        nees.append(error @ np.linalg.solve(graph.cofactors[last, last], error))
    low, high = stats.chi2.ppf([0.001, 0.999], 6 * len(nees)) / len(nees)
    assert low < np.mean(nees) < high


def test_registrations_in_a_chain_stay_as_they_are() -> None:
    links = registrations([(0, 1), (1, 2), (2, 3)], np.random.default_rng(5))
    for before, after in zip(links, with_shared_scans(links), strict=True):
        np.testing.assert_array_equal(after.target_from_source.covariance, before.target_from_source.covariance)


@pytest.fixture(scope="module")
def network() -> StationNetwork:
    return station_network(np.random.default_rng(11), 4)


def registered(network: StationNetwork, share: float) -> NetworkRegistration:
    links = [replace(link, feature_share=share) for link in network.links]
    return register_network(network.features, links, network.names)


def test_registrations_by_lines_and_planes_leave_the_poses_to_their_adjustment(network: StationNetwork) -> None:
    result = registered(network, 1.0)
    assert result.joint is not None
    assert result.feature_share == 1.0
    assert np.abs(pose_error(result.poses[3].target_from_source, result.joint.pose(3))).max() < 1e-12
    assert result.remarks == ()


def test_registrations_by_surfaces_alone_give_the_poses_themselves(network: StationNetwork) -> None:
    result = registered(network, 0.0)
    graph = adjust_pose_graph(with_shared_scans(network.links), list(range(len(network.names))))
    assert result.feature_share == 0.0
    assert np.abs(pose_error(result.poses[3].target_from_source, graph.unknowns.poses[3])).max() < 1e-9
    assert "the registrations of pairs, which use the surfaces too, the rest" in result.remarks[0]


def test_the_mixture_is_the_intersection_of_the_two_covariances(network: StationNetwork) -> None:
    result, share = registered(network, 0.4), 0.4
    graph = adjust_pose_graph(with_shared_scans(network.links), list(range(len(network.names))))
    assert result.joint is not None
    fused = fused_stations(result.joint, graph, share)
    size = 6 * (len(network.names) - 1)
    features = result.joint.solution.cofactors[:size, :size] * result.joint.variance_factor
    expected = np.linalg.inv(share * np.linalg.inv(features) + (1.0 - share) * np.linalg.inv(graph.cofactors))
    scales = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        fused.covariances.together() / np.outer(scales, scales), fused.factor * expected / np.outer(scales, scales),
        atol=1e-9,
    )  # fmt: skip
    for k, own in enumerate(fused.covariances.of_each()):
        np.testing.assert_allclose(own, fused.covariances.together()[6 * k : 6 * k + 6, 6 * k : 6 * k + 6], rtol=1e-12)


def test_a_mixture_never_promises_more_than_both_together(network: StationNetwork) -> None:
    whole, none, half = (np.linalg.inv(registered(network, share).poses[1].covariance) for share in (1.0, 0.0, 0.5))
    assert np.linalg.eigvalsh(whole + none - half).min() > 0.0
