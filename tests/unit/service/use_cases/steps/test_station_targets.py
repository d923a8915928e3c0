"""Looking for targets in the scans of a registration, from its plan to what the adjustment takes."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from algorithms.progress import NoProgress
from algorithms.simulation.materials import PLASTER
from algorithms.simulation.parts import box
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import scan_scene
from algorithms.simulation.scene import scene_from_parts
from algorithms.simulation.target_parts import checker_board, facing, sphere
from schemas.requests.register_inputs import RegisterInputs
from service.adapters.files.local_files import LocalFiles
from service.formats import writers
from service.names.content_keys import content_key
from service.ports import Json, StepContext
from service.processes import STEPS
from service.processes.register.plan import RegisterPlan
from service.use_cases.inputs.validate_request import validated
from service.use_cases.steps.station_targets import target_set
from service.use_cases.steps.target_lists import targets_by_station

FAR_M = np.array([3_000.0, 5_000.0, 100.0])
"""Of the coordinates of the files."""
RADIUS_M, BOARD_M = 0.0725, 0.15
SPHERE_M, BOARD_AT_M = np.array([8.0, 0.2, 0.1]), np.array([9.0, -0.2, -0.1])
SCANNER = VirtualScanner(
    rows=180,
    columns=240,
    lowest_rad=-0.036,
    highest_rad=0.036,
    leftmost_rad=-0.048,
    rightmost_rad=0.048,
    range_noise_std_m=0.001,
    mixed_intensities=True,
)


@pytest.mark.slow
def test_spheres_and_boards_are_found_in_the_coordinates_of_the_file_and_stated_ones_come_first(
    tmp_path: Path,
) -> None:
    board = checker_board(facing(BOARD_AT_M, -BOARD_AT_M), BOARD_M)
    parts = [box((12.0, -3.0, -3.0), (12.2, 3.0, 3.0), PLASTER), sphere(SPHERE_M.tolist(), RADIUS_M), *board]
    seen = scan_scene(scene_from_parts("t", parts, []), RigidTransform.identity(), SCANNER, np.random.default_rng(5))
    context = StepContext(
        LocalFiles(tmp_path / "store"),
        NoProgress(),
        {"max_points": 10**6, "max_photo_pixels": 10**6, "min_free_bytes": 0},
    )
    writers.write_scans(tmp_path / "a.e57", [replace(seen, origin_m=seen.origin_m + FAR_M)])
    context.blobs.put_file(content_key("a" * 64), tmp_path / "a.e57")
    stated = SPHERE_M + FAR_M + 0.001
    known = {"name": "S1", **dict(zip("xyz", stated.tolist(), strict=True)), "std": 0.002}
    kinds = [{"kind": "sphere", "radius_m": RADIUS_M}, {"kind": "board", "size_m": BOARD_M}]
    stations = [{"name": "A", "scan": {"file": "f"}, "targets": [known]}, {"name": "B", "scan": {"file": "f"}}]
    inputs = validated(RegisterInputs, {"stations": stations, "targets": {"kinds": kinds}}).model_dump(mode="json")
    job: Json = {"id": "j", "inputs": inputs, "files": {"f": {"name": "a.e57", "sha256": "a" * 64, "scans": []}}}
    first = RegisterPlan().next_stage(job, [])
    assert first is not None
    calls = [call for call in first if call.name == "station-targets"]
    assert [call.arguments["name"] for call in calls] == ["A", "B"]
    output = json.loads(json.dumps(STEPS["station-targets"](context, json.loads(json.dumps(calls[0].arguments)))))
    assert output["station"] == "A"
    told = {each["kind"]: each for each in output["targets"]}
    assert set(told) == {"sphere", "board"}
    assert len(output["targets"]) == 2
    for kind, truth in (("sphere", SPHERE_M), ("board", BOARD_AT_M)):
        error = np.array(told[kind]["xyz_m"]) - FAR_M - truth
        assert np.linalg.norm(error) < 0.001
        assert error @ np.linalg.solve(np.array(told[kind]["covariance_m2"]), error) < 16.27  # chi-square of 3, 0.1 %
    joined = targets_by_station(inputs, {"A": output["targets"], "B": output["targets"]})
    assert [(each["name"], each["kind"]) for each in joined["A"]] == [("S1", "stated"), (None, "board")]
    assert len(joined["B"]) == 2
    reduced = target_set(joined["A"], FAR_M)
    assert reduced is not None
    np.testing.assert_allclose(reduced.points.coordinates, [stated - FAR_M, BOARD_AT_M], atol=0.002)
