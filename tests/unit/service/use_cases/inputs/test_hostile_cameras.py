"""Cameras and poses that are nonsense but allowed: lines with sound covariances, or a refusal that says why.

`TIELINE_FUZZ_CAMERAS` is the number of photos.
"""

import hashlib
import os
from collections import Counter
from typing import Any

import cv2
import numpy as np
import pytest

from algorithms.errors import AlgorithmError
from algorithms.progress import NoProgress
from schemas.requests.extract_lines_inputs import ExtractLinesInputs
from service.errors import InvalidRequestError, ServiceError, to_problem
from service.formats.photo import camera_document
from service.names.content_keys import content_key
from service.ports import StepContext
from service.settings import Settings
from service.use_cases.inputs.check_photos import camera_of
from service.use_cases.inputs.validate_request import validated
from service.use_cases.steps.station_photos import with_photo_lines
from tests.doubles.memory import MemoryBlobStore
from tests.scenes.hostile.hostile_requests import GENTLE, damaged_request
from tests.scenes.photos.photo_wall import CAMERA, SCAN_FROM_CAMERA, wall_photo, wall_scan
from tests.unit.algorithms.features.photo_lines.test_photo_lines import scan_lines

pytestmark = pytest.mark.service

LIMITS = ("max_points", "max_photo_pixels")
TAKEN = int(os.environ.get("TIELINE_FUZZ_CAMERAS", "6"))
GIVEN: dict[str, Any] = {
    "camera": camera_document(CAMERA),
    "scan_from_camera": SCAN_FROM_CAMERA.as_matrix().tolist(),
    "mount_std": {"rotation_gon": 0.02, "translation_m": 0.003},
}


@pytest.fixture(scope="module")
def stored() -> tuple[StepContext, str]:
    """Give a context that has the photo, and the photo's hash."""
    coded, data = cv2.imencode(".png", wall_photo())
    assert coded
    sha256 = hashlib.sha256(data.tobytes()).hexdigest()
    blobs = MemoryBlobStore()
    blobs.write_bytes(content_key(sha256), data.tobytes())
    return StepContext(blobs, NoProgress(), {name: getattr(Settings(), name) for name in LIMITS}), sha256


def taken(number: int) -> dict[str, Any] | None:
    """Give a damaged photo as a job would have it; None when the request is refused."""
    photo = {"file": "f", **damaged_request(GIVEN, number, GENTLE)}
    station = {"name": "S1", "scan": {"file": "s"}, "photos": [photo]}
    try:
        inputs = validated(ExtractLinesInputs, {"station": station}, "/inputs")
        found: dict[str, Any] = inputs.station.photos[0].model_dump(mode="json")
        camera_of(found["camera"])
    except (InvalidRequestError, AlgorithmError):
        return None
    return found if (found["camera"]["width"], found["camera"]["height"]) == (CAMERA.width, CAMERA.height) else None


def outcome(photo: dict[str, Any], stored: tuple[StepContext, str]) -> str:
    context, sha256 = stored
    named = {**photo, "sha256": sha256, "filename": "a.png"}
    try:
        features = with_photo_lines(scan_lines(), wall_scan(), [named], {}, context, NoProgress())
    except (AlgorithmError, ServiceError) as error:
        problem = to_problem(error)
        assert problem["status"] < 500, problem
        assert problem["detail"], problem
        return "refused"
    lines = features.lines
    assert np.isfinite(lines.anchors).all()
    assert np.isfinite(lines.covariances).all()
    # rounding of the largest of them
    least = np.linalg.eigvalsh(lines.covariances).min(axis=1)
    assert (least >= -1e-9 * np.abs(lines.covariances).max(axis=(1, 2))).all()
    return "lines" if len(lines) > len(scan_lines().lines) else "none"


def test_what_a_request_may_say_of_cameras_never_breaks_a_computation(stored: tuple[StepContext, str]) -> None:
    outcomes: Counter[str] = Counter()
    numbers = (number for number in range(10_000) if taken(number) is not None)
    for number in [next(numbers) for _ in range(TAKEN)]:
        photo = taken(number)
        assert photo is not None
        try:
            outcomes[outcome(photo, stored)] += 1
        except (ArithmeticError, RuntimeWarning, ValueError, IndexError) as fault:
            pytest.fail(f"{number}: {fault!r} from {photo}")
    print(f"\n{dict(outcomes)}")
