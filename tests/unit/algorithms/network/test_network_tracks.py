"""Corresponding features of pairs become objects that many stations see."""

from dataclasses import replace

import numpy as np
import pytest

from algorithms.network.tracks import Tracks, build_tracks
from tests.scenes.buildings.station_networks import StationNetwork, station_network


@pytest.fixture(scope="module")
def network() -> StationNetwork:
    return station_network(np.random.default_rng(9), 5, seen_share=0.9)


def tracks_of(network: StationNetwork) -> Tracks:
    return build_tracks(network.features, network.links, dict(enumerate(network.poses)))


def test_every_track_is_one_true_plane(network: StationNetwork) -> None:
    tracks = tracks_of(network)
    assert len(tracks.planes) > 10
    for members in tracks.planes:
        true_numbers = {int(np.flatnonzero(network.plane_numbers[s] == k)[0]) for s, k in members}
        assert len(true_numbers) == 1


def test_no_station_is_twice_in_a_track(network: StationNetwork) -> None:
    for members in (*tracks_of(network).planes, *tracks_of(network).lines):
        assert len({station for station, _ in members}) == len(members)


def test_edges_join_planes_that_were_not_compared_themselves(network: StationNetwork) -> None:
    no_planes = np.empty((0, 2), dtype=np.int64)
    only_edges = replace(network, links=tuple(replace(link, planes=no_planes) for link in network.links))
    tracks = tracks_of(only_edges)
    assert tracks.edges > 0
    assert tracks.lost_edges == 0
    assert len(tracks.planes) > 10


def test_edges_alone_make_no_tracks_of_lines_but_pipes_do(network: StationNetwork) -> None:
    lines = tracks_of(network).lines
    assert 0 < len(lines) <= 4
    assert all(network.features[s].lines.parents[k, 0] < 0 for members in lines for s, k in members)


def test_a_correspondence_that_would_show_a_station_the_same_plane_twice_is_left_out(network: StationNetwork) -> None:
    first = network.links[0]
    wrong = first.planes.copy()
    wrong[0, 1], wrong[1, 1] = first.planes[1, 1], first.planes[0, 1]
    no_lines = np.empty((0, 2), dtype=np.int64)
    links = (replace(first, planes=wrong), *network.links[1:])
    bare = replace(network, links=tuple(replace(link, lines=no_lines) for link in links))
    tracks = tracks_of(bare)
    assert tracks.conflicts > 0
    for members in tracks.planes:
        assert len({station for station, _ in members}) == len(members)


def test_the_order_of_stations_and_pairs_does_not_change_the_objects(network: StationNetwork) -> None:
    order = [4, 2, 0, 3, 1]
    found = tracks_of(network.renumbered(order)).planes
    named = {tuple(sorted((order[s], k) for s, k in members)) for members in found}
    assert named == set(tracks_of(network).planes)
