"""A LAS file whose points carry flags, classes and returns goes in over HTTP; what they say is heeded and kept."""

from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest

from tests.e2e.other_processes.test_clean_and_colour_over_http import run
from tests.e2e.running.running_service import Document, RunningService

N = 20_000
SLOPE = 0.02
SEED = 0


def slope_with_false_points(path: Path, point_format: int) -> tuple[int, int]:
    """Write a slope, below it a patch of withheld points, below and above it noise; return how many of both."""
    rng = np.random.default_rng(SEED)
    xy = rng.uniform(0.0, 100.0, (N, 2))
    z = SLOPE * xy[:, 0] + rng.normal(0.0, 0.03, N)
    patch = (np.abs(xy - 70.0) < 6.0).all(axis=1) & (rng.random(N) < 0.5)
    z[patch] -= 2.0
    noise = np.flatnonzero(~patch)[:40]
    z[noise[:20]] -= 5.0
    z[noise[20:]] += 40.0
    classes = np.ones(N, np.uint8)
    classes[noise[:20]], classes[noise[20:]] = 7, 18
    header = laspy.LasHeader(point_format=point_format, version="1.4" if point_format >= 6 else "1.2")
    header.scales = [0.001] * 3
    cloud: Any = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = xy[:, 0], xy[:, 1], z
    cloud.return_number = cloud.number_of_returns = np.ones(N, np.uint8)
    cloud.classification, cloud.withheld = classes, patch
    cloud.write(path)
    return int(patch.sum()), len(noise)


@pytest.mark.parametrize(("point_format", "ending"), [(1, "las"), (6, "laz")])
def test_withheld_points_and_noise_are_no_terrain(
    service: RunningService, tmp_path: Path, point_format: int, ending: str
) -> None:
    path = tmp_path / f"slope-{point_format}.{ending}"
    withheld, noise = slope_with_false_points(path, point_format)
    file: Document = service.upload(path)
    said = f"points left out as the file marks them: {withheld} withheld, {noise} noise (classes 7 and 18)"
    assert said in file["warnings"]
    inputs = {"stations": [{"name": "slope", "scan": {"file": file["id"]}}], "maps": False}
    result = run(service, "terrain", inputs, {"points": {}, "artifacts": {}})
    assert result["points"] == N - withheld - noise
    links = {each["name"]: each["href"] for each in result["artifacts"]}
    for model in ("dtm.asc", "dsm.asc"):
        lines = service.get(links[model]).text.splitlines()
        head = {name: float(value) for name, value in (line.split() for line in lines[:6])}
        heights = np.array([line.split() for line in lines[6:]], dtype=float)
        x = head["xllcorner"] + head["cellsize"] * (np.arange(heights.shape[1]) + 0.5)
        assert np.abs(heights - SLOPE * x).max() < 0.2
