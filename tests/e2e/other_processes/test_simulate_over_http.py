"""Planned set-ups in a scene of one's own, from the command line to scans that can be uploaded again."""

import json
from pathlib import Path

import numpy as np
import trimesh

from tests.e2e.running.command_line import tieline
from tests.e2e.running.running_service import RunningService


def test_a_mesh_is_scanned_from_planned_set_ups(service: RunningService, tmp_path: Path) -> None:
    mesh = trimesh.creation.box(extents=(8.0, 6.0, 3.0))
    mesh.export(tmp_path / "room.ply")
    stations = [{"name": "A", "position_m": [-2.0, 0.0, 0.0]}, {"name": "B", "position_m": [2.0, 1.0, 0.0]}]
    asked = ("--stations", json.dumps(stations), "--instrument", "phase-120m", "--step-gon", "1", "--no-expect")
    kept = tmp_path / "kept"
    done = tieline("simulate", tmp_path / "room.ply", *asked, "--url", service.url, "--output", kept)
    assert done.returncode == 0, done.stderr
    result = json.loads((kept / "result.json").read_text())
    assert [station["file"] for station in result["stations"]] == ["A.e57", "B.e57"]
    assert result["instrument"]["name"] == "phase-120m"
    truth = json.loads((kept / "truth.json").read_text())
    assert np.array(truth["B"])[:3, 3].tolist() == [2.0, 1.0, 0.0]
    sent = service.upload(kept / "A.e57")
    assert sent["scans"][0]["points"] == result["stations"][0]["points"] > 10_000


def test_a_scene_by_name_needs_no_file(service: RunningService, tmp_path: Path) -> None:
    asked = ("--scene", "single_plane", "--step-gon", "2", "--no-expect", "--format", "ptx")
    done = tieline("simulate", *asked, "--url", service.url, "--output", tmp_path / "kept")
    assert done.returncode == 0, done.stderr
    assert list((tmp_path / "kept").glob("*.ptx"))


def test_two_scenes_at_once_are_bad_input(service: RunningService) -> None:
    inputs = {"scene": "house", "planes": [{"name": "w", "outline_m": [[0, 0, 0], [1, 0, 0], [0, 1, 0]]}]}
    answer = service.post("/processes/simulate/execution", json={"inputs": inputs})
    assert answer.status_code == 400
    assert "one of scene, mesh and planes" in answer.text
