"""A camera is calibrated over HTTP: from image points of a field, and from photos of a board."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from algorithms.arrays import Array
from tests.e2e.running.running_service import RunningService
from tests.scenes.calibration_fields import TRUTH, mounted_field


def test_a_field_before_the_scanner_gives_camera_and_mount(service: RunningService) -> None:
    result = service.result(service.execute("calibrate-camera", mounted_field(seed=8)))
    found = {each["name"]: each for each in result["parameters"]}
    assert all(abs(found[name]["value"] - TRUTH[name]) < 4.0 * found[name]["std"] for name in TRUTH)
    assert result["mount"]["effects"][0]["distance_m"] == 10.0
    names = [each["name"] for each in result["artifacts"]]
    assert names == ["photo.json", "opencv.yml", "photomodeler.txt", "riscan.xml", "residuals.csv"]


def test_a_parameter_of_another_model_is_refused_with_a_pointer(service: RunningService) -> None:
    inputs = mounted_field(seed=8)
    inputs["camera"]["unknown"] = ["K1"]
    answer = service.post("/processes/calibrate-camera/execution", json={"inputs": inputs})
    assert answer.status_code == 400
    assert "/inputs/camera/unknown/0" in answer.text


def board_photo(turn: tuple[float, float, float], distance_px: float = 800.0) -> Array:
    """Draw a photo of a board of 9 by 6 corners."""
    square, columns, rows = 60, 10, 7
    tiles = (np.add.outer(np.arange(rows), np.arange(columns)) % 2 * 255).astype(np.uint8)
    board = cv2.copyMakeBorder(
        np.kron(tiles, np.ones((square, square), dtype=np.uint8)), 60, 60, 60, 60, cv2.BORDER_CONSTANT, value=255
    )
    camera = np.array([[distance_px, 0.0, 326.0], [0.0, distance_px, 240.0], [0.0, 0.0, 1.0]])
    metres = np.array([[0.03 / square, 0.0, -0.18], [0.0, 0.03 / square, -0.135], [0.0, 0.0, 1.0]])
    rotation = Rotation.from_euler("XYZ", turn, degrees=True).as_matrix()
    plane = np.column_stack([rotation[:, 0], rotation[:, 1], [0.0, 0.0, 0.62]])
    image = cv2.warpPerspective(board, camera @ plane @ metres, (640, 480), flags=cv2.INTER_AREA, borderValue=200)
    return cv2.GaussianBlur(image, (5, 5), 0.8)


TURNS = ((0, 0, 0), (35, 0, 3), (-35, 0, 5), (0, 35, 4), (0, -35, 90), (25, 25, 92), (-25, 20, 6))


@pytest.fixture(scope="module")
def photos() -> list[bytes]:
    return [png(board_photo(turn)) for turn in TURNS]


def png(image: Array) -> bytes:
    return cv2.imencode(".png", image)[1].tobytes()


def board_inputs(service: RunningService, folder: Path, photos: list[bytes]) -> dict[str, Any]:
    references = []
    for k, data in enumerate(photos):
        path = folder / f"board{k}.png"
        path.write_bytes(data)
        references.append({"file": service.upload(path)["id"]})
    return {
        "photos": references, "board": {"columns": 9, "rows": 6, "square_m": 0.03},
        "camera": {"width": 640, "height": 480, "unknown": ["f", "cx", "cy", "k1"]},
    }  # fmt: skip


def test_photos_of_a_chessboard_give_the_camera(service: RunningService, photos: list[bytes], tmp_path: Path) -> None:
    result = service.result(service.execute("calibrate-camera", board_inputs(service, tmp_path, photos)))
    assert abs(result["camera"]["fx"] - 800.0) < 4.0
    assert np.hypot(result["camera"]["cx"] - 326.0, result["camera"]["cy"] - 240.0) < 4.0
    assert result["rms_px"] < 0.3


def test_photos_given_twice_count_once_and_turned_ones_are_turned_back(
    service: RunningService, photos: list[bytes], tmp_path: Path
) -> None:
    turned = [*photos[:5], *(png(cv2.rotate(board_photo(turn), cv2.ROTATE_180)) for turn in TURNS[5:])]
    once = service.result(service.execute("calibrate-camera", board_inputs(service, tmp_path, turned)))
    assert "turned by 180° to fit the camera of the other photos: board5.png, board6.png" in once["remarks"]
    assert np.hypot(once["camera"]["cx"] - 326.0, once["camera"]["cy"] - 240.0) < 4.0
    copied = board_inputs(service, tmp_path, [*turned, png(board_photo(TURNS[1]))])
    result = service.result(service.execute("calibrate-camera", copied))
    assert "board7.png shows what board1.png shows; it was counted once" in result["remarks"]
    assert result["parameters"] == once["parameters"]


def test_photos_with_another_zoom_fail_by_name(service: RunningService, photos: list[bytes], tmp_path: Path) -> None:
    zoomed = [*photos, *(png(board_photo(turn, 700.0)) for turn in TURNS[1:4])]
    job = service.execute("calibrate-camera", board_inputs(service, tmp_path, zoomed))
    assert service.finished(job)["status"] == "failed"
    text = service.get(f"/jobs/{job}/results").text
    assert "2 principal distances" in text
    assert ": board7.png, board8.png, board9.png" in text


def test_photos_from_one_direction_fail_with_what_is_missing(
    service: RunningService, photos: list[bytes], tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("front") / "front.png"
    path.write_bytes(photos[0])
    reference = {"file": service.upload(path)["id"]}
    inputs = {
        "photos": [reference], "board": {"columns": 9, "rows": 6, "square_m": 0.03},
        "camera": {"width": 640, "height": 480, "unknown": ["f", "cx", "cy"]},
    }  # fmt: skip
    job = service.execute("calibrate-camera", inputs)
    assert service.finished(job)["status"] == "failed"
    assert "tilted by 20 to 45 degrees" in service.get(f"/jobs/{job}/results").text
    other = service.execute("calibrate-camera", inputs | {"camera": inputs["camera"] | {"width": 1280}})
    assert service.finished(other)["status"] == "failed"
    assert "front.png is not 1280 by 480 pixels" in service.get(f"/jobs/{other}/results").text
