"""Two scans of a house with control given as points of the stations: poses come out in the control's frame."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path

import laspy
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.geometry.topocentric import TopocentricFrame
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import simulate_stations
from algorithms.simulation.scenes import SCENES
from tests.e2e.running.command_line import tieline
from tests.e2e.running.running_service import Document, RunningService
from tests.e2e.running.virtual_scans import write_scans

STD_M = 0.002
RNG = np.random.default_rng(12)
STATIONS = SCENES["house"]().stations[:2]
TO_GRID = RigidTransform.from_components([4_512_000.0, 5_402_000.0, 312.0], Rotation.from_euler("z", 0.7))
"""The house in a national grid."""
PLACES = np.array(
    [[0.0, 0.0, 0.5], [9.0, 1.0, 3.0], [2.0, 8.0, 1.0], [11.0, 7.0, 4.0], [5.0, -4.0, 2.0], [-3.0, 4.0, 2.5]]
)
GRID = TO_GRID.apply(PLACES)
WRONG = 4


def station_targets(number: int) -> list[Document]:
    places = STATIONS[number].inv().apply(PLACES) + STD_M * RNG.normal(size=PLACES.shape)
    return [{"name": f"P{k}", "x": x, "y": y, "z": z, "std": STD_M} for k, (x, y, z) in enumerate(places.tolist())]


TARGETS = [station_targets(0), station_targets(1)]


def control(*, wrong_m: float = 0.0) -> list[Document]:
    values = GRID + STD_M * np.random.default_rng(2).normal(size=GRID.shape)
    values[WRONG, 1] += wrong_m
    return [
        {"name": f"P{k}", "x": y, "y": x, "z": z, "std": STD_M, "use": "check" if k == 5 else "control"}
        for k, (x, y, z) in enumerate(values.tolist())
    ]


@pytest.fixture(scope="module")
def scans(tmp_path_factory: pytest.TempPathFactory) -> Sequence[Path]:
    """Two stations with few points: what is shown here needs no more."""
    scanner = VirtualScanner(rows=100, columns=240, mixed_pixels=False)
    found = simulate_stations(SCENES["house"](), STATIONS, scanner, np.random.default_rng(1))
    return write_scans(tmp_path_factory.mktemp("small"), list(found))


@pytest.fixture(scope="module")
def files(service: RunningService, scans: Sequence[Path]) -> list[str]:
    return [service.upload(path)["id"] for path in scans]


def inputs_of(files: Sequence[str], **said: object) -> Document:
    stations = [
        {"name": name, "scan": {"file": file}, "targets": own}
        for name, file, own in zip("AB", files, TARGETS, strict=True)
    ]
    return {"stations": stations, "method": {"method": "targets"}, **said}


@pytest.fixture(scope="module")
def result(service: RunningService, files: Sequence[str]) -> Document:
    said = {"control": control(wrong_m=0.05), "control_axes": "north-east-height"}
    return service.result(service.execute("register", inputs_of(files, **said)))


def test_poses_are_in_the_frame_of_the_control_with_standard_deviations_that_hold(result: Document) -> None:
    assert result["status"] == "registered"
    for station, known in zip(result["stations"], STATIONS, strict=True):
        assert station["status"] == "registered"
        pose, truth = station["world_from_scan"], TO_GRID * known
        estimate = RigidTransform.from_matrix(np.array(pose["matrix"]))
        turn = (estimate.rotation * truth.rotation.inv()).as_rotvec()
        error = np.concatenate([turn, np.asarray(estimate.translation) - np.asarray(truth.translation)])
        assert error @ np.linalg.solve(np.array(pose["covariance"]), error) < 22.5  # chi-square of 6, 0.1 %


def test_the_wrong_control_point_is_named_and_the_check_point_is_met(result: Document) -> None:
    told = {point["name"]: point for point in result["control"]["points"]}
    assert [name for name, point in told.items() if point["state"] == "removed"] == [f"P{WRONG}"]
    assert any(f"P{WRONG}" in reason for reason in result["control"]["reasons"])
    check = told["P5"]
    assert check["state"] == "check"
    assert check["statistic"] < check["critical"]
    np.testing.assert_allclose(check["xyz_m"], GRID[5][[1, 0, 2]], atol=0.01)  # north, east, height
    assert not result["control"]["scale"]["significant"]


def test_the_chain_of_project_and_global_frame_is_left_handed(result: Document) -> None:
    pop = np.array(result["control"]["global_from_project"])
    assert np.linalg.det(pop[:3, :3]) < 0.0
    station = result["control"]["stations"][1]
    told = pop @ np.array(station["project_from_scan"]) @ [0.0, 0.0, 0.0, 1.0]
    np.testing.assert_allclose(told[:3], station["xyz_m"], atol=1e-6)


@pytest.mark.parametrize(
    ("said", "pointer"),
    [
        ({"fix": "C"}, "/inputs/fix"),
        ({"fix": "control"}, "/inputs/control"),
        ({"control": [{"name": "1", "x": 0, "y": 0, "z": 0}]}, "/inputs/control/0"),
        (
            {"control": [{"name": "1", "x": 0, "y": 0, "z": 0, "std": 0.01}] * 2, "fix": "free"},
            "/inputs/control/1/name",
        ),
        ({"crs": "EPSG:25832"}, "/inputs/crs"),
        ({"control": control(), "crs": "EPSG:4326"}, "/inputs/crs"),
        ({"control": control(), "crs": "EPSG:25832"}, "/inputs/control/0"),
    ],
)
def test_control_that_makes_no_sense_is_refused(
    service: RunningService, files: Sequence[str], said: Document, pointer: str
) -> None:
    answer = service.post("/processes/register/execution", json={"inputs": inputs_of(files, **said)})
    assert answer.status_code == 400, answer.text
    assert pointer in [error["pointer"] for error in answer.json()["errors"]], answer.text


def test_the_command_line_takes_control_of_a_projection_from_a_table(
    service: RunningService, scans: Sequence[Path], tmp_path: Path
) -> None:
    utm = TopocentricFrame("EPSG:25832", np.array([500_000.0, 5_400_000.0, 300.0])).from_local(PLACES)
    rows = [f"P{k};{x:.4f};{y:.4f};{z:.4f};0.002" for k, (x, y, z) in enumerate(utm.tolist())]
    known = tmp_path / "control.csv"
    known.write_text("\n".join(["name;x;y;z;std", *rows]))
    stated = tmp_path / "targets.json"
    stated.write_text(json.dumps({path.stem: own for path, own in zip(scans, TARGETS, strict=True)}))
    asked: tuple[str | Path, ...] = ("--control", known, "--targets", stated, "--crs", "EPSG:25832")
    asked = (*asked, "--method", "targets", "--registered", "laz", "--output", tmp_path / "out", "--url", service.url)
    answer = tieline("register", *scans, *asked)
    assert answer.returncode == 0, answer.stdout + answer.stderr
    told = json.loads((tmp_path / "out" / "result.json").read_text())
    assert told["control"]["status"] == "adjusted"
    for number, file in enumerate(told["registered"]):
        cloud = laspy.read(tmp_path / "out" / file["name"])
        crs = cloud.header.parse_crs()
        assert crs is not None
        assert crs.to_epsg() == 25832
        place = told["control"]["stations"][number]["xyz_m"]
        assert np.linalg.norm(np.median(np.asarray(cloud.xyz), axis=0) - place) < 30.0
    with (tmp_path / "out" / "poses.csv").open(newline="") as table:
        poses = list(csv.DictReader(table))
    for row, station, pose in zip(poses, told["control"]["stations"], STATIONS, strict=True):
        assert (row["crs"], "the middle of the control in EPSG:25832" in row["frame"]) == ("EPSG:25832", True)
        place, std = ([float(row[f"{axis}_m{end}"]) for axis in ("east", "north", "height")] for end in ("", "_std"))
        assert (place, std) == (station["xyz_m"], station["std_m"])
        truth = TopocentricFrame("EPSG:25832", np.array([500_000.0, 5_400_000.0, 300.0])).from_local(
            np.asarray(pose.translation)[None]
        )
        assert (np.abs(place - truth[0]) < 4.0 * np.array(std) + 1e-4).all()  # control is given to 0.1 mm
    assert "projected east · north · height [m]" in answer.stdout


def test_files_with_rigid_poses_are_not_called_projected(service: RunningService, files: Sequence[str]) -> None:
    utm = TopocentricFrame("EPSG:25832", np.array([500_000.0, 5_400_000.0, 300.0])).from_local(PLACES)
    known = [{"name": f"P{k}", "x": x, "y": y, "z": z, "std": 0.01} for k, (x, y, z) in enumerate(utm.tolist())]
    asked = {
        "inputs": inputs_of(files, control=known, crs="EPSG:25832"),
        "outputs": {"registered": {"format": "e57", "crs": "EPSG:25832"}},
    }
    answer = service.post("/processes/register/execution", json=asked)
    assert answer.status_code == 400, answer.text
    assert [error["pointer"] for error in answer.json()["errors"]] == ["/outputs/registered/crs"]
