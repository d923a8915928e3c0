"""Processes from the command line: the commands follow from their schemas."""

import json
from pathlib import Path

import cv2

from tests.e2e.other_processes.test_edges_over_http import quadrilateral
from tests.e2e.running.command_line import tieline
from tests.e2e.running.running_service import RunningService


def test_edges_of_a_photo_with_an_option_of_the_schema(service: RunningService, tmp_path: Path) -> None:
    photo = tmp_path / "quadrilateral.png"
    assert cv2.imwrite(str(photo), quadrilateral())
    where = ("--url", service.url, "--output", tmp_path / "kept")
    done = tieline("detect-edges", photo, "--edges-max-segments", "3", *where)
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "kept" / "result.json").read_text())
    assert result["counts"]["edges"] == 3
    assert (tmp_path / "kept" / "segments.csv").exists()


def test_a_wrong_option_is_bad_input_and_named(service: RunningService, tmp_path: Path) -> None:
    photo = tmp_path / "quadrilateral.png"
    assert cv2.imwrite(str(photo), quadrilateral())
    done = tieline("detect-edges", photo, "--edges-max-segments", "0", "--url", service.url)
    assert done.returncode == 2
    assert "/inputs/edges/max_segments" in done.stderr


def test_lines_of_a_scan(service: RunningService, house: list[Path], tmp_path: Path) -> None:
    done = tieline("extract-lines", house[0], "--url", service.url, "--output", tmp_path / "lines.json")
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "lines.json").read_text())
    assert result["station"] == house[0].stem
    assert result["lines"]
