"""Isolated far points, other units and copies are named at upload and in the result, and every job ends."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from tests.e2e.files.test_bad_input_over_http import ply
from tests.e2e.running.running_service import RunningService

pytestmark = pytest.mark.service

MOTION = RigidTransform.from_components([0.4, -0.3, 0.1], Rotation.from_euler("zyx", [0.9, 0.02, -0.01]))


def room(seed: int) -> np.ndarray:
    """Walls, floor and ceiling of a room of 7 x 5 x 3 m with a cupboard, off the middle of its frame."""
    rng = np.random.default_rng(seed)
    parts = []
    for low, high in (((-3.0, -2.0, -1.5), (4.0, 3.0, 1.5)), ((2.5, 1.0, -1.5), (4.0, 3.0, 0.3))):
        points = rng.uniform(low, high, (9_000, 3))
        axis, side = rng.integers(3, size=len(points)), rng.integers(2, size=len(points))
        points[np.arange(len(points)), axis] = np.stack([low, high])[side, axis]
        parts.append(points)
    return np.concatenate(parts) + rng.normal(size=(18_000, 3)) * 0.002


Registered = Callable[..., tuple[list[Any], dict[str, Any]]]


@pytest.fixture
def registered(service: RunningService) -> Registered:
    def register(*clouds: np.ndarray) -> tuple[list[Any], dict[str, Any]]:
        forms = [("scan", (f"S{number}.ply", ply(cloud))) for number, cloud in enumerate(clouds, start=1)]
        answer = service.post("/registrations", files=forms)
        assert answer.status_code == 201, answer.text
        result = service.result(answer.json()["jobID"])
        files = [service.get(f"/files/{entry['file']}").json() for entry in result["provenance"]["inputs"]]
        return [file["scans"][0]["warnings"] for file in files], result["pairs"][0] | {"features": result["features"]}

    return register


def test_strays_are_left_out_counted_and_named(registered: Registered) -> None:
    strays = np.random.default_rng(9).uniform(-2e4, 2e4, (40, 3))
    warnings, pair = registered(np.concatenate([room(1), strays]), MOTION.apply(room(2)))
    assert [len(each) for each in warnings] == [1, 0]
    assert "40 isolated points" in warnings[0][0]
    assert [count["left_out_points"] for count in pair["features"]] == [40, 0]
    assert any("S1: 40 isolated points" in reason for reason in pair["reasons"])
    error = RigidTransform.from_matrix(np.array(pair["target_from_source"]["matrix"])) * MOTION
    assert np.linalg.norm(error.translation) < 0.01


def test_millimetres_end_with_an_answer_that_names_them(registered: Registered) -> None:
    warnings, pair = registered(1000.0 * room(1), MOTION.apply(room(2)))
    assert "In millimetres it would measure" in warnings[0][0]
    assert warnings[1] == []
    assert pair["status"] != "accepted"
    assert any("S1 is" in reason and "millimetres" in reason for reason in pair["reasons"])


def test_degrees_beside_heights_are_named(registered: Registered) -> None:
    thread = room(1) * [1e-5, 1e-5, 1.0] + [8.5, 47.4, 400.0]
    warnings, pair = registered(thread, MOTION.apply(room(2)))
    assert "degrees of longitude and latitude" in warnings[0][0]
    assert warnings[1] == []
    assert pair["status"] != "accepted"
    assert any("S1" in reason and "degrees of longitude" in reason for reason in pair["reasons"])


def test_a_moved_copy_is_never_accepted_and_says_why(registered: Registered) -> None:
    scan = room(1)
    _, pair = registered(scan, MOTION.apply(scan)[::2])
    assert pair["status"] != "accepted"
    assert any("same measurement" in reason for reason in pair["reasons"])


def test_a_rescaled_scan_is_never_accepted_and_its_scale_is_told(registered: Registered) -> None:
    _, pair = registered(room(1), 1.01 * MOTION.apply(room(2)))
    assert pair["status"] != "accepted"
    assert any("1 %" in reason and "larger" in reason for reason in pair["reasons"])
    scale = pair["model"]["scale"]
    assert scale["significant"]
    assert abs(scale["value"] - 0.01) < 4.0 * scale["std"] + 2e-4
    std = pair["target_from_source"]["std"]
    assert max(std["tx_m"], std["ty_m"], std["tz_m"]) > 1e-3


def test_a_guessed_position_is_said_to_be_guessed(registered: Registered) -> None:
    _, pair = registered(room(1) + 1.0, MOTION.apply(room(2)))
    assert any("position of the instrument of S1 was" in reason for reason in pair["reasons"])
    assert all(count["instrument_std_m"] is None or count["instrument_std_m"] > 0.0 for count in pair["features"])


def test_the_same_points_in_another_order_are_refused(service: RunningService) -> None:
    scan = room(1)
    forms = [("scan", ("a.ply", ply(scan))), ("scan", ("b.ply", ply(scan[::-1])))]
    answer = service.post("/registrations", files=forms)
    assert answer.status_code == 400
    assert "same measurement" in answer.text
