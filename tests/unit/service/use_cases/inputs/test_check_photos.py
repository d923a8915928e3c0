"""Photos of a station: what is missing or contradicts is pointed at before anything is computed."""

from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from schemas.requests.register_inputs import ScanReference
from schemas.values.photos import StationPhoto
from service.errors import FieldFault
from service.ports import StoredFile
from service.use_cases.inputs.check_photos import station_photo_faults
from tests.doubles.memory import MemoryFileStore

IDENTITY = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
TILTED = [IDENTITY[0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], IDENTITY[3]]
CAMERA = {"model": "brown", "width": 640, "height": 480, "fx": 500.0, "fy": 500.0, "cx": 320.0, "cy": 240.0}
JPEG, E57 = "1" * 32, "2" * 32
PLAIN = {"index": 0, "name": "", "width": 640, "height": 480, "camera": None, "scan_from_camera": None, "remarks": []}
POSED = {**PLAIN, "camera": CAMERA, "scan_from_camera": IDENTITY, "scan": 1}
GIVEN = {"file": JPEG, "camera": CAMERA, "scan_from_camera": IDENTITY}


@pytest.fixture
def files() -> MemoryFileStore:
    store = MemoryFileStore()
    plain = StoredFile(JPEG, "a.jpg", 9, "", "JPEG", "photo", datetime(2026, 1, 1, tzinfo=UTC), photos=(PLAIN,))
    store.add(plain)
    images = (POSED, {**PLAIN, "index": 1, "refused": "a spherical panorama"})
    store.add(replace(plain, id=E57, name="a.e57", photos=images, scans=({"index": 0}, {"index": 1})))
    return store


def faults(files: MemoryFileStore, photos: Sequence[dict[str, Any]], scan: int = 1) -> list[FieldFault]:
    parsed = TypeAdapter(list[StationPhoto]).validate_python(photos)
    return list(station_photo_faults(parsed, ScanReference(file=E57, index=scan), files, "/photos"))


@pytest.mark.parametrize(
    "photo",
    [
        GIVEN,
        {"file": E57},
        {"file": E57, "camera": CAMERA},
        {"file": JPEG, "camera": CAMERA, "mount": TILTED, "cop_gon": 50.0},
        {"file": JPEG, "camera": CAMERA, "mount": TILTED, "cop": IDENTITY},
    ],
)
def test_camera_and_pose_may_come_from_the_request_or_from_the_file(
    files: MemoryFileStore, photo: dict[str, Any]
) -> None:
    assert faults(files, [photo]) == []


@pytest.mark.parametrize(
    ("photo", "pointer", "what"),
    [
        ({"file": "x"}, "file", "no file"),
        ({**GIVEN, "index": 1}, "index", "holds 1 photo"),
        ({"file": E57, "index": 1, "camera": CAMERA, "scan_from_camera": IDENTITY}, "index", "spherical"),
        ({**GIVEN, "camera": None}, "camera", "interior orientation is missing"),
        ({**GIVEN, "camera": {**CAMERA, "width": 480, "height": 480}}, "camera/width", "width of 640"),
        ({**GIVEN, "camera": {**CAMERA, "k1": -5.0}}, "camera", "distortion"),
        ({**GIVEN, "scan_from_camera": None}, "scan_from_camera", "pose of the camera is missing"),
        ({**GIVEN, "mount": TILTED}, "mount", "either scan_from_camera, or mount"),
        ({"file": JPEG, "camera": CAMERA, "mount": TILTED}, "cop", "missing"),
        ({"file": JPEG, "camera": CAMERA, "cop_gon": 1.0}, "mount", "missing"),
        ({"file": JPEG, "camera": CAMERA, "mount": TILTED, "cop": IDENTITY, "cop_gon": 0.0}, "cop_gon", "twice"),
    ],
)
def test_what_is_missing_or_wrong_is_pointed_at(
    files: MemoryFileStore, photo: dict[str, Any], pointer: str, what: str
) -> None:
    (fault,) = faults(files, [photo])
    assert fault.pointer == f"/photos/0/{pointer}"
    assert what in fault.detail


def test_the_pose_in_the_frame_of_another_scan_is_not_taken(files: MemoryFileStore) -> None:
    (fault,) = faults(files, [{"file": E57}], scan=0)
    assert fault.pointer == "/photos/0/scan_from_camera"
    assert "scan 1" in fault.detail


def test_a_photo_cannot_be_used_twice_at_a_station(files: MemoryFileStore) -> None:
    assert [fault.pointer for fault in faults(files, [GIVEN, GIVEN])] == ["/photos/1"]


