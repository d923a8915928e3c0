"""What the geometry does not determine is refused with the reason, never answered with an accepted pose."""

import json

import numpy as np
import pytest

from algorithms.scans.scan import Scan
from service.formats.writers import write_scans
from tests.e2e.running.command_line import tieline
from tests.e2e.running.running_service import Document, RunningService
from tests.e2e.running.virtual_scans import simulate

pytestmark = pytest.mark.service

PAIRS = {"parallel pipes": ("S1", "S2"), "strangers": ("S3", "S4"), "five points": ("S3", "S5")}


@pytest.fixture(scope="module")
def single_plane(service: RunningService, tmp_path_factory: pytest.TempPathFactory) -> Document:
    """Register two scans of one plane from the command line; the result and the exit code."""
    folder = tmp_path_factory.mktemp("plane")
    write_scans(folder / "plane.e57", simulate("single_plane"))
    done = tieline("register", folder / "plane.e57", "--url", service.url, "--output", folder / "kept")
    return {**json.loads((folder / "kept" / "result.json").read_text()), "exit code": done.returncode}


@pytest.fixture(scope="module")
def result(service: RunningService, tmp_path_factory: pytest.TempPathFactory) -> Document:
    """Try, in one job, three pairs that cannot be registered."""
    few = Scan(points=np.random.default_rng(5).uniform(-3.0, 3.0, (5, 3)), origin_m=np.zeros(3))
    path = tmp_path_factory.mktemp("refused") / "unrelated.e57"
    write_scans(path, [*simulate("parallel_pipes"), *simulate("house", 1), *simulate("office", 1), few])
    file = service.upload(path)["id"]
    stations = [{"name": f"S{number}", "scan": {"file": file, "index": number - 1}} for number in range(1, 6)]
    return service.result(service.execute("register", {"stations": stations, "pairs": list(PAIRS.values())}))


def pair_of(result: Document, which: str) -> Document:
    target, source = PAIRS[which]
    return next(pair for pair in result["pairs"] if (pair["target"], pair["source"]) == (target, source))


def test_no_station_gets_a_pose_and_each_is_told_why(result: Document) -> None:
    others = result["stations"][1:]
    assert (result["status"], {station["status"] for station in others}) == ("not-registered", {"unregistered"})
    assert all(station["world_from_scan"] is None and station["reason"] for station in others)


def test_parallel_pipes_are_degenerate_and_the_free_direction_is_named(result: Document) -> None:
    pair = pair_of(result, "parallel pipes")
    assert pair["status"] == "degenerate"
    # the pipes lie along x of the world; the target's heading of 0.7 rad makes it (cos 0.7, -sin 0.7) there
    named = " ".join(pair["reasons"]).replace("(-0.76, 0.64, 0.01)", "(0.76, -0.64, -0.01)")
    assert "free: translation along (0.76, -0.64, -0.01) of the target frame" in named


def test_scans_that_share_nothing_are_rejected(result: Document) -> None:
    pair = pair_of(result, "strangers")
    assert (pair["status"], bool(pair["reasons"])) == ("rejected", True)


def test_a_scan_without_any_surface_is_no_fault_of_the_service(result: Document) -> None:
    pair = pair_of(result, "five points")
    assert pair["status"] in {"rejected", "degenerate"}
    assert pair["reasons"]


def test_a_single_plane_is_degenerate_in_two_shifts_and_a_turn(single_plane: Document) -> None:
    pair = single_plane["pairs"][0]
    reasons = " ".join(pair["reasons"])
    assert (single_plane["status"], pair["status"]) == ("not-registered", "degenerate")
    assert (reasons.count("translation along"), reasons.count("rotation about")) == (2, 1)


def test_the_command_line_ends_with_1_when_nothing_is_registered(single_plane: Document) -> None:
    assert single_plane["exit code"] == 1
