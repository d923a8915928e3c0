"""A cloud with hills, houses and trees goes in over HTTP; ground, models and drawings come out."""

from pathlib import Path

import laspy
import numpy as np
import pytest

from tests.e2e.other_processes.test_clean_and_colour_over_http import refusal, run
from tests.e2e.running.running_service import Document, RunningService
from tests.scenes.simulated_terrain import hills_with_houses

SHIFT_M = np.array([500_000.0, 5_600_000.0, 300.0])
"""The project lies far from the origin of its coordinates."""


@pytest.fixture(scope="module")
def station(service: RunningService, tmp_path_factory: pytest.TempPathFactory) -> Document:
    points, _ = hills_with_houses()
    path = tmp_path_factory.mktemp("terrain") / "hills.xyz"
    np.savetxt(path, points + SHIFT_M, fmt="%.3f")
    return {"name": "hills", "scan": {"file": service.upload(path)["id"]}}


def test_ground_models_and_drawings_come_out(service: RunningService, station: Document, tmp_path: Path) -> None:
    inputs = {
        "stations": [station],
        "compare_filters": ["block-min"],
        "contour_interval_m": 1.0,
        "mesh": True,
        "canopy": True,
    }
    result = run(
        service, "terrain", inputs,
        {"classified": {"format": "laz"}, "ground": {}, "points": {}, "compared": {}, "artifacts": {}},
    )  # fmt: skip
    _, truth = hills_with_houses()
    (file,) = result["classified"]
    path = tmp_path / file["name"]
    path.write_bytes(service.get(file["href"]).content)
    classes = np.asarray(laspy.read(path).classification)
    assert (classes == 2).sum() == result["ground"]
    assert ((classes == 2) == truth).mean() > 0.98
    assert [row["name"] for row in result["compared"]] == ["block-min"]
    names = {each["name"] for each in result["artifacts"]}
    assert {
        "dtm.asc",
        "dsm.asc",
        "ndsm.asc",
        "hillshade.png",
        "contours.dxf",
        "terrain.ply",
        "density.png",
        "stand-height.asc",
    } <= names
    grid = service.get(next(each["href"] for each in result["artifacts"] if each["name"] == "dtm.asc")).text
    header = dict(line.split() for line in grid.splitlines()[:6])
    assert float(header["xllcorner"]) == pytest.approx(SHIFT_M[0], abs=2.0)


def test_the_slope_filter_learns_from_labelled_terrain(
    service: RunningService, station: Document, tmp_path: Path
) -> None:
    points, ground = hills_with_houses(density=1.0, seed=5)
    training = {}
    for name, part in (("ground", points[ground]), ("objects", points[~ground])):
        np.savetxt(tmp_path / f"{name}.xyz", part, fmt="%.3f")
        training[name] = {"file": service.upload(tmp_path / f"{name}.xyz")["id"]}
    inputs = {"stations": [station], "filter": {"name": "slope", "adaptive": False, "slope": 0.1}, "training": training}
    result = run(service, "terrain", inputs, {"ground": {}, "points": {}, "filter": {}})
    _, truth = hills_with_houses()
    assert result["ground"] / result["points"] == pytest.approx(truth.mean(), abs=0.02)
    allowed = result["filter"]["allowed_m"]
    assert allowed == sorted(allowed)
    problem = refusal(service, "terrain", {"stations": [station], "training": training})
    assert "/inputs/training" in str(problem)
    assert "learns nothing" in str(problem)


def test_a_filter_that_is_none_is_refused(service: RunningService, station: Document) -> None:
    problem = refusal(service, "terrain", {"stations": [station], "filter": {"name": "wizardry"}})
    assert "/inputs/filter" in str(problem)
    assert "opening" in str(problem)
