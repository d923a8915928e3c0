"""The step that chooses the pairs of the next round, on stored features and registrations."""

from dataclasses import replace
from typing import Any

import numpy as np

from algorithms.features.scan_features import SurfaceSample
from algorithms.network.candidate_pairs import most_pairs
from algorithms.progress import NoProgress
from service.ports import StepContext
from service.use_cases.steps.feature_store import save_features
from service.use_cases.steps.link_store import load_link, save_link
from service.use_cases.steps.run_network_growth import choose_pairs
from tests.doubles.memory import MemoryBlobStore
from tests.scenes.buildings.station_networks import StationNetwork, station_network
from tests.unit.service.use_cases.steps.test_feature_store import some_features

STATIONS = 10


def stored(network: StationNetwork) -> tuple[StepContext, dict[str, Any]]:
    """Store the features of all stations; their surfaces are a floor that all see."""
    blobs = MemoryBlobStore()
    steps = np.arange(-5.0, 5.0, 0.5)
    floor = np.array([(x, y, 0.0) for x in steps for y in steps])
    for k, seen in network.features.items():
        in_station = network.poses[k].inv().apply(floor)
        surface = SurfaceSample(in_station, np.zeros_like(in_station), np.zeros(len(floor), dtype=np.int32), 0.5)
        path = blobs.scratch() / "features.npz"
        save_features(path, replace(some_features(), planes=seen.planes, lines=seen.lines, surface=surface))
        blobs.put_file(f"features/{k}.npz", path)
    keys = [f"features/{k}.npz" for k in network.features]
    return StepContext(blobs, NoProgress()), {"job_id": "j", "names": network.names, "features": keys}


def registered(context: StepContext, network: StationNetwork, pairs: list[list[str]]) -> list[dict[str, Any]]:
    """Accept the pairs that have a registration; give the outputs of their steps."""
    links = {tuple(network.names[k] for k in link.stations): link for link in network.links}
    outputs = []
    for number, pair in enumerate(map(tuple, pairs)):
        key = None
        if pair in links:
            path = context.blobs.scratch() / "link.npz"
            save_link(path, links[pair])
            key = f"jobs/j/links/{number}.npz"
            context.blobs.put_file(key, path)
        status = "rejected" if key is None else "accepted"
        outputs.append({"target": pair[0], "source": pair[1], "status": status, "link": key})
    return outputs


def test_the_first_round_follows_the_list() -> None:
    network = station_network(np.random.default_rng(1), STATIONS)
    context, arguments = stored(network)
    chosen = choose_pairs(context, {**arguments, "pairs": []})["pairs"]
    assert {(f"S{k}", f"S{k + 1}") for k in range(STATIONS - 1)} <= set(map(tuple, chosen))
    assert len(chosen) < most_pairs(STATIONS)


def test_further_rounds_join_what_is_apart_until_every_station_has_loops() -> None:
    whole = station_network(np.random.default_rng(2), STATIONS)
    # neighbours in the list fit, but for the gap between S4 and S5, which only S1 - S8 bridges
    fitting = [(a, b) for a in range(10) for b in range(a + 1, 10) if b - a <= 2 and (a < 5) == (b < 5)]
    network = whole.with_links(*fitting, (1, 8))
    context, arguments = stored(network)
    tried: list[list[str]] = []
    while fresh := choose_pairs(context, {**arguments, "pairs": registered(context, network, tried)})["pairs"]:
        assert not {tuple(pair) for pair in fresh} & {tuple(pair) for pair in tried}
        tried += fresh
    assert ["S1", "S8"] in tried
    accepted = [pair for pair in registered(context, network, tried) if pair["status"] == "accepted"]
    degrees = {name: sum(name in (pair["target"], pair["source"]) for pair in accepted) for name in network.names}
    assert min(degrees.values()) >= 2


def test_a_stored_registration_reads_back(tmp_path: Any) -> None:
    (link,) = station_network(np.random.default_rng(3), 2).links
    save_link(tmp_path / "link.npz", link)
    read = load_link(tmp_path / "link.npz", 4, 7)
    assert read.stations == (4, 7)
    np.testing.assert_array_equal(read.planes, link.planes)
    np.testing.assert_array_equal(read.target_from_source.covariance, link.target_from_source.covariance)
    matrices = [each.target_from_source.target_from_source.as_matrix() for each in (read, link)]
    np.testing.assert_allclose(*matrices, atol=1e-15)  # the rotation is normalised once more
