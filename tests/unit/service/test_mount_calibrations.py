"""Mounts through the process `calibrate-mount`, without the web."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import RigidTransform

from algorithms.calibration.edge_options import EdgeCalibrationOptions
from algorithms.calibration.natural_edges import mounts_from_edges
from algorithms.photos.station_photo import mount_covariance
from schemas.requests.calibrate_mount_inputs import CalibrateMountInputs
from schemas.results.mounts_result import MountsDocument
from service.processes.calibrate_mount import CALIBRATE_MOUNT
from service.processes.calibrate_mount.comparing import ReadPhotos, mounts_document, photo_list
from service.processes.calibrate_mount.documents import stated_mount
from tests.scenes.photos.edge_rooms import EdgeRoom, edge_room

PLANTED = np.array([0.0012, -0.0016, 0.0, 0.003, 0.0, -0.004])
ROWS = np.eye(4).tolist()
PHOTO: dict[str, Any] = {"file": "p", "index": 0, "cop_gon": 20.0, "mount": ROWS, "mount_std": {}}
STATION: dict[str, Any] = {"name": "hall", "scan": {"file": "s", "index": 0}, "photos": [PHOTO]}
INPUTS = json.loads(CalibrateMountInputs.model_validate({"stations": [STATION]}).model_dump_json())


def described(room: EdgeRoom) -> tuple[MountsDocument, Any]:
    requested = [{**INPUTS["stations"][0]["photos"][0], "filename": f"{k}.jpg"} for k in range(len(room.photos))]
    stated = [photo.scan_from_camera for photo in room.photos]
    names = [f"hall {k + 1}" for k in range(len(room.photos))]
    stds = [mount_covariance(3e-4, 0.003)] * len(room.photos)
    read = ReadPhotos(room.photos, stated, requested, names, ["camera 1"], stds)
    done = mounts_from_edges(room.stations, room.photos, EdgeCalibrationOptions(rounding_std_m=0.0))
    document = mounts_document(done, read, room.stations, INPUTS)
    return document, photo_list(document, read, INPUTS, [{"filename": "hall.e57"}])


@pytest.fixture(scope="module")
def wrong() -> tuple[EdgeRoom, MountsDocument, Any]:
    room = edge_room(np.random.default_rng(1), error=PLANTED)
    return room, *described(room)


def test_a_wrong_mount_is_said_with_figures_and_a_list_of_corrected_photos(wrong: Any) -> None:
    room, document, listed = wrong
    (mount,) = document.mounts
    assert mount.status == "wrong"
    assert mount.allowed_by_std is False
    assert "wrong by 0.12" in mount.text
    values = np.array([each.value for each in mount.parameters])
    np.testing.assert_allclose(values[:3], PLANTED[:3] * 200.0 / np.pi, atol=0.005)
    np.testing.assert_allclose(values[3:], PLANTED[3:] * 1e3, atol=0.6)
    near, far = mount.changes
    assert near.change_mm < far.change_mm
    (station,) = listed["stations"]
    assert station["scan"]["file"] == "hall.e57"
    for photo, entry in zip(room.photos, station["photos"], strict=True):
        assert not {"mount", "cop_gon", "camera_axes"} & entry.keys()
        true = photo.scan_from_camera * RigidTransform.from_rotation(
            RigidTransform.from_exp_coords(np.concatenate([PLANTED[:3], np.zeros(3)])).rotation
        )
        found = RigidTransform.from_matrix(np.array(entry["scan_from_camera"]))
        assert (true.rotation.inv() * found.rotation).magnitude() < 1e-4
        assert 0.0 < entry["mount_std"]["rotation_gon"] < 0.01


def test_a_stated_mount_is_given_back_corrected(wrong: Any) -> None:
    _, document, _ = wrong
    (mount,) = document.mounts
    given = stated_mount(PHOTO)
    assert given is not None
    # the pose from the corrected mount is the stated pose times the correction
    corrected = np.linalg.inv(np.array(mount.mount))
    np.testing.assert_allclose(corrected, given.inv().as_matrix() @ np.array(mount.correction), atol=1e-12)


def test_a_right_mount_leaves_the_list_as_it_was() -> None:
    document, listed = described(edge_room(np.random.default_rng(2), error=np.zeros(6)))
    assert document.mounts[0].status == "confirmed"
    assert "fits" in document.mounts[0].text
    assert listed["stations"][0]["photos"][0]["mount"] == ROWS


def test_what_is_not_determined_is_named_with_what_to_add() -> None:
    room = edge_room(np.random.default_rng(3), error=np.zeros(6), std_px=4.0)
    lines = room.stations[0].lines
    upright = np.abs(lines.directions[:, 2]) > 0.9
    document, _ = described(replace(room, stations=[replace(room.stations[0], lines=lines[upright])]))
    (mount,) = document.mounts
    assert mount.status == "undetermined"
    assert [each.value for each in mount.parameters if each.name == "shift along y (down)"] == [None]
    assert any("shift along y (down)" in each.parameters for each in mount.open)
    assert "photograph edges" in mount.text


def test_nothing_is_said_where_nothing_is_seen() -> None:
    room = edge_room(np.random.default_rng(4), error=np.zeros(6))
    empty = replace(room.stations[0], lines=room.stations[0].lines[:0])
    document, _ = described(replace(room, stations=[empty]))
    (mount,) = document.mounts
    assert (mount.status, mount.statistic, mount.median_before_px) == ("undetermined", None, None)
    assert "too few edges" in mount.text
    assert "hall: the scan has no edge" in document.remarks[0]


def test_stations_without_photos_are_refused() -> None:
    with pytest.raises(ValidationError, match="photos"):
        CalibrateMountInputs.model_validate({"stations": [{**STATION, "photos": []}]})


def test_scans_are_read_without_their_photos_and_then_all_photos_at_once() -> None:
    files = {"s": {"name": "hall.e57", "sha256": "a" * 64}, "p": {"name": "p.jpg", "sha256": "b" * 64}}
    job = {"id": "j", "inputs": INPUTS, "files": files}
    first = CALIBRATE_MOUNT.plan.next_stage(job, [])
    assert first is not None
    assert [call.arguments["photos"] for call in first] == [[]]
    (second,) = CALIBRATE_MOUNT.plan.next_stage(job, [[{"features": "f"}]]) or ()
    assert second.name == "calibrate-mount"
    assert second.arguments["photos"][0][0]["filename"] == "p.jpg"
    assert len(second.arguments["reads"]) == 1
    assert CALIBRATE_MOUNT.plan.next_stage(job, [[{}], [{}]]) is None
    assert CALIBRATE_MOUNT.plan.total_weight(job) == sum(call.weight for call in [*first, second])
