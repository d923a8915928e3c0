"""Three stations and more: stored pairs become poses of all stations, and the document says how they hold together."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from algorithms.geometry.poses import PoseEstimate
from algorithms.progress import NoProgress
from schemas.results.network import Network
from service.ports import StepContext
from service.use_cases.steps.feature_store import save_features
from service.use_cases.steps.link_store import save_link
from service.use_cases.steps.run_network import adjust_network
from service.use_cases.steps.run_registration_report import report_registration
from tests.doubles.memory import MemoryBlobStore
from tests.scenes.buildings.station_networks import StationNetwork, station_network
from tests.scenes.lines.line_scenes import pose_error
from tests.unit.service.use_cases.steps.test_feature_store import some_features
from tests.unit.service.use_cases.steps.test_registration_report import pair

ORIGIN = np.array([500_000.0, 5_300_000.0, 100.0])


@pytest.fixture(scope="module")
def network() -> StationNetwork:
    return station_network(np.random.default_rng(31), 5)


def reported(network: StationNetwork, doubtful: tuple[tuple[int, int], ...] = ()) -> dict[str, Any]:
    """Store features and pairs as the steps before do, adjust and report; full coordinates lie far from the reduced."""
    blobs = MemoryBlobStore()
    context = StepContext(blobs, NoProgress())
    counts = {"points": 10, "lines": 1, "planes": 2, "cylinders": 0, "noise_std_m": 0.002}
    features, pairs = [], []
    for k, name in enumerate(network.names):
        seen = network.features[k]
        path = blobs.scratch() / "features.npz"
        origin = ORIGIN if k == 0 else np.zeros(3)
        save_features(path, replace(some_features(), lines=seen.lines, planes=seen.planes, origin_m=origin))
        blobs.put_file(f"features/{k}.npz", path)
        timings = {"read": 0.5}
        counted = {"station": name, **counts}
        features.append({"features": f"features/{k}.npz", "sha256": "ab", "counts": counted, "timings_s": timings})
    for number, link in enumerate(network.links):
        target, source = (network.names[station] for station in link.stations)
        path = blobs.scratch() / "link.npz"
        save_link(path, link)
        blobs.put_file(f"jobs/j/links/{number}.npz", path)
        status = "doubtful" if link.stations in doubtful else "accepted"
        document = pair(target, source, link.target_from_source.target_from_source, status)
        blobs.write_bytes(f"jobs/j/pairs/{number}.json", document.model_dump_json(by_alias=True).encode())
        pairs.append(
            {
                "pair": f"jobs/j/pairs/{number}.json",
                "status": status,
                "target": target,
                "source": source,
                "link": f"jobs/j/links/{number}.npz",
            }
        )
    method = {"method": "auto"}
    keys = [entry["features"] for entry in features]
    arguments = {"job_id": "j", "names": network.names, "features": keys, "pairs": pairs, "method": method}
    output = adjust_network(context, arguments)
    stations = [{"name": name, "scan": {"file": f"f-{name}", "index": 0}} for name in network.names]
    inputs = {"stations": stations, "method": method}
    report_registration(context, {"job_id": "j", "inputs": inputs, "features": features, "pairs": pairs, **output})
    page = blobs.local_path("jobs/j/artifacts/report.html").read_text()
    return {"page": page, **json.loads(blobs.local_path("jobs/j/result.json").read_text())}


def test_every_station_is_registered_as_well_as_its_covariance_says(network: StationNetwork) -> None:
    result = reported(network)
    assert result["status"] == "registered"
    for k, station in enumerate(result["stations"][1:], start=1):
        document = station["world_from_scan"]
        pose = RigidTransform.from_matrix(np.array(document["matrix"]))
        truth = RigidTransform.from_translation(ORIGIN) * network.true_pose(k)
        error = pose_error(pose, truth)
        assert error @ np.linalg.solve(np.array(document["covariance"]), error) < 27.9  # chi-square, 6 degrees, 0.01 %
        assert document["std_at_centroid_m"]["tx_m"] < 0.002


def test_the_document_tells_loops_tracks_and_the_global_test(network: StationNetwork) -> None:
    figures = reported(network)["network"]
    assert len(figures["loops"]) == 10
    assert all(loop["passed"] for loop in figures["loops"])
    assert {link["state"] for link in figures["links"]} == {"used"}
    adjustment = figures["adjustment"]
    assert adjustment["unknowns"] == 24
    assert adjustment["global_test"]["passed"]
    assert adjustment["tracks"]["planes"] > 10
    assert adjustment["redundancy"] == adjustment["observations"] - 24


def test_a_pair_that_breaks_its_loops_is_rejected_with_the_reason(network: StationNetwork) -> None:
    result = reported(network.with_wrong_link(1, 3, np.pi / 2, 0.0))
    assert result["status"] == "registered"
    wrong = next(entry for entry in result["pairs"] if (entry["target"], entry["source"]) == ("S1", "S3"))
    assert wrong["status"] == "rejected"
    assert "does not close" in wrong["reasons"][0]
    assert [link["state"] for link in result["network"]["links"]].count("rejected") == 1


def test_a_doubtful_pair_that_agrees_is_used_and_stays_doubtful(network: StationNetwork) -> None:
    result = reported(network.with_links((0, 1), (1, 2), (0, 2)), doubtful=((0, 2),))
    assert [link["state"] for link in result["network"]["links"]] == ["used", "used", "confirmed"]
    assert [entry["status"] for entry in result["pairs"]].count("doubtful") == 1


def test_stations_that_nothing_connects_are_named_with_the_reason(network: StationNetwork) -> None:
    result = reported(network.with_links((0, 1), (2, 3)))
    assert result["status"] == "partly-registered"
    reasons = [station["reason"] for station in result["stations"]]
    assert reasons[:2] == [None, None]
    assert "not connected to the first one" in reasons[2]
    assert reasons[4] == "no pair with this station was tried"
    states = {(link["target"], link["source"]): link["state"] for link in result["network"]["links"]}
    assert states == {("S0", "S1"): "uncontrolled", ("S2", "S3"): "not-connected"}


def test_poses_without_common_features_are_chained_and_the_document_says_so(network: StationNetwork) -> None:
    nothing = np.empty((0, 2), dtype=np.int64)
    links = tuple(replace(link, lines=nothing, planes=nothing) for link in network.links)
    bare = replace(network, links=links).with_links((0, 1), (1, 2), (2, 3), (3, 4))
    result = reported(bare)
    assert result["network"]["adjustment"] is None
    assert "could not be adjusted together" in result["network"]["remarks"][0]
    first, second = (link.target_from_source for link in bare.links[:2])
    chained = PoseEstimate(RigidTransform.from_translation(ORIGIN), np.zeros((6, 6))).after(first).after(second)
    found = np.array(result["stations"][2]["world_from_scan"]["matrix"])
    np.testing.assert_allclose(found, chained.target_from_source.as_matrix(), atol=2e-9)  # rounding at 5000 km


def test_the_report_shows_the_network(network: StationNetwork) -> None:
    page = reported(network.with_wrong_link(1, 3, np.pi / 2, 0.0))["page"]
    assert "Adjustment of all stations" in page
    assert "does not close" in page


def test_the_figures_are_as_the_schema_says(network: StationNetwork) -> None:
    Network.model_validate(reported(network)["network"])
