"""Targets in photos come out as `adjust` and `calibrate-camera` take them in."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Array
from algorithms.geometry.camera_mounts import CameraAxes, scan_from_camera_with_axes
from algorithms.geometry.cameras import Camera
from algorithms.progress import NoProgress
from algorithms.targets.photo_agreement import ImagePoint, NotSeen
from schemas.requests.adjust_inputs import AdjustInputs
from schemas.requests.calibrate_camera_inputs import CalibrateCameraInputs
from schemas.results.targets_result import TargetDocument
from service.processes.adjust.adjusting import adjusted_document
from service.processes.calibrate_camera.reading import field_of
from service.processes.find_targets.in_photos import (
    SeenPhoto,
    calibration_field,
    hybrid_network,
    image_files,
    photo_documents,
)

CAMERA = Camera(3000, 2000, 1800.0, 1800.9, 1510.0, 990.0, -0.1, 0.09, -0.02, 3e-4, -5e-4)
SCAN_FROM_CAMERA = scan_from_camera_with_axes(
    RigidTransform.from_components([0.05, 0.02, 0.2], Rotation.from_rotvec([0.01, 0.03, 0.3])),
    CameraAxes.FORWARD_LEFT_UP,
)
PLACES = np.array([[5.0, 3.0, 1.0], [6.0, -1.0, 1.5], [5.5, 2.0, -1.5], [7.0, 0.0, -1.0], [6.5, 1.0, 2.0]])
REQUEST = {
    "file": "f", "index": 0, "filename": "A.jpg", "cop_gon": 12.5,
    "mount_std": {"rotation_gon": 0.02, "translation_m": 0.003},
}  # fmt: skip
STD_PX = 0.02


def _target(k: int, place: Array) -> TargetDocument:
    row = tuple((1e-6 * np.eye(3)).tolist())
    return TargetDocument(
        name=f"T{k}", named=False, kind="board", xyz_m=tuple(place), covariance_m2=tuple(map(tuple, row)),
        std_m=(1e-3, 1e-3, 1e-3), points=9, incidence_gon=0.0, quality=1.0, coverage=1.0, contrast=0.5, rms=0.0,
    )  # fmt: skip


TARGETS = [_target(k, place) for k, place in enumerate(PLACES)]


def _seen() -> SeenPhoto:
    """Give what a photo without noise shows: all targets but the last."""
    images = CAMERA.image_from_camera(SCAN_FROM_CAMERA.inv().apply(PLACES))
    own, expected = STD_PX**2 * np.eye(2), np.eye(2)
    answers: list[ImagePoint | NotSeen] = [
        ImagePoint(k, image, own, image, expected, 0.99, 80.0) for k, image in enumerate(images[:-1])
    ]
    hidden = NotSeen(len(answers), "nothing in its window looks like it")
    return SeenPhoto("A.jpg", REQUEST, CAMERA, SCAN_FROM_CAMERA.as_matrix(), [*answers, hidden])


def test_the_network_is_adjusted_without_contradiction() -> None:
    network = hybrid_network("A", [_seen()], TARGETS)
    inputs = AdjustInputs.model_validate({"network": network, "gross_errors": "none"}).model_dump(mode="json")
    document, _ = adjusted_document(inputs, "job", NoProgress())
    # four points: two coordinates of each in the photo, whose mount is observed
    assert document.redundancy == 8
    assert document.rank_defect == 6
    # image points of a lens without noise fit to a part of their standard deviation
    assert document.sigma0 == pytest.approx(0.0, abs=0.1)


def test_the_field_is_one_that_calibrations_read() -> None:
    field = calibration_field([_seen()], TARGETS)
    given = {"field": field, "camera": {"width": 3000, "height": 2000}, "mount": {}}
    read = field_of(CalibrateCameraInputs.model_validate(given).model_dump(mode="json"))
    assert read.target_names == ["T0", "T1", "T2", "T3"]
    np.testing.assert_allclose(read.targets, PLACES[:4])
    np.testing.assert_allclose(read.image_stds, STD_PX)
    assert read.mount is not None
    np.testing.assert_allclose(read.mount.angles_rad, 12.5 * np.pi / 200.0)


def test_what_is_not_seen_is_named_and_photos_without_targets_write_no_files() -> None:
    (document,) = photo_documents([_seen()], [each.name for each in TARGETS])
    assert [point.target for point in document.points] == ["T0", "T1", "T2", "T3"]
    assert [(each.target, each.reason[:7]) for each in document.not_seen] == [("T4", "nothing")]
    assert set(image_files("A", [_seen()], TARGETS)) == {
        "image-points.csv", "hybrid-network.json", "calibration-field.json"
    }  # fmt: skip
    empty = SeenPhoto("A.jpg", REQUEST, CAMERA, SCAN_FROM_CAMERA.as_matrix(), [NotSeen(0, "")])
    assert image_files("A", [empty], TARGETS) == {}
    assert photo_documents([empty], ["T0"])[0].not_seen == []
