"""Photos of a station in a job: poses in any convention, names of stored features, pictures."""

import json
from pathlib import Path
from typing import Any, get_args

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.features.photo_lines.photo_line_options import PhotoLineOptions
from algorithms.features.photo_lines.photo_lines import add_photo_lines
from algorithms.geometry.camera_mounts import CameraAxes
from algorithms.geometry.lines import LineSource
from algorithms.photos.station_photo import StationPhoto, mount_covariance
from algorithms.progress import NoProgress
from schemas.requests.extract_lines_inputs import ExtractLinesInputs
from schemas.values.photos import AxesName
from schemas.values.photos import StationPhoto as RequestedPhoto
from service.errors import UnreadableFileError
from service.formats.photo import PhotoInfo, camera_document
from service.names.feature_keys import feature_key, photos_identity
from service.ports import StepContext
from service.processes.extract_lines import ExtractLinesPlan
from service.settings import Settings
from service.use_cases.reports.edges_drawing import LINE_COLORS, lines_png
from service.use_cases.steps.station_photos import pose_of_camera, read_station_photo
from tests.doubles.memory import MemoryBlobStore
from tests.scenes.photos.photo_wall import CAMERA, CORNERS, SCAN_FROM_CAMERA, wall_photo, wall_scan
from tests.unit.algorithms.features.photo_lines.test_photo_lines import scan_lines
from tests.unit.service.formats.test_formats_e57_photos import Picture, written

POSE = RigidTransform.from_components([0.1, -0.2, 0.3], Rotation.from_rotvec([0.4, 1.1, -0.3]))
STORED = PhotoInfo(0, "", 640, 480, scan_from_camera=SCAN_FROM_CAMERA, scan=0)
FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
"""From a camera that looks along -z with y up to one that looks along z with y down."""
TURN = RigidTransform.from_rotation(Rotation.from_rotvec([0.0, 0.0, 0.25 * np.pi]))


def matrix(pose: RigidTransform) -> list[list[float]]:
    rows: list[list[float]] = pose.as_matrix().tolist()
    return rows


@pytest.mark.parametrize(
    ("request_fields", "expected"),
    [
        ({"scan_from_camera": matrix(POSE)}, POSE.as_matrix()),
        ({"scan_from_camera": matrix(POSE), "camera_axes": "right-up-backward"}, POSE.as_matrix() @ FLIP),
        ({"mount": matrix(POSE), "cop_gon": 50.0}, (TURN * POSE.inv()).as_matrix()),
        ({"mount": matrix(POSE), "cop": matrix(TURN)}, (TURN * POSE.inv()).as_matrix()),
        ({}, SCAN_FROM_CAMERA.as_matrix()),
    ],
)
def test_the_pose_of_the_camera_comes_as_given_chained_or_from_the_file(
    request_fields: dict[str, Any], expected: np.ndarray
) -> None:
    photo = RequestedPhoto.model_validate_json(json.dumps({"file": "f", **request_fields})).model_dump(mode="json")
    found = pose_of_camera(photo, STORED)
    assert found is not None
    np.testing.assert_allclose(found.as_matrix(), expected, atol=1e-12)


REQUEST = {
    "file": "f",
    "filename": "a.png",
    "sha256": "ab",
    "index": 0,
    "camera": camera_document(CAMERA),
    "scan_from_camera": matrix(POSE),
    "mount_std": {"rotation_gon": 0.02, "translation_m": 0.003},
}


@pytest.mark.parametrize(
    "change",
    [
        {"sha256": "cd"},
        {"index": 1},
        {"camera": {**camera_document(CAMERA), "k1": 0.0}},
        {"scan_from_camera": matrix(TURN)},
        {"mount_std": {"rotation_gon": 0.03, "translation_m": 0.003}},
    ],
)
def test_features_of_another_photo_camera_pose_or_mount_have_another_name(change: dict[str, Any]) -> None:
    options = {"edges": {}}
    names = {feature_key("s", 0, {}, photos_identity([p], options)) for p in (REQUEST, {**REQUEST, **change})}
    assert len(names) == 2


