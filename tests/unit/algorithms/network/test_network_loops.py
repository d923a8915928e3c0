"""Wrong registrations are found by the loops they break, and never used."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.geometry.poses import PoseEstimate
from algorithms.network.links import StationLink
from algorithms.network.loop_closure import examine_loops, loop_covariance_factor, short_loops
from algorithms.network.network_registration import register_network
from algorithms.network.pose_graph import chained_parts, connected_stations, tree_poses
from algorithms.network.wrong_links import wrong_links
from tests.scenes.buildings.station_networks import LINK_STD, StationNetwork, station_network

QUARTER = np.pi / 2


@pytest.fixture(scope="module")
def network() -> StationNetwork:
    return station_network(np.random.default_rng(21), 6)


def rejected_pairs(network: StationNetwork) -> set[tuple[int, int]]:
    return {network.links[k].stations for k in examine_loops(network.links, network.names).rejected}


def test_good_registrations_are_all_kept(network: StationNetwork) -> None:
    verdict = examine_loops(network.links, network.names)
    assert verdict.rejected == {}
    assert verdict.uncontrolled == ()
    assert len(verdict.loops) == 20  # all triangles of six stations
    assert verdict.variance_factor == 1.0


@pytest.mark.parametrize("turn_and_shift", [(QUARTER, 0.0), (np.pi, 0.0), (0.0, 2.5), (0.03, 0.0), (0.0, 0.2)])
def test_a_wrong_registration_is_rejected_and_no_other(
    network: StationNetwork, turn_and_shift: tuple[float, float]
) -> None:
    assert rejected_pairs(network.with_wrong_link(1, 4, *turn_and_shift)) == {(1, 4)}


def test_three_wrong_registrations_are_rejected_and_no_other(network: StationNetwork) -> None:
    wrong = (
        network.with_wrong_link(0, 1, QUARTER, 0.0).with_wrong_link(2, 3, 0.0, 5.0).with_wrong_link(1, 5, np.pi, 1.0)
    )
    assert rejected_pairs(wrong) == {(0, 1), (2, 3), (1, 5)}


def test_what_is_rejected_does_not_touch_the_poses(network: StationNetwork) -> None:
    wrong = network.with_wrong_link(1, 4, QUARTER, 0.0)
    without = network.with_links(*(pair for pair in combinations(range(6), 2) if pair != (1, 4)))
    first, second = (register_network(n.features, n.links, n.names) for n in (wrong, without))
    for k in range(6):
        np.testing.assert_array_equal(
            first.poses[k].target_from_source.as_matrix(), second.poses[k].target_from_source.as_matrix()
        )


def test_the_reason_names_a_loop_and_how_much_it_misses(network: StationNetwork) -> None:
    wrong = network.with_wrong_link(1, 4, QUARTER, 0.0)
    (reason,) = examine_loops(wrong.links, wrong.names).rejected.values()
    assert "does not close by 100." in reason
    assert "S1" in reason
    assert "S4" in reason


def test_in_a_single_loop_nobody_can_say_which_registration_is_wrong(network: StationNetwork) -> None:
    triangle = network.with_links((0, 1), (1, 2), (0, 2)).with_wrong_link(0, 1, QUARTER, 0.0)
    verdict = examine_loops(triangle.links, triangle.names)
    assert sorted(verdict.rejected) == [0, 1, 2]
    assert all("no other loop tells" in reason for reason in verdict.rejected.values())


def test_a_ring_without_triangles_is_tested_as_a_whole(network: StationNetwork) -> None:
    ring = network.with_links(*((k, k + 1) for k in range(5)), (0, 5))
    (loop,) = short_loops(ring.links)
    assert len(loop.links) == 6
    assert examine_loops(ring.links, ring.names).rejected == {}
    assert len(examine_loops((wrong := ring.with_wrong_link(2, 3, 0.0, 1.0)).links, wrong.names).rejected) == 6


def test_registrations_in_no_loop_are_uncontrolled_whatever_they_are(network: StationNetwork) -> None:
    chain = network.with_links((0, 1), (1, 2), (0, 2), (2, 3), (3, 4)).with_wrong_link(3, 4, QUARTER, 0.0)
    verdict = examine_loops(chain.links, chain.names)
    assert verdict.rejected == {}
    assert {chain.links[k].stations for k in verdict.uncontrolled} == {(2, 3), (3, 4)}


def split(network: StationNetwork, doubtful: tuple[int, int]) -> tuple[StationNetwork, tuple[StationLink, ...]]:
    """Give the network without one registration, and that registration."""
    others = [link.stations for link in network.links if link.stations != doubtful]
    return network.with_links(*others), network.with_links(doubtful).links


def test_a_doubtful_registration_that_agrees_is_used_and_controls_the_others(network: StationNetwork) -> None:
    chain, doubtful = split(network.with_links((0, 1), (1, 2), (2, 3), (0, 2)), (0, 2))
    result = register_network(chain.features, chain.links, chain.names, doubtful=doubtful)
    assert result.confirmed == (0,)
    assert {chain.links[k].stations for k in result.uncontrolled} == {(2, 3)}
    without = register_network(chain.features, chain.links, chain.names)
    assert {chain.links[k].stations for k in without.uncontrolled} == {(0, 1), (1, 2), (2, 3)}
    assert np.trace(result.poses[2].covariance) < np.trace(without.poses[2].covariance)


def test_a_doubtful_registration_that_does_not_agree_changes_nothing(network: StationNetwork) -> None:
    wrong = network.with_links((0, 1), (1, 2), (0, 2)).with_wrong_link(0, 2, 0.0, 0.5)
    chain, doubtful = split(wrong, (0, 2))
    result = register_network(chain.features, chain.links, chain.names, doubtful=doubtful)
    assert result.confirmed == ()
    np.testing.assert_array_equal(
        result.poses[2].covariance, register_network(chain.features, chain.links, chain.names).poses[2].covariance
    )


def test_doubtful_registrations_connect_no_station(network: StationNetwork) -> None:
    chain, doubtful = split(network.with_links((0, 1), (1, 2)), (1, 2))
    assert set(register_network(chain.features, chain.links, chain.names, doubtful=doubtful).poses) == {0, 1}


def test_covariances_that_are_somewhat_too_small_reject_nothing(network: StationNetwork) -> None:
    # poses as before, covariances nine times too small: what real walls do
    links = [
        replace(
            link,
            noise_m=0.0,
            target_from_source=PoseEstimate(
                link.target_from_source.target_from_source, link.target_from_source.covariance / 7.0
            ),
        )
        for link in network.links
    ]
    verdict = examine_loops(links, network.names)
    assert verdict.rejected == {}
    assert 4.0 < verdict.variance_factor < 9.0


def scaled(network: StationNetwork, variance: float) -> list[StationLink]:
    return [
        replace(link, target_from_source=link.target_from_source.with_covariance_scaled(variance))
        for link in network.links
    ]


def test_loops_of_honest_covariances_enlarge_nothing(network: StationNetwork) -> None:
    assert loop_covariance_factor(network.links) == 1.0
    assert loop_covariance_factor(network.with_links((0, 1), (1, 2)).links) == 1.0  # no loop


def test_loops_tell_how_much_covariances_are_too_small(network: StationNetwork) -> None:
    honest = np.mean([loop_covariance_factor(scaled(network, 1e-6)) / 1e6])
    assert 0.6 < honest < 1.5  # ten independent loops: a standard deviation of 0.18
    assert loop_covariance_factor(scaled(network, 0.1)) == pytest.approx(10.0 * honest, rel=1e-6)


def test_what_loops_say_enlarges_the_covariance_of_the_stations(network: StationNetwork) -> None:
    small = replace(network, links=tuple(scaled(network, 0.1)))
    good, bad = (register_network(n.features, n.links, n.names) for n in (network, small))
    assert bad.variance_factor == pytest.approx(bad.loop_factor, rel=1e-12)
    np.testing.assert_allclose(bad.poses[3].covariance, bad.loop_factor * good.poses[3].covariance, rtol=1e-4)


def test_going_round_many_loops_at_once_is_chaining_their_registrations(network: StationNetwork) -> None:
    links = [replace(link, noise_m=0.0) for link in network.with_wrong_link(1, 4, 0.3, 0.5).links]
    verdict = examine_loops(links, network.names)
    for loop in verdict.loops:
        chained = PoseEstimate(RigidTransform.identity(), np.zeros((6, 6)))
        for station, number in zip(loop.stations, loop.links, strict=True):
            chained = chained.after(links[number].from_station(station))
        first = links[loop.links[0]]
        to_station = RigidTransform.identity() if first.target == loop.stations[0] else (
            first.from_station(loop.stations[0]).target_from_source
        )  # fmt: skip
        place = to_station.apply(first.centroid_m)
        shift = chained.target_from_source.apply(place) - place
        assert loop.turn_rad == pytest.approx(chained.rotation.magnitude(), abs=1e-12)
        assert loop.shift_m == pytest.approx(np.linalg.norm(shift), abs=1e-12)
        error = np.concatenate([chained.rotation.as_rotvec(), shift])
        centred = chained.moved_to_origins(-place, -place)
        statistic = error @ np.linalg.solve(centred.covariance, error) / verdict.variance_factor
        assert loop.statistic == pytest.approx(statistic, rel=1e-9)


def test_parts_chained_at_once_are_those_chained_one_by_one(network: StationNetwork) -> None:
    links = network.with_links((0, 2), (2, 5), (0, 5), (1, 4)).links
    parts, poses = chained_parts(links, 6)
    assert parts == [[0, 2, 5], [1, 4], [3]]
    for part in parts:
        assert part == connected_stations(links, part[0])
        own = tree_poses([link for link in links if link.target in part], part[0])
        for station in part:
            np.testing.assert_array_equal(own[station].as_matrix(), poses[station].as_matrix())


def many_links(rng: np.random.Generator, stations: int, wrong_share: float) -> tuple[list[StationLink], set[int]]:
    """Register stations spread over a site with their three nearest; give the numbers of wrong registrations too."""
    places = rng.uniform(0.0, 6.0 * np.sqrt(stations), (stations, 2))
    poses = [RigidTransform.from_components([*place, 1.5], Rotation.random(rng=rng)) for place in places]
    nearest = np.argsort(np.linalg.norm(places[:, None] - places[None], axis=2), axis=1)[:, 1:4]
    pairs = sorted({(min(a, b), max(a, b)) for a in range(stations) for b in nearest[a].tolist()})
    nothing = np.empty((0, 2), dtype=np.int64)
    links, wrong = [], set()
    for number, (target, source) in enumerate(pairs):
        pose = poses[target].inv() * poses[source]
        if rng.random() < wrong_share:
            wrong.add(number)
            turn = Rotation.from_rotvec([0.0, 0.0, [QUARTER, np.pi][number % 2]])
            pose = RigidTransform.from_components(rng.normal(size=3), turn) * pose
        error = LINK_STD * rng.normal(size=6)
        found = RigidTransform.from_components(
            np.asarray(pose.translation) + error[3:], Rotation.from_rotvec(error[:3]) * pose.rotation
        )
        estimate = PoseEstimate(found, np.diag(LINK_STD**2))
        links.append(StationLink(target, source, estimate, nothing, nothing, np.zeros(3), 3.0, 0.004))
    return links, wrong


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_of_many_wrong_registrations_none_is_used_in_a_loop_and_few_good_ones_are_lost(seed: int) -> None:
    links, wrong = many_links(np.random.default_rng(seed), 60, 0.05)
    verdict = examine_loops(links, [f"S{k}" for k in range(60)])
    used = set(range(len(links))) - verdict.rejected.keys()
    assert len(wrong) >= 3
    assert used & wrong <= set(verdict.uncontrolled)
    assert len(verdict.rejected.keys() - wrong) <= 3 * len(wrong)


def test_a_third_registration_of_a_station_tells_which_of_two_is_wrong(network: StationNetwork) -> None:
    pairs = [(0, 1), (1, 2), (0, 2), (2, 3), (3, 0), (0, 5), (2, 5)]
    wrong = network.with_links(*pairs).with_wrong_link(2, 5, 0.0, 3.0)
    assert rejected_pairs(wrong) == {(0, 5), (2, 5)}
    more = network.with_links(*pairs, (1, 5)).with_wrong_link(2, 5, 0.0, 3.0)
    assert rejected_pairs(more) == {(2, 5)}


def test_one_wrong_registration_explains_all_failing_loops() -> None:
    assert set(wrong_links([(0, 1, 2), (0, 3, 4)], [(1, 5, 6)])) == {0}


def test_a_passing_loop_acquits_its_registrations() -> None:
    assert set(wrong_links([(0, 1, 2)], [(1, 5, 6), (2, 5, 7)])) == {0}


def test_registrations_that_may_all_be_the_wrong_one_are_all_blamed_with_the_others() -> None:
    blamed = wrong_links([(0, 1, 2)], [(2, 5, 7)])
    assert set(blamed) == {0, 1}
    assert blamed[0].alternatives == (1,)


def test_separate_failures_are_explained_separately() -> None:
    assert set(wrong_links([(0, 1), (0, 2), (7, 8), (7, 9)], [])) == {0, 7}


def test_without_registrations_there_is_no_loop() -> None:
    verdict = examine_loops([], ("S1", "S2"))
    assert (verdict.loops, dict(verdict.rejected), verdict.uncontrolled) == ((), {}, ())
