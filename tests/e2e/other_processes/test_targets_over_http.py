"""A scan goes in over HTTP; its targets come out with covariances and the names of a list."""

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.geometry.camera_mounts import CameraAxes, scan_from_camera_with_axes
from algorithms.geometry.cameras import Camera
from algorithms.scans.scan import Scan
from algorithms.simulation.materials import PLASTER
from algorithms.simulation.parts import box
from algorithms.simulation.rendering import render_photo
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import scan_scene
from algorithms.simulation.scene import scene_from_parts
from algorithms.simulation.sun import Daylight
from algorithms.simulation.target_parts import checker_board, facing, sphere
from algorithms.simulation.virtual_camera import VirtualCamera
from tests.e2e.running.running_service import Document, RunningService

RADIUS_M = 0.1
CHI_SQUARE_12 = 32.9
"""Exceeded by one of a thousand."""
CENTRES = np.array([[6.0, 0.7, 0.3], [5.0, -0.5, -0.2], [5.5, 0.1, -0.5], [6.5, -0.8, 0.5]])
SCANNER = VirtualScanner(
    rows=240, columns=320, lowest_rad=-0.15, highest_rad=0.15, leftmost_rad=-0.2, rightmost_rad=0.2,
    range_noise_std_m=0.001, mixed_pixels=False,
)  # fmt: skip
BOARD_M = 0.15
BOARD_SCANNER = replace(SCANNER, mixed_intensities=True)
CAMERA = Camera(440, 320, 1800.0, 1800.0, 219.3, 158.2)
SCAN_FROM_CAMERA = scan_from_camera_with_axes(
    RigidTransform.from_components([0.05, 0.02, 0.2], Rotation.from_rotvec([0.0, 0.03, 0.0])),
    CameraAxes.FORWARD_LEFT_UP,
)


def _as_ptx(scan: Scan) -> str:
    assert scan.grid is not None
    assert scan.intensity is not None
    header = [str(scan.grid.columns), str(scan.grid.rows), "0 0 0", "1 0 0", "0 1 0", "0 0 1"]
    header += ["1 0 0 0", "0 1 0 0", "0 0 1 0", "0 0 0 1"]
    lines = []
    for number in scan.grid.index[::-1].T.ravel().tolist():
        x, y, z = scan.points[number] if number >= 0 else (0.0, 0.0, 0.0)
        lines.append(f"{x:.6f} {y:.6f} {z:.6f} {scan.intensity[number] if number >= 0 else 0.5:.4f}")
    return "\n".join([*header, *lines]) + "\n"


@pytest.fixture(scope="module")
def uploaded(service: RunningService, tmp_path_factory: pytest.TempPathFactory) -> Document:
    parts = [box((9.0, -4.0, -3.0), (9.2, 4.0, 3.0), PLASTER), *(sphere(c.tolist(), RADIUS_M) for c in CENTRES)]
    scene = scene_from_parts("spheres", parts, [])
    scan = scan_scene(scene, RigidTransform.identity(), SCANNER, np.random.default_rng(3))
    path: Path = tmp_path_factory.mktemp("targets") / "spheres.ptx"
    path.write_text(_as_ptx(scan))
    return service.upload(path)


def test_spheres_are_found_and_named(service: RunningService, uploaded: Document) -> None:
    turned = CENTRES @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) + 100.0
    names = [{"name": f"S{k}", "x": x, "y": y, "z": z} for k, (x, y, z) in enumerate(turned.tolist())]
    inputs = {
        "station": {"name": "A", "scan": {"file": uploaded["id"]}},
        "kinds": [{"kind": "sphere", "radius_m": RADIUS_M}],
        "names": [*names, {"name": "elsewhere", "x": 120.0, "y": 90.0, "z": 101.0}],
    }
    result = service.result(service.execute("find-targets", inputs))
    assert result["naming"]["status"] == "determined"
    assert sorted(each["name"] for each in result["targets"]) == ["S0", "S1", "S2", "S3"]
    errors = [np.array(each["xyz_m"]) - CENTRES[int(each["name"][1:])] for each in result["targets"]]
    covariances = [np.array(each["covariance_m2"]) for each in result["targets"]]
    squares = [float(e @ np.linalg.solve(c, e)) for e, c in zip(errors, covariances, strict=True)]
    assert sum(squares) < CHI_SQUARE_12
    table = service.get(result["artifacts"][0]["href"]).text.splitlines()
    assert len(table) == 5


