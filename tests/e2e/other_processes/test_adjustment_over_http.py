"""A hybrid network goes in over HTTP; coordinates, tests, reliability and reports come out."""

import copy
import csv
import json
from pathlib import Path

import numpy as np
import pytest

from tests.e2e.running.command_line import tieline
from tests.e2e.running.running_service import Document, RunningService
from tests.scenes.hybrid_networks import hybrid_network
from tests.unit.service.test_mistaken_networks import network

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


def test_names_that_look_like_formulas_are_texts_in_all_tables(service: RunningService) -> None:
    network = json.loads(json.dumps(NETWORK).replace('"5"', '"=1+cmd|A0"').replace('"6"', '"-2+3"'))
    result = service.result(service.execute("adjust", {"network": network}))
    assert {"=1+cmd|A0", "-2+3"} <= {point["id"] for point in result["points"]}
    tables = [each["href"] for each in result["artifacts"] if each["name"].endswith(".csv")]
    assert len(tables) == 3
    cells = [cell for href in tables for row in csv.reader(service.http.get(href).text.splitlines()) for cell in row]
    assert {"'=1+cmd|A0", "'-2+3"} <= set(cells)
    assert not [cell for cell in cells if cell[:1] in {"=", "@", "+"} or cell == "-2+3"]


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


GAMA = """<gama-local xmlns="http://www.gnu.org/software/gama/gama-local"><network axes-xy="en">
<points-observations distance-stdev="2" direction-stdev="10" zenith-angle-stdev="10">
<point id="A" x="0" y="0" z="0" fix="xyz"/><point id="B" x="10" y="0" z="1" fix="xyz"/>
<point id="P" x="5.01" y="5.02" z="0.11" adj="xyz"/>
<obs from="A"><direction to="B" val="50"/><direction to="P" val="0"/><z-angle to="P" val="99.1"/>
<s-distance to="P" val="7.072"/></obs>
<height-differences><dh from="A" to="P" val="0.1" stdev="1"/></height-differences>
</points-observations></network></gama-local>"""


def test_networks_of_other_programs_are_adjusted(service: RunningService, tmp_path: Path) -> None:
    inputs = {"network": {"format": "gama-local", "xml": GAMA}, "datum": {"type": "control"}}
    (point,) = [p for p in service.result(service.execute("adjust", inputs))["points"] if p["id"] == "P"]
    np.testing.assert_allclose(point["xyz_m"], [5.0, 5.0, 0.1], atol=0.005)
    file = tmp_path / "net.gkf"
    file.write_text(GAMA)
    where = ("--datum", '{"type": "control"}', "--url", service.url, "--output", tmp_path / "kept")
    done = tieline("adjust", file, *where)
    assert done.returncode == 0, done.stderr
    kept = json.loads((tmp_path / "kept" / "result.json").read_text())
    assert [p["xyz_m"] for p in kept["points"] if p["id"] == "P"] == [point["xyz_m"]]


def test_networks_of_others_are_refused_by_name(service: RunningService) -> None:
    foreign = {"format": "gama-local", "xml": GAMA.replace("z-angle", "azimuth")}
    refused(service, {"network": foreign}, "/inputs/network")
    bomb = {"format": "gama-local", "xml": '<!DOCTYPE a [<!ENTITY b "b">]><gama-local>&b;</gama-local>'}
    refused(service, {"network": bomb}, "/inputs/network")


def test_a_million_observations_are_refused_at_the_door(service: RunningService) -> None:
    one = {"station": "S1", "point": "1"}
    for name, value in (("horizontal", 1.0), ("zenith", 99.0), ("distance", 9.0)):
        one |= {name: value, f"sigma_{name}": 0.1}
    network = copy.deepcopy(NETWORK)
    network["observations"]["polar"] = []
    body = json.dumps({"inputs": {"network": network}})
    many = ",".join([json.dumps(one)] * 333_334)
    body = body.replace('"polar": []', f'"polar": [{many}]')
    answer = service.http.post(
        "/processes/adjust/execution", content=body, headers={"Content-Type": "application/json"}
    )
    assert answer.status_code in {400, 413}, answer.text
    assert service.http.get("/healthz").status_code == 200


def test_numbers_that_are_none_are_refused(service: RunningService) -> None:
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


@pytest.mark.parametrize(
    ("mistake", "what"), [({"wrong": {"C": (10.0, 0.0, 0.0)}}, "held point 'C'"), ({"angle": 0.9}, "look like deg")]
)
def test_a_mistake_that_concerns_everything_is_called_doubtful(
    service: RunningService, mistake: Document, what: str
) -> None:
    found = service.result(service.execute("adjust", {"network": network(**mistake)}))
    assert found["status"] == "doubtful"
    assert any(what in each for each in found["explanations"])
    assert service.result(service.execute("adjust", {"network": network()}))["status"] == "adjusted"
