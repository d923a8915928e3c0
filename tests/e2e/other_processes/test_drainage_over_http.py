"""Hills go in over HTTP; valleys, ridges and hollows come out."""

from pathlib import Path

import numpy as np

from tests.e2e.other_processes.test_clean_and_colour_over_http import run
from tests.e2e.running.running_service import RunningService
from tests.scenes.simulated_terrain import hills_with_houses

SHIFT_M = np.array([500_000.0, 5_600_000.0, 300.0])


def test_lines_with_heights_come_out(service: RunningService, tmp_path: Path) -> None:
    points, _ = hills_with_houses()
    path = tmp_path / "hills.xyz"
    np.savetxt(path, points + SHIFT_M, fmt="%.3f")
    inputs = {
        "stations": [{"name": "hills", "scan": {"file": service.upload(path)["id"]}}],
        "filter": {"name": "opening"},
        "cell_m": 2.0,
        "least_catchment_m2": 150.0,
        "least_length_m": 10.0,
    }
    result = run(service, "drainage", inputs)
    assert {"valley", "ridge"} <= {line["kind"] for line in result["lines"]}
    files = {each["name"]: each["href"] for each in result["artifacts"]}
    assert {"slope.asc", "aspect.asc", "catchment.png", "lines.dxf"} <= set(files)
    features = service.get(files["lines.geojson"]).json()["features"]
    assert len(features) == len(result["lines"])
    corners = np.array([corner for each in features for corner in each["geometry"]["coordinates"]])
    assert (np.abs(corners - SHIFT_M - [50.0, 50.0, 0.0]) <= [52.0, 52.0, 20.0]).all()
