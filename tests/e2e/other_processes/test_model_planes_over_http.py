"""Points of a plinth and seeds go in over HTTP; planes and corners come out."""

import numpy as np
import pytest

from algorithms.scans.scan import Scan
from service.formats.writers import write_scans
from tests.e2e.running.running_service import Document, RunningService
from tests.unit.algorithms.meshing.test_constraint_lines import SIZE_M, plinth

ORIGIN_M = np.array([500_000.0, 5_800_000.0, 100.0])


@pytest.fixture(scope="module")
def inputs(service: RunningService, tmp_path_factory: pytest.TempPathFactory) -> Document:
    points, _ = plinth(0.002)
    path = tmp_path_factory.mktemp("planes") / "plinth.ply"
    write_scans(path, [Scan(points, ORIGIN_M, "plinth")])
    seeds = {"front": [0.5, 0.0, 0.2], "side": [1.0, 0.3, 0.2], "top": [0.5, 0.3, 0.4]}
    return {
        "stations": [{"name": "plinth", "scan": {"file": service.upload(path)["id"]}}],
        "planes": [{"name": name, "seed_m": (np.array(seed) + ORIGIN_M).tolist()} for name, seed in seeds.items()],
        "constraints": [
            {"relation": "vertical", "planes": ["front"]},
            {"relation": "vertical", "planes": ["side"]},
            {"relation": "orthogonal", "planes": ["front", "side"]},
        ],
        "corners": [["front", "side", "top"]],
        "tolerance_m": 0.008,
    }


def test_planes_keep_their_constraints_and_meet_in_the_corner(service: RunningService, inputs: Document) -> None:
    result = service.result(service.execute("model-planes", inputs))
    front, side, _ = (np.array(plane["normal"]) for plane in result["planes"])
    assert max(abs(front[2]), abs(side[2]), abs(front @ side)) < 1e-12
    (corner,) = result["corners"]
    assert corner["point_m"] == pytest.approx(ORIGIN_M + SIZE_M * [1.0, 0.0, 1.0], abs=0.001)
    assert result["std_m"] == pytest.approx(0.002, rel=0.1)


def test_names_of_no_plane_are_refused_at_their_place(service: RunningService, inputs: Document) -> None:
    wrong = {**inputs, "corners": [["front", "side", "floor"]]}
    answer = service.post("/processes/model-planes/execution", json={"inputs": wrong})
    assert answer.status_code == 400
    assert answer.json()["errors"][0]["pointer"] == "/inputs/corners/0/2"