def test_features_of_other_options_or_without_photos_have_another_name() -> None:
    names = [photos_identity(photos, options) for photos in ([], [REQUEST]) for options in ({"a": 1}, {"a": 2})]
    assert len({feature_key("s", 0, {}, each) for each in names}) == 3


def test_the_same_photo_uploaded_again_has_the_same_features() -> None:
    again = {**REQUEST, "file": "g", "filename": "b.png"}
    assert photos_identity([again], {}) == photos_identity([REQUEST], {})


def context() -> StepContext:
    limits = {name: value for name, value in Settings().model_dump().items() if isinstance(value, int)}
    blobs = MemoryBlobStore()
    blobs.write_bytes("files/ab", bytes(cv2.imencode(".png", wall_photo())[1]))
    return StepContext(blobs, NoProgress(), limits)


def test_a_photo_is_read_with_camera_pose_and_mount() -> None:
    read = read_station_photo(REQUEST, context())
    np.testing.assert_array_equal(read.image, wall_photo())
    assert read.camera == CAMERA
    std = np.sqrt(np.diag(read.mount_covariance))
    np.testing.assert_allclose(std, [0.02 * np.pi / 200.0] * 3 + [0.003] * 3)


@pytest.mark.parametrize("missing", ["camera", "scan_from_camera"])
def test_a_photo_without_camera_or_pose_cannot_be_read(missing: str) -> None:
    with pytest.raises(UnreadableFileError, match="camera or pose"):
        read_station_photo({**REQUEST, missing: None}, context())


def test_camera_and_pose_may_come_from_an_e57_file(tmp_path: Path) -> None:
    picture = Picture(pose=POSE, distortion={"K1": -0.02})
    without = context()
    without.blobs.write_bytes("files/ab", written(tmp_path / "a", [picture], [TURN]).read_bytes())
    request = {**REQUEST, "filename": "a.e57", "camera": None, "scan_from_camera": None}
    read = read_station_photo(request, without)
    assert read.camera.k1 == -0.02
    np.testing.assert_allclose(read.scan_from_camera.as_matrix(), (TURN.inv() * POSE).as_matrix() @ FLIP, atol=1e-12)


def test_requests_name_every_kind_of_camera_axes() -> None:
    assert get_args(AxesName) == tuple(axes.value for axes in CameraAxes)


def test_the_plan_hands_photos_and_options_to_the_features_step() -> None:
    photo = {"file": "p", "camera": camera_document(CAMERA), "scan_from_camera": matrix(POSE)}
    station = {"name": "S", "scan": {"file": "s"}, "photos": [photo]}
    body = {"station": station, "photo_lines": {"edges": {"min_length_px": 33.0}}}
    inputs = ExtractLinesInputs.model_validate_json(json.dumps(body)).model_dump(mode="json")
    files = {name: {"name": f"{name}.bin", "sha256": name * 2} for name in ("s", "p")}
    (call,) = ExtractLinesPlan().next_stage({"id": "j", "inputs": inputs, "files": files}, []) or []
    assert call.arguments["photo_options"]["edges"]["min_length_px"] == 33.0
    assert [(each["filename"], each["sha256"]) for each in call.arguments["photos"]] == [("p.bin", "pp")]


def test_lines_are_drawn_where_the_photo_shows_them() -> None:
    photo = StationPhoto(wall_photo(), CAMERA, SCAN_FROM_CAMERA, mount_covariance(1e-5, 1e-4))
    features = add_photo_lines(scan_lines(), wall_scan(), [photo], PhotoLineOptions(), count=1, progress=NoProgress())
    png = lines_png(photo.image, CAMERA, SCAN_FROM_CAMERA, features)
    picture = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR_RGB)
    assert picture.shape == photo.image.shape
    middles = 0.5 * (CORNERS + np.roll(CORNERS, -1, axis=0))
    for column, row in np.rint(CAMERA.image_from_camera(SCAN_FROM_CAMERA.inv().apply(middles))).astype(int):
        near = picture[row - 1 : row + 2, column - 1 : column + 2].reshape(-1, 3).astype(float)
        # antialiased: the line's colour within a part of its contrast
        assert np.abs(near - np.array(LINE_COLORS[LineSource.PHOTO_EDGE])).sum(axis=1).min() < 150.0