@pytest.mark.parametrize("matrix", [TILTED, [[2.0, 0.0, 0.0, 0.0], *IDENTITY[1:]]])
def test_the_head_turns_about_the_scanners_z_axis_only(matrix: list[list[float]]) -> None:
    with pytest.raises(ValueError, match=r"z axis|rotation"):
        StationPhoto(file=JPEG, mount=IDENTITY, cop=matrix)


LARGE = {**PLAIN, "width": 6000, "height": 4000}
GOOD = {"width": 6000, "height": 4000, "fx": 4200.0, "fy": 4201.0, "cx": 2999.5, "cy": 1999.5}


@pytest.fixture
def large() -> MemoryFileStore:
    store = MemoryFileStore()
    photo = StoredFile(JPEG, "a.jpg", 9, "", "JPEG", "photo", datetime(2026, 1, 1, tzinfo=UTC), photos=(LARGE,))
    store.add(photo)
    scan = {"index": 0, "bounds_m": [[-12.0, -9.0, -2.0], [20.0, 14.0, 6.0]]}
    store.add(replace(photo, id=E57, name="a.ply", photos=(), scans=(scan,)))
    return store


@pytest.mark.parametrize(
    ("changed", "pointer", "what"),
    [
        ({"fx": 24.0, "fy": 24.0}, "/photos/0/camera/fx", "millimetres"),
        ({"fx": 35.7, "fy": 4200.0}, "/photos/0/camera/fx", "millimetres"),
        ({"fx": 0.7, "fy": 0.7}, "/photos/0/camera/fy", "millimetres"),
        ({"fx": 4.2e6, "fy": 4.2e6}, "/photos/0/camera/fx", "millimetres"),
        ({"fx": 8400.0}, "/photos/0/camera/fy", "square"),
        ({"cx": 0.0, "cy": 0.0}, "/photos/0/camera/cx", "corner"),
        ({"cx": 18.0, "cy": 12.0}, "/photos/0/camera/cx", "corner"),
        ({"cx": -40.0}, "/photos/0/camera/cx", "outside"),
        ({"cy": 4100.0}, "/photos/0/camera/cy", "outside"),
        ({"k1": -1.5}, "/photos/0/camera", "distortion"),
        ({"width": 4000, "height": 6000, "cy": 2999.5, "cx": 1999.5}, "/photos/0/camera", "exchanged"),
    ],
)
def test_what_no_camera_can_have_is_pointed_at(
    large: MemoryFileStore, changed: dict[str, float], pointer: str, what: str
) -> None:
    photo = {"file": JPEG, "camera": {**GOOD, **changed}, "scan_from_camera": IDENTITY}
    found = {fault.pointer: fault.detail for fault in faults(large, [photo], 0)}
    assert what in found[pointer]


@pytest.mark.parametrize(
    "changed",
    [
        {},
        {"fx": 1700.0, "fy": 1700.0},  # 10 mm on a full frame
        {"fx": 100_000.0, "fy": 100_000.0},  # 600 mm
        {"cy": 150.0},  # a lens shifted upwards
        {"k1": -0.3, "k2": 0.1},
    ],
)
def test_wide_long_and_shifted_lenses_are_cameras(large: MemoryFileStore, changed: dict[str, float]) -> None:
    photo = {"file": JPEG, "camera": {**GOOD, **changed}, "scan_from_camera": IDENTITY}
    assert faults(large, [photo], 0) == []


def test_a_camera_that_stands_millimetres_away_counted_as_metres_is_pointed_at(large: MemoryFileStore) -> None:
    pose = [[1.0, 0.0, 0.0, 80.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 212.0], IDENTITY[3]]
    (fault,) = faults(large, [{"file": JPEG, "camera": GOOD, "scan_from_camera": pose}], 0)
    assert fault.pointer == "/photos/0/scan_from_camera"
    assert "millimetres" in fault.detail


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (np.diag([1.0, 1.0, -1.0, 1.0]), "mirrors"),
        (np.diag([1000.0, 1000.0, 1000.0, 1.0]), "scales by 1000"),
        (np.array([[1.0, 0.3, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]), "perpendicular"),
        (np.zeros((4, 4)) + np.diag([0, 0, 0, 1.0]), "not a rotation"),
    ],
)
def test_a_matrix_that_is_no_motion_is_told_what_it_is(change: np.ndarray, what: str) -> None:
    with pytest.raises(ValidationError, match=what):
        StationPhoto.model_validate({"file": JPEG, "scan_from_camera": change.tolist()})
