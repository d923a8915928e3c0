"""Two stations of a house with a photo each: lines of scans and photos in one registration."""

import json
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from tests.e2e.running.command_line import tieline
from tests.e2e.running.running_service import Document, RunningService
from tests.e2e.running.virtual_photos import take_photos
from tests.e2e.running.virtual_scans import first_from_second

pytestmark = pytest.mark.slow

STD = {"rotation_gon": 0.01, "translation_m": 0.001}


@pytest.fixture(scope="module")
def taken(tmp_path_factory: pytest.TempPathFactory) -> Sequence[tuple[Path, Mapping[str, Any]]]:
    return take_photos(tmp_path_factory.mktemp("photos"), "house", (5.5, 0.0, 2.5))


@pytest.fixture(scope="module")
def options(house: Sequence[Path], taken: Sequence[tuple[Path, Mapping[str, Any]]]) -> Document:
    """Tell which photo belongs to which scan."""
    return {
        "stations": [
            {"scan": {"file": scan.name}, "photos": [{"file": photo.name, "mount_std": STD, **camera}]}
            for scan, (photo, camera) in zip(house, taken, strict=True)
        ]
    }


@pytest.fixture(scope="module")
def result(
    service: RunningService, house: Sequence[Path], taken: Sequence[tuple[Path, Mapping[str, Any]]], options: Document
) -> Document:
    files = [("scan", (path.name, path.read_bytes())) for path in house]
    files += [("photo", (path.name, path.read_bytes())) for path, _ in taken]
    answer = service.post("/registrations", files=files, data={"options": json.dumps(options)})
    assert answer.status_code == 201, answer.text
    return service.result(answer.json()["jobID"])


@pytest.fixture(scope="module")
def from_command_line(
    service: RunningService,
    house: Sequence[Path],
    taken: Sequence[tuple[Path, Mapping[str, Any]]],
    options: Document,
    result: Document,  # noqa: ARG001 - the features of the same files are known then
) -> tuple[subprocess.CompletedProcess[str], Document]:
    """Let the command line register the same scans and photos."""
    folder = taken[0][0].parent
    (folder / "photos.json").write_text(json.dumps(options))
    where = ("--photos", folder / "photos.json", "--url", service.url, "--output", folder / "kept")
    done = tieline("register", *house, *where)
    assert done.returncode == 0, done.stdout + done.stderr
    return done, json.loads((folder / "kept" / "result.json").read_text())


def test_the_pose_is_accepted_and_true_within_a_fiftieth_of_a_gon_and_five_millimetres(result: Document) -> None:
    assert [pair["status"] for pair in result["pairs"]] == ["accepted"], result["pairs"][0]["reasons"]
    pose, truth = result["stations"][1]["world_from_scan"], first_from_second("house")
    estimate = RigidTransform.from_matrix(np.array(pose["matrix"]))
    assert (estimate.rotation.inv() * truth.rotation).magnitude() * 200.0 / np.pi < 0.02
    assert np.linalg.norm(estimate.translation - truth.translation) < 0.005


def test_lines_of_photos_are_found_matched_and_used(result: Document) -> None:
    counts = result["pairs"][0]["photo_lines"]
    assert min(counts["target_found"], counts["source_found"]) >= counts["matched"] >= 5
    assert counts["matched"] == counts["used"] + counts["removed"]
    assert counts["used"] > counts["removed"]


def test_correspondences_name_the_lines_that_come_from_photos(result: Document) -> None:
    pair = result["pairs"][0]
    from_photos = [each for each in pair["correspondences"] if each["source"] == "photo-edge"]
    assert len(from_photos) == pair["photo_lines"]["matched"]
    assert pair["accuracy"]["lines"]["photo_edges"] == pair["photo_lines"]["used"]


def test_what_each_photo_gave_is_counted(result: Document) -> None:
    for station in result["features"]:
        (photo,) = station["photos"]
        assert photo["segments"] == photo["projected"] + sum(photo["rejected"].values())
        assert photo["projected"] == photo["merged"] + station["photo_edges"]


def test_scans_and_photos_are_named_as_inputs(result: Document) -> None:
    provenance = result["provenance"]
    assert [each["kind"] for each in provenance["inputs"]] == ["scan", "photo"] * 2
    assert provenance["method"]["photo_lines"]["edges"]["detector"] == "edge-chains"


def test_the_command_line_registers_with_photos_as_the_form_does(
    result: Document, from_command_line: tuple[subprocess.CompletedProcess[str], Document]
) -> None:
    _, document = from_command_line
    assert document["pairs"][0]["photo_lines"]["used"] == result["pairs"][0]["photo_lines"]["used"]
    assert document["stations"][1]["world_from_scan"]["matrix"] == result["stations"][1]["world_from_scan"]["matrix"]


def test_the_command_line_tells_what_became_of_the_lines_of_photos(
    from_command_line: tuple[subprocess.CompletedProcess[str], Document],
) -> None:
    done, document = from_command_line
    counts = document["pairs"][0]["photo_lines"]
    assert f"{counts['matched']} matched, {counts['used']} used" in done.stdout


def test_a_pose_of_a_camera_that_is_inverted_is_named(
    service: RunningService, house: Sequence[Path], taken: Sequence[tuple[Path, Mapping[str, Any]]], options: Document
) -> None:
    wrong = json.loads(json.dumps(options))
    photo = wrong["stations"][1]["photos"][0]
    photo["scan_from_camera"] = (
        RigidTransform.from_matrix(np.array(photo["scan_from_camera"])).inv().as_matrix().tolist()
    )
    files = [("scan", (path.name, path.read_bytes())) for path in house]
    files += [("photo", (path.name, path.read_bytes())) for path, _ in taken]
    answer = service.post("/registrations", files=files, data={"options": json.dumps(wrong)})
    assert answer.status_code == 201, answer.text
    reasons = service.result(answer.json()["jobID"])["pairs"][0]["reasons"]
    named = [reason for reason in reasons if "inverse of scan_from_camera" in reason]
    assert len(named) == 1
    assert named[0].startswith("source: no line of photo 1")
