"""Two stations of a house with a photo each: lines of scans and photos in one registration."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from tests.e2e.running_service import Document, RunningService
from tests.e2e.virtual_photos import take_photos
from tests.e2e.virtual_scans import first_from_second

STD = {"rotation_gon": 0.01, "translation_m": 0.001}


@pytest.fixture(scope="module")
def result(service: RunningService, house: Sequence[Path], tmp_path_factory: pytest.TempPathFactory) -> Document:
    taken = take_photos(tmp_path_factory.mktemp("photos"), "house", (5.5, 0.0, 2.5))
    stations = [
        {
            "name": f"S{number}",
            "scan": {"file": service.upload(scan)["id"]},
            "photos": [{"file": service.upload(path)["id"], "mount_std": STD, **camera}],
        }
        for number, (scan, (path, camera)) in enumerate(zip(house, taken, strict=True), start=1)
    ]
    return service.result(service.execute("register", {"stations": stations}))


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
