"""Points and ground plans go in over HTTP; buildings come out."""

from pathlib import Path

import numpy as np
import pytest

from algorithms.scans.scan import Scan
from service.formats.writers import write_scans
from tests.e2e.running.running_service import Document, RunningService
from tests.scenes.roof_kinds import KINDS, flown
from tests.unit.algorithms.roofs.test_buildings import RECTANGLE, gable, scanned, true_volume_m3

ORIGIN_M = np.array([500_000.0, 5_800_000.0, 100.0])


@pytest.fixture(scope="module")
def inputs(service: RunningService, tmp_path_factory: pytest.TempPathFactory) -> Document:
    points, plan = scanned(RECTANGLE, gable)
    path = tmp_path_factory.mktemp("roofs") / "strip.ply"
    write_scans(path, [Scan(points, ORIGIN_M, "strip")])
    corners = (plan + ORIGIN_M[:2]).tolist()
    elsewhere = (plan + ORIGIN_M[:2] + 1000.0).tolist()
    return {
        "stations": [{"name": "strip", "scan": {"file": service.upload(path)["id"]}}],
        "plans": [{"name": "house", "corners_m": corners}, {"name": "elsewhere", "corners_m": elsewhere}],
        "roof": {"neighbourhood_m": 1.2},
    }


def test_a_gable_roof_becomes_a_building_with_two_faces(service: RunningService, inputs: Document) -> None:
    wanted = {"building_models": {"format": "city.json"}, "buildings": {}}
    job = service.post("/processes/roofs/execution", json={"inputs": inputs, "outputs": wanted})
    assert job.status_code == 201, job.text
    result = service.result(job.json()["jobID"])
    house, elsewhere = result["buildings"]
    assert [face["slope_deg"] for face in house["faces"]] == pytest.approx([34.99, 34.99], abs=0.3)
    directions = sorted(face["azimuth_gon"] for face in house["faces"])
    assert directions[1] - directions[0] == pytest.approx(200.0, abs=1.0)
    assert house["watertight"]
    assert (house["status"], house["reason"]) == ("modelled", None)
    assert elsewhere["status"] == "not-modelled"
    assert house["volume_m3"] == pytest.approx(true_volume_m3(RECTANGLE, gable), rel=0.01)
    assert "no ground" in elsewhere["reason"]
    (file,) = result["building_models"]
    document = service.http.get(file["href"]).json()
    assert list(document["CityObjects"]) == ["house"]


def test_a_plan_without_area_and_a_name_used_twice_are_refused(service: RunningService, inputs: Document) -> None:
    line = {"name": "house", "corners_m": [[0, 0], [1, 1], [2, 2]]}
    answer = service.post("/processes/roofs/execution", json={"inputs": {**inputs, "plans": [line]}})
    assert answer.status_code == 400
    assert answer.json()["errors"][0]["pointer"].startswith("/inputs/plans/0/corners_m")
    twice = {**inputs, "plans": [inputs["plans"][0], inputs["plans"][0]]}
    answer = service.post("/processes/roofs/execution", json={"inputs": twice})
    assert answer.json()["errors"][0]["pointer"] == "/inputs/plans/1/name"


def test_without_plans_the_house_is_found(service: RunningService, inputs: Document) -> None:
    result = service.result(service.execute("roofs", {name: inputs[name] for name in ("stations", "roof")}))
    (house,) = result["buildings"]
    assert house["name"] == "building-1"
    assert len(house["corners_m"]) == 4
    assert len(house["faces"]) == 2
    assert house["volume_m3"] == pytest.approx(true_volume_m3(RECTANGLE, gable), rel=0.1)


def test_a_pyramid_that_its_planes_do_not_meet_is_not_called_right(service: RunningService, tmp_path: Path) -> None:
    kind = KINDS["pyramid"]
    path = tmp_path / "pyramid.ply"
    write_scans(path, [Scan(flown(kind, 1, 6.0, (0.05, 0.03)), ORIGIN_M, "strip")])
    plan = {"name": "tower", "corners_m": (kind.outline + ORIGIN_M[:2]).tolist()}
    stations = [{"name": "strip", "scan": {"file": service.upload(path)["id"]}}]
    (tower,) = service.result(service.execute("roofs", {"stations": stations, "plans": [plan]}))["buildings"]
    right = tower["volume_m3"] == pytest.approx(614.4, rel=0.01)
    assert right if tower["status"] == "modelled" else "incomplete" in tower["reason"]
