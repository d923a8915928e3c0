"""Registered scans go in over HTTP; a mesh with figures and faults comes out."""

from pathlib import Path

import numpy as np
import pytest

from algorithms.meshing.reconstruction import enclosed_volume
from algorithms.scans.scan import Scan
from service.formats.meshes import read_mesh
from service.formats.writers import write_scans
from tests.e2e.running.running_service import Document, RunningService

ORIGIN_M = np.array([500_000.0, 5_800_000.0, 100.0])
HALF_BALL_M3 = np.pi / 12.0


@pytest.fixture(scope="module")
def stations(service: RunningService, tmp_path_factory: pytest.TempPathFactory) -> list[Document]:
    """Two stations that each saw half of a ball of 1 m, in coordinates of the world."""
    rng = np.random.default_rng(1)
    out = rng.normal(size=(12_000, 3))
    out /= np.linalg.norm(out, axis=1)[:, None]
    points, folder = 0.5 * out + rng.normal(0.0, 0.001, out.shape), tmp_path_factory.mktemp("mesh")
    found = []
    for name, seen in (("east", points[:, 0] > -0.05), ("west", points[:, 0] < 0.05)):
        write_scans(folder / f"{name}.ply", [Scan(points[seen], ORIGIN_M, name)])
        found.append({"name": name, "scan": {"file": service.upload(folder / f"{name}.ply")["id"]}})
    return found


def test_scans_become_a_closed_mesh_in_a_file(
    service: RunningService, stations: list[Document], tmp_path: Path
) -> None:
    inputs = {
        "stations": stations,
        "surface": {"resolution_m": 0.03, "share": 0.5},
        "cuts": [{"point_m": ORIGIN_M.tolist(), "normal": [0, 0, 1]}],
    }
    job = service.post("/processes/mesh/execution", json={"inputs": inputs, "outputs": {"mesh": {"format": "ply"}}})
    assert job.status_code == 201, job.text
    (file,) = service.result(job.json()["jobID"])["mesh"]
    path = tmp_path / "mesh.ply"
    path.write_bytes(service.http.get(file["href"]).content)
    mesh, _ = read_mesh(path, path.name)
    assert enclosed_volume(mesh) == pytest.approx(HALF_BALL_M3, rel=0.005)
    assert mesh.vertices[:, 2].min() == pytest.approx(ORIGIN_M[2], abs=1e-6)
    figures = service.result(service.execute("mesh", inputs))
    assert figures["watertight"]
    assert figures["volume_m3"] == pytest.approx(HALF_BALL_M3, rel=0.005)
    assert [step["step"] for step in figures["steps"]] == ["poisson", "components", "decimation", "cut"]
    assert figures["deviations"]["std_m"] < 0.002
    assert "mesh" not in figures


def test_a_ball_on_a_plinth_is_one_body_and_its_top_a_spline_patch(
    service: RunningService, stations: list[Document]
) -> None:
    normals = np.vstack([np.eye(3), -np.eye(3)])
    low, high = np.array([-0.6, -0.6, -0.8]), np.array([0.6, 0.6, -0.2])
    planes = [
        {"point_m": (ORIGIN_M + (high if k < 3 else low)).tolist(), "normal": (2.0 * normal).tolist()}
        for k, normal in enumerate(normals)
    ]
    top = {
        "kind": "height-field", "name": "top", "reach_m": 0.2, "tolerance_m": 0.001,
        "corner_m": (ORIGIN_M + np.array([-0.2, -0.2, 0.4])).tolist(),
        "side_u_m": [0.4, 0.0, 0.0], "side_v_m": [0.0, 0.4, 0.0],
    }  # fmt: skip
    inputs = {
        "stations": stations,
        "surface": {"resolution_m": 0.03},
        "plinth": {"planes": planes, "top": 2, "above_m": 0.02},
        "patches": [top],
    }
    outputs = {"patch_file": {"format": "igs"}, "watertight": {}, "volume_m3": {}, "patches": {}}
    job = service.post("/processes/mesh/execution", json={"inputs": inputs, "outputs": outputs})
    assert job.status_code == 201, job.text
    result = service.result(job.json()["jobID"])
    above = np.pi * 0.7**2 * (1.5 - 0.7) / 3.0
    assert result["watertight"]
    assert result["volume_m3"] == pytest.approx(1.2 * 1.2 * 0.6 + above, rel=0.005)
    assert result["patches"][0]["std_m"] < 0.002
    assert service.get(result["patch_file"][0]["href"]).text.splitlines()[0][72] == "S"
    twice = service.post("/processes/mesh/execution", json={"inputs": {**inputs, "patches": [top, top]}})
    assert twice.json()["errors"][0]["pointer"] == "/inputs/patches/1/name"


def test_a_cut_without_direction_is_refused_at_its_place(service: RunningService, stations: list[Document]) -> None:
    inputs = {"stations": stations, "cuts": [{"point_m": [0, 0, 0], "normal": [0, 0, 0]}]}
    answer = service.post("/processes/mesh/execution", json={"inputs": inputs})
    assert answer.status_code == 400
    assert answer.json()["errors"][0]["pointer"].startswith("/inputs/cuts/0")


def test_a_resolution_too_fine_fails_and_says_what_would_do(service: RunningService, stations: list[Document]) -> None:
    job = service.finished(service.execute("mesh", {"stations": stations, "surface": {"resolution_m": 1e-5}}))
    assert job["status"] == "failed"
    assert "at least" in str(job)
