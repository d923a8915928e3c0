"""A hybrid network goes in over HTTP; coordinates, tests, reliability and reports come out."""

import copy

import numpy as np
import pytest

from tests.e2e.running_service import Document, RunningService
from tests.scenes.hybrid_networks import hybrid_network

NETWORK, TRUTH = hybrid_network(3, approximate=False)


@pytest.fixture(scope="module")
def adjusted(service: RunningService) -> Document:
    network = copy.deepcopy(NETWORK)
    network["observations"]["polar"][7]["distance"] += 0.1
    network["observations"]["control"] = [
        {"point": name, "xyz": TRUTH[name].tolist(), "std": 0.001} for name in ("1", "2", "3", "4")
    ]
    network["observations"]["control"].append({"name": "5", "xyz": TRUTH["5"].tolist(), "use": "check"})
    inputs = {"network": network, "datum": {"type": "control"}, "variance_components": True}
    return service.result(service.execute("adjust", inputs))


def test_points_come_out_in_the_frame_of_the_control_without_approximate_values(adjusted: Document) -> None:
    assert adjusted["status"] == "adjusted"
    assert adjusted["rank_defect"] == 0
    for point in adjusted["points"]:
        misses = np.abs(np.array(point["xyz_m"]) - TRUTH[point["id"]])
        assert (misses < 5.0 * np.array(point["std_m"])).all()
    assert adjusted["checks"][0]["p_value"] > 1e-3


def test_the_wrong_distance_is_left_out(adjusted: Document) -> None:
    wrong = NETWORK["observations"]["polar"][7]
    (row,) = [
        o for o in adjusted["observations"]
        if (o["station"], o["point"], o["component"]) == (wrong["station"], wrong["point"], "distance")
    ]  # fmt: skip
    assert row["state"] == "removed"
    assert row["residual"] == pytest.approx(-0.1, abs=0.01)
    assert len(adjusted["removals"]) <= 3  # good ones fail at one in a thousand


def test_redundancy_numbers_add_up_and_downloads_are_there(service: RunningService, adjusted: Document) -> None:
    assert sum(o["redundancy"] for o in adjusted["observations"]) == pytest.approx(adjusted["redundancy"], abs=1e-6)
    names = {each["name"]: each for each in adjusted["artifacts"]}
    assert set(names) == {"observations.csv", "points.csv", "stations.csv", "report.html"}
    table = service.http.get(names["observations.csv"]["href"]).text.splitlines()
    assert len(table) == len(adjusted["observations"]) + 1
    assert "Network adjustment" in service.http.get(names["report.html"]["href"]).text


def test_two_epochs_are_compared(service: RunningService) -> None:
    later = copy.deepcopy(NETWORK)
    for each in later["observations"]["polar"]:
        if each["point"] == "6":
            each["distance"] += 0.05
    later["observations"]["image"] = [o for o in later["observations"]["image"] if o["point"] != "6"]
    inputs = {"network": NETWORK, "epoch": later, "gross_errors": "none"}
    found = service.result(service.execute("adjust", inputs))["congruence"]
    assert not found["congruent"]
    assert [each["id"] for each in found["differences"] if each["moved"]] == ["6"]


@pytest.mark.parametrize(
    ("change", "pointer"),
    [
        ({"station": "S9"}, "/inputs/network/observations/polar/0/station"),
        ({"station": "P1"}, "/inputs/network/observations/polar/0/station"),
        ({"sigma_distance": None}, "/inputs/network/observations/polar/0"),
        ({"sigma_distance": -1.0}, "/inputs/network/observations/polar/0/sigma_distance"),
        ({"zenit": 1.0}, "/inputs/network/observations/polar/0/zenit"),
    ],
)
def test_bad_observations_are_refused_with_a_pointer(service: RunningService, change: Document, pointer: str) -> None:
    network = copy.deepcopy(NETWORK)
    network["observations"]["polar"][0].update(change)
    refused(service, {"network": network}, pointer)


def test_bad_networks_are_refused_with_a_pointer(service: RunningService) -> None:
    empty = copy.deepcopy(NETWORK) | {"observations": {}}
    refused(service, {"network": empty}, "/inputs/network/observations")
    twice = copy.deepcopy(NETWORK)
    twice["stations"].append({"id": "S1", "type": "scanner"})
    refused(service, {"network": twice}, "/inputs/network/stations/7/id")
    idle = copy.deepcopy(NETWORK)
    idle["stations"].append({"id": "S8", "type": "scanner"})
    refused(service, {"network": idle}, "/inputs/network/stations/7")
    cyclic = copy.deepcopy(NETWORK)
    cyclic["mounts"] = [{"id": "M"}]
    cyclic["stations"][3] |= {"carrier": "P2", "mount": "M"}
    cyclic["stations"][4] |= {"carrier": "P1", "mount": "M"}
    refused(service, {"network": cyclic}, "/inputs/network/stations/3/carrier")
    control = [{"point": "1", "xyz": [0, 0, 0], "std": 0.01}, {"name": "1", "xyz": [0, 0, 1], "std": 0.01}]
    repeated = copy.deepcopy(NETWORK)
    repeated["observations"]["control"] = control
    refused(service, {"network": repeated}, "/inputs/network/observations/control/1/point")
    apart = copy.deepcopy(NETWORK)
    for each in apart["observations"]["polar"]:
        each["point"] += "x" if each["station"] == "S2" else ""
    refused(service, {"network": apart}, "/inputs/network/stations/1")
    held = {"type": "minimal", "held": [["999", "XYZ"]]}
    refused(service, {"network": NETWORK, "datum": held}, "/inputs/datum/held/0/0")


def test_numbers_that_are_none_are_refused(service: RunningService) -> None:
    import json

    body = json.dumps({"inputs": {"network": NETWORK}}).replace(
        str(NETWORK["observations"]["polar"][0]["distance"]), "NaN", 1
    )
    answer = service.http.post(
        "/processes/adjust/execution", content=body, headers={"Content-Type": "application/json"}
    )
    assert answer.status_code == 400


def refused(service: RunningService, inputs: Document, pointer: str) -> None:
    answer = service.http.post("/processes/adjust/execution", json={"inputs": inputs})
    assert answer.status_code == 400
    assert pointer in [each["pointer"] for each in answer.json()["errors"]]
