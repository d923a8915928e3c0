"""Stations that lines and planes leave open take the adjustment from nobody else."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from algorithms.network.network_registration import NetworkRegistration, register_network
from service.use_cases.documents.network_documents import network_document
from tests.scenes.buildings.station_networks import StationNetwork, station_network
from tests.scenes.lines.line_scenes import KEEP_ALL, pose_error

NOTHING = np.empty((0, 2), dtype=np.int64)


def registered(network: StationNetwork, share: float = 0.7) -> NetworkRegistration:
    links = [replace(link, feature_share=share) for link in network.links]
    return register_network(network.features, links, network.names, KEEP_ALL)


def without_features(network: StationNetwork, *stations: int) -> StationNetwork:
    """Let the registrations of some stations rest on surfaces alone."""
    links = tuple(
        replace(link, lines=NOTHING, planes=NOTHING) if set(stations) & set(link.stations) else link
        for link in network.links
    )
    return replace(network, links=links)


def with_one_plane(network: StationNetwork, station: int) -> StationNetwork:
    """Let a station share one plane with each other one, so that it may slide along it and turn upon it."""
    links = tuple(
        replace(link, lines=NOTHING, planes=link.planes[:1]) if station in link.stations else link
        for link in network.links
    )
    return replace(network, links=links)


@pytest.fixture(scope="module")
def network() -> StationNetwork:
    return station_network(np.random.default_rng(7), 4)


def test_a_station_that_shares_nothing_is_named_and_all_others_are_adjusted(network: StationNetwork) -> None:
    opened = without_features(network, 3)
    result = registered(opened)
    assert result.left_out == (3,)
    assert "1 of 4 stations are held by the registrations of pairs alone" in result.remarks[0]
    assert result.remarks[0].endswith(f": {network.names[3]}")
    assert result.joint is not None
    assert result.joint.stations == (0, 1, 2)
    error = pose_error(result.poses[3].target_from_source, network.true_pose(3))
    assert error @ np.linalg.solve(result.poses[3].covariance, error) < stats.chi2.isf(1e-3, 6)
    document = network_document(result, opened.links, (), network.names)
    assert document.adjustment is not None
    assert document.adjustment.left_out == [network.names[3]]


def test_all_stations_that_shared_planes_leave_a_direction_are_found(network: StationNetwork) -> None:
    result = registered(with_one_plane(without_features(network, 1), 3))
    assert result.left_out == (1, 3)
    assert set(result.poses) == set(range(4))


def test_nothing_is_left_out_where_nothing_is_open(network: StationNetwork) -> None:
    assert registered(network).left_out == ()


@pytest.mark.parametrize("share", [0.7, 1.0])
def test_an_open_first_station_gives_the_poses_of_any_other_one(network: StationNetwork, share: float) -> None:
    opened = without_features(network, 0)
    renumbered = opened.renumbered([2, 1, 0, 3])
    first, second = registered(opened, share), registered(renumbered, share)
    assert first.left_out == (0,)
    assert second.left_out == (2,)
    assert first.joint is not None
    assert first.joint.stations == (1, 2, 3)
    inverse = second.poses[2].inverse()
    # linearised at the poses of the registrations, some millimetres beside: squares of them
    assert np.abs(pose_error(first.poses[2].target_from_source, inverse.target_from_source)).max() < 1e-5
    np.testing.assert_allclose(first.poses[2].covariance, inverse.covariance, rtol=0.02, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("station", [0, 2])
def test_covariances_of_open_and_other_stations_hold(station: int) -> None:
    rng, nees = np.random.default_rng(5), []
    for _ in range(25):
        network = without_features(station_network(rng, 4), station).with_links((0, 1), (1, 2), (2, 3), (0, 3))
        result = registered(network, 1.0)
        assert result.left_out == (station,)
        assert result.covariances is not None
        errors = [pose_error(result.poses[k].target_from_source, network.true_pose(k)) for k in (1, 2, 3)]
        error = np.concatenate(errors)
        nees.append(float(error @ np.linalg.solve(result.covariances.together(), error)))
    low, high = stats.chi2.ppf([0.0005, 0.9995], 18 * len(nees)) / len(nees)
    assert low < np.mean(nees) < high
