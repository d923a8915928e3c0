"""Calibrations through the process `calibrate-camera`, without the web."""

import json
from typing import Any

import cv2
import numpy as np
import pytest
from defusedxml.ElementTree import fromstring

from algorithms.calibration.lenses import LENSES
from algorithms.calibration.solution import CalibrationOptions, calibrate
from schemas.requests.calibrate_camera_inputs import CalibrateCameraInputs
from schemas.requests.riscan_projects import network_of_riscan
from schemas.results.calibration_result import CalibrationDocument
from service.errors import InvalidRequestError
from service.processes.calibrate_camera.calibrating import calibration_document, download_files
from service.processes.calibrate_camera.checking import LENS_PARAMETERS, check_calibration
from service.processes.calibrate_camera.reading import board_corners, board_places, field_of
from tests.scenes.calibration_fields import MOUNT_PLACE, TRUTH, mounted_field

INPUTS = mounted_field(seed=5)


def _calibrated(given: dict[str, Any]) -> tuple[CalibrationDocument, dict[str, tuple[str, bytes]]]:
    inputs = CalibrateCameraInputs.model_validate_json(json.dumps(given)).model_dump(mode="json")
    done = calibrate(field_of(inputs), CalibrationOptions(inputs["scaled_stds"], inputs["gross_errors"]))
    document = calibration_document(done, inputs, [])
    return document, download_files(document, done, inputs)


@pytest.fixture(scope="module")
def calibrated() -> tuple[CalibrationDocument, dict[str, tuple[str, bytes]]]:
    return _calibrated(INPUTS)


def test_camera_and_mount_come_out_with_what_is_sure_of_them(calibrated: Any) -> None:
    document: CalibrationDocument = calibrated[0]
    values = {each.name: each for each in document.parameters}
    for name, true in TRUTH.items():
        std = values[name].std
        assert std is None or abs(values[name].value - true) < 4.0 * std
    assert document.mount is not None
    misses = np.array(document.mount.head_from_camera)[:3, 3] - MOUNT_PLACE
    assert (np.abs(misses) < 4.0 * np.array(document.mount.std_m)).all()
    near, far = document.mount.effects
    assert near.std_mm < far.std_mm < 50.0
    assert document.halves.done is False
    assert "photos are too few" in (document.halves.reason or "")


def test_the_camera_is_written_for_other_programs(calibrated: Any, tmp_path: Any) -> None:
    document, files = calibrated
    photo = json.loads(files["photo.json"][1])
    assert photo["camera"] == document.camera.model_dump()
    path = tmp_path / "camera.yml"
    path.write_bytes(files["opencv.yml"][1])
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    matrix, terms = storage.getNode("camera_matrix").mat(), storage.getNode("distortion_coefficients").mat()
    assert (matrix[0, 0], matrix[1, 2], terms[0, 0]) == (document.camera.fx, document.camera.cy, document.camera.k1)
    brown = next(each for each in document.exports if each.model == "brown")
    assert brown.largest_difference_px < 1.0  # another model of a strong distortion
    assert b"focal length: 7.5" in files["photomodeler.txt"][1]


def test_a_project_of_riscan_takes_camera_and_mount(calibrated: Any) -> None:
    document, files = calibrated
    calibrations = fromstring(files["riscan.xml"][1])
    identity = " ".join(str(value) for value in np.eye(4).ravel())
    rest = f"""<project name="P"><scanpositions><scanposition name="S"><sop><matrix>{identity}</matrix></sop>
        <scanposimages><scanposimage name="I"><camcalib_ref noderef="/project/calibrations/camcalibs/calibrated"/>
        <mountcalib_ref noderef="/project/calibrations/mountcalibs/calibrated"/><cop><matrix>{identity}</matrix></cop>
        </scanposimage></scanposimages></scanposition></scanpositions></project>"""
    project = fromstring(rest)
    project.append(calibrations)
    network = network_of_riscan(project)
    camera, (_, photo) = network["cameras"][0], network["stations"]
    assert (camera["principal_distance_px"], camera["x0_px"]) == (document.camera.fy, document.camera.cx)
    place = [photo["approx"][axis] for axis in "XYZ"]
    np.testing.assert_allclose(place, np.array(document.mount.head_from_camera)[:3, 3], atol=1e-9)


def test_an_earlier_camera_is_compared_and_a_changed_one_told() -> None:
    same, _ = _calibrated(INPUTS | {"earlier": {"values": TRUTH}})
    other, _ = _calibrated(INPUTS | {"earlier": {"values": TRUTH | {"f": TRUTH["f"] + 20.0}}})
    assert same.before_after is not None
    assert other.before_after is not None
    assert (same.before_after.changed, other.before_after.changed) == (False, True)


def test_an_earlier_calibration_observed_makes_the_result_surer(calibrated: Any) -> None:
    camera = INPUTS["camera"] | {"values": TRUTH, "std": {"f": 0.05}}
    observed, _ = _calibrated(INPUTS | {"camera": camera})
    stds = [next(p.std for p in each.parameters if p.name == "f") for each in (observed, calibrated[0])]
    assert stds[0] is not None
    assert stds[0] < 0.05 < (stds[1] or 0.0)


def test_names_that_are_not_there_are_pointed_at() -> None:
    given = json.loads(json.dumps(INPUTS))
    given["field"]["image_points"][3]["target"] = "nowhere"
    given["camera"]["unknown"] = ["f", "K1"]
    with pytest.raises(InvalidRequestError) as refused:
        check_calibration(CalibrateCameraInputs.model_validate_json(json.dumps(given)), stored=None)  # type: ignore[arg-type]
    pointers = [fault.pointer for fault in refused.value.faults]
    assert pointers == ["/inputs/camera/unknown/1", "/inputs/field/image_points/3/target"]


def test_the_web_process_knows_the_parameters_of_every_lens() -> None:
    assert {name: lens.names for name, lens in LENSES.items()} == LENS_PARAMETERS


@pytest.mark.parametrize("kind", ["chessboard", "charuco"])
def test_the_corners_of_a_drawn_board_are_found_where_they_are(kind: str) -> None:
    board = {"kind": kind, "columns": 7, "rows": 5, "square_m": 0.04, "marker_m": 0.03, "dictionary": "5X5_250"}
    square, rim = 60, 80
    if kind == "charuco":
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_250)
        drawn = cv2.aruco.CharucoBoard((7, 5), 0.04, 0.03, dictionary).generateImage((7 * square, 5 * square))
    else:
        tiles = (np.add.outer(np.arange(6), np.arange(8)) % 2 * 255).astype(np.uint8)
        drawn = np.kron(tiles, np.ones((square, square), dtype=np.uint8))
    grey = cv2.copyMakeBorder(drawn, rim, rim, rim, rim, cv2.BORDER_CONSTANT, value=255)
    found = board_corners(grey, board)
    assert found is not None
    numbers, corners = found
    places, _ = board_places(board)
    at = places[numbers, :2] / 0.04 * square
    # a chessboard looks the same from both ends
    turned = np.abs(corners - corners.mean(axis=0) + at - at.mean(axis=0)).max() < 1.0
    apart = corners - (at[::-1] if turned else at)
    assert len(numbers) == len(places)
    assert np.abs(apart - apart.mean(axis=0)).max() < 0.3