def test_intensities_under_zero_show_the_same_boards_and_come_back_as_shares(
    service: RunningService, tmp_path: Path
) -> None:
    """PTS has intensities from -2047 to 2048: found targets, and files of all ranges, are those of shares."""
    places = np.array([[6.0, 0.4, 0.25], [5.5, -0.4, 0.2], [5.8, 0.35, -0.2]])
    boards = [part for place in places for part in checker_board(facing(place, -place, 0.4), BOARD_M)]
    scene = scene_from_parts("boards", [box((9.0, -4.0, -3.0), (9.2, 4.0, 3.0), PLASTER), *boards], [])
    scan = scan_scene(scene, RigidTransform.identity(), BOARD_SCANNER, np.random.default_rng(4))
    assert scan.intensity is not None
    shares = scan.intensity / scan.intensity.max()
    shares[shares.argmin()] = 0.0
    found, written = {}, {}
    for name, values in {"shares": shares, "signed": np.rint(4095.0 * shares - 2047.0)}.items():
        (tmp_path / f"{name}.ptx").write_text(_as_ptx(replace(scan, intensity=values.astype(np.float32))))
        station = {"name": "A", "scan": {"file": service.upload(tmp_path / f"{name}.ptx")["id"]}}
        inputs = {"station": station, "kinds": [{"kind": "board", "size_m": BOARD_M}]}
        result = service.result(service.execute("find-targets", inputs))
        found[name] = np.array(sorted(each["xyz_m"] for each in result["targets"]))
        said = "intensities from -2047 to 2048 are read as shares from 0 to 1 of the range -2047 … 2048"
        assert (said in result["remarks"]) == (name == "signed")
        for ending in ("pts", "ptx"):
            file = service.result(service.execute("transform", {"stations": [station], "format": ending}))["files"][0]
            text = service.get(file["href"]).text.splitlines()
            table = np.array([line.split() for line in text[1 if ending == "pts" else 10 :]], dtype=np.float64)
            written[name, ending] = table[table[:, :3].any(axis=1), 3]
    assert len(found["signed"]) == len(places)
    np.testing.assert_allclose(found["signed"], found["shares"], atol=1e-4)
    np.testing.assert_allclose(written["signed", "ptx"], written["shares", "ptx"], atol=0.5 / 4095.0 + 0.51e-4)
    assert (written["signed", "ptx"].min(), written["signed", "ptx"].max()) == (0.0, 1.0)
    np.testing.assert_allclose(written["signed", "pts"], written["shares", "pts"], atol=1.0)
    assert (written["signed", "pts"].min(), written["signed", "pts"].max()) == (-2048.0, 2047.0)


def test_boards_are_measured_in_a_photo_and_adjust_and_calibration_take_them(
    service: RunningService, tmp_path: Path
) -> None:
    rng = np.random.default_rng(4)
    places = np.array([[6.0, 0.4, 0.25], [5.5, -0.4, 0.2], [5.8, 0.35, -0.2], [6.2, -0.12, -0.26], [6.1, 0.0, 0.3]])
    boards = [part for place in places for part in checker_board(facing(place, -place, 0.4), BOARD_M)]
    scene = scene_from_parts("boards", [box((9.0, -4.0, -3.0), (9.2, 4.0, 3.0), PLASTER), *boards], [])
    (tmp_path / "boards.ptx").write_text(_as_ptx(scan_scene(scene, RigidTransform.identity(), BOARD_SCANNER, rng)))
    daylight = Daylight(azimuth_rad=3.1, elevation_rad=0.6)
    Image.fromarray(render_photo(scene, SCAN_FROM_CAMERA, VirtualCamera(camera=CAMERA), rng, daylight)).save(
        tmp_path / "boards.png"
    )
    scan, photo = service.upload(tmp_path / "boards.ptx"), service.upload(tmp_path / "boards.png")
    camera = {key: value for key, value in asdict(CAMERA).items() if value}
    shown = {"file": photo["id"], "camera": camera, "scan_from_camera": SCAN_FROM_CAMERA.as_matrix().tolist()}
    inputs = {
        "station": {"name": "A", "scan": {"file": scan["id"]}, "photos": [shown]},
        "kinds": [{"kind": "board", "size_m": BOARD_M}],
    }
    result = service.result(service.execute("find-targets", inputs))
    truth = CAMERA.image_from_camera(SCAN_FROM_CAMERA.inv().apply(places))
    points = result["photos"][0]["points"]
    assert len(points) == 5
    for point in points:
        error = np.array([point["x_px"], point["y_px"]]) - truth
        assert np.linalg.norm(error, axis=1).min() < 0.05
    files = {each["name"]: service.get(each["href"]) for each in result["artifacts"]}
    network = files["hybrid-network.json"].json()
    adjusted = service.result(service.execute("adjust", {"network": network}))
    assert adjusted["status"] == "adjusted"
    assert adjusted["redundancy"] == 10
    assert adjusted["global_test"]["passed"]
    field = files["calibration-field.json"].json()
    values = {"f": CAMERA.fy, "cx": CAMERA.cx, "cy": CAMERA.cy}
    lens = {"width": CAMERA.width, "height": CAMERA.height, "unknown": ["f"], "values": values}
    calibrated = service.result(service.execute("calibrate-camera", {"field": field, "camera": lens}))
    assert calibrated["parameters"][0]["value"] == pytest.approx(CAMERA.fy, abs=5.0)


def test_a_name_that_stands_twice_is_pointed_at(service: RunningService, uploaded: Document) -> None:
    point = {"name": "S", "x": 0.0, "y": 0.0, "z": 0.0}
    inputs = {
        "station": {"name": "A", "scan": {"file": uploaded["id"]}},
        "kinds": [{"kind": "sphere", "radius_m": -1.0}],
        "names": [point, point],
    }
    answer = service.post("/processes/find-targets/execution", json={"inputs": inputs})
    assert answer.status_code == 400
    assert "/inputs/kinds/0" in answer.text
    inputs["kinds"] = [{"kind": "sphere", "radius_m": 0.1}]
    answer = service.post("/processes/find-targets/execution", json={"inputs": inputs})
    assert answer.status_code == 400
    assert "/inputs/names/1/name" in answer.text
