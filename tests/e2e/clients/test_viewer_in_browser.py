"""The viewer as a person uses it: looks, turns, measures, chooses in tables and pictures, helps the registration."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from algorithms.geometry.poses import PoseEstimate
from tests.e2e.clients.viewer_page import ViewerPage, browser
from tests.e2e.running.running_service import Document, RunningService

pytestmark = pytest.mark.service
HOSTILE = "S1 <img src=x onerror=alert(1)>"


@pytest.fixture(scope="module")
def job(service: RunningService, house: Sequence[Path]) -> str:
    forms = [("scan", (path.name, path.read_bytes())) for path in house]
    answer = service.post("/registrations", files=forms)
    assert answer.status_code == 201, answer.text
    job_id = str(answer.json()["jobID"])
    service.result(job_id)
    return job_id


@pytest.fixture(scope="module")
def scene(service: RunningService, job: str) -> Document:
    return dict(service.http.get(f"/jobs/{job}/scene").json())


@pytest.fixture(scope="module")
def used_line(scene: Document) -> str:
    return next(str(line["id"]) for line in scene["stations"][1]["lines"] if line["state"] == "used")


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    with browser() as running:
        yield running


@pytest.fixture(scope="module")
def shown(chromium: Any, service: RunningService, job: str, used_line: str) -> ViewerPage:
    page = ViewerPage(chromium, service.url, job, (used_line, HOSTILE.replace("<", "&lt;")))
    page.wait_for_picture()
    page.settle()
    return page


def test_it_shows_points_and_asks_no_other_host(shown: ViewerPage, service: RunningService) -> None:
    assert shown.colours() > 50
    assert int(shown.page.locator("#viewer").get_attribute("data-points")) > 10_000
    assert [each for each in shown.addresses if not each.startswith((service.url, "data:", "blob:"))] == []
    assert shown.errors == []


def test_colouring_and_views_change_the_picture_by_keys_alone(shown: ViewerPage) -> None:
    shown.canvas.focus()
    pictures = [shown.picture()]
    for key in ("c", "2", "3"):
        shown.page.keyboard.press(key)
        pictures.append(shown.picture())
    assert len(set(pictures)) == len(pictures)
    shown.page.keyboard.press("1")
    assert shown.picture() == pictures[1]
    shown.page.keyboard.press("ArrowRight")
    assert shown.picture() != pictures[1]


def test_before_and_after_are_other_pictures(shown: ViewerPage) -> None:
    shown.canvas.focus()
    after = shown.picture()
    shown.page.keyboard.press("b")
    before = shown.picture()
    shown.page.keyboard.press("b")
    assert shown.picture() == after != before


def test_a_row_of_a_table_is_shown_in_3d_and_the_feature_marks_its_row(shown: ViewerPage, used_line: str) -> None:
    row = shown.page.locator(f'body > table tr[data-feature="{used_line}"]')
    row.focus()
    shown.page.keyboard.press("Enter")
    assert used_line in str(shown.page.locator(".viewer-info h3").text_content())
    assert "viewer-selected" in str(row.get_attribute("class"))
    shown.canvas.focus()
    shown.page.keyboard.press("Escape")
    assert "viewer-selected" not in str(row.get_attribute("class"))
    shown.page.evaluate("(id) => tielineViewer.viewer.select(id)", used_line)
    assert "viewer-selected" in str(row.get_attribute("class"))
    shown.canvas.focus()
    shown.page.keyboard.press("Escape")


def test_a_distance_is_measured_with_the_keyboard_in_plan(shown: ViewerPage) -> None:
    shown.canvas.focus()
    shown.page.keyboard.press("2")
    shown.page.keyboard.press("m")
    shown.settle()
    found = 0
    for _ in range(60):
        shown.page.keyboard.press("x")
        taken = shown.page.evaluate("tielineViewer.measured.length")
        if taken > found:
            found = taken
        if found == 2:
            break
        shown.page.keyboard.press("ArrowRight")
    assert found == 2
    assert "standard deviation" in shown.status()
    shown.page.keyboard.press("Escape")
    shown.page.keyboard.press("1")


def test_the_standard_deviation_of_a_distance_is_that_of_poses_and_noise(shown: ViewerPage, scene: Document) -> None:
    """The same figures by the service's own poses: d = |B - A|, variance u' (S_A + S_B) u."""
    marks = [{"station": each["name"], "point": each["lines"][0]["start_m"]} for each in scene["stations"][:2]]
    told = shown.page.evaluate("(marks) => tielineViewer.distance(marks)", marks)
    ends, covariances = [], []
    for station, mark in zip(scene["stations"], marks, strict=True):
        pose = RigidTransform.from_matrix(np.array(station["world_from_scan"]))
        estimate = PoseEstimate(pose, np.array(station["covariance"]))
        ends.append(pose.apply(mark["point"]))
        covariances.append(estimate.position_covariance_m2(ends[-1]) + station["noise_std_m"] ** 2 * np.eye(3))
    difference = ends[1] - ends[0]
    u = difference / np.linalg.norm(difference)
    assert told["distance_m"] == pytest.approx(np.linalg.norm(difference), abs=1e-9)
    assert told["std_m"] == pytest.approx(np.sqrt(u @ sum(covariances) @ u), rel=1e-9)
    alone = shown.page.evaluate("(marks) => tielineViewer.distance([marks[0], {...marks[0], point: [1, 2, 3]}])", marks)
    assert alone["std_m"] == pytest.approx(np.sqrt(2.0) * scene["stations"][0]["noise_std_m"], rel=1e-9)


def test_points_are_picked_in_both_scans_and_a_new_job_says_that_a_person_chose(
    shown: ViewerPage, service: RunningService, job: str, scene: Document
) -> None:
    """The picks are made through the picture's own function for a picked point, which clicks and keys call."""
    target, source = scene["pairs"][0]["target"], scene["pairs"][0]["source"]
    pose = RigidTransform.from_matrix(np.array(scene["pairs"][0]["poses"][0]["target_from_source"]))
    shown.page.get_by_role("button", name="Help the registration").click()
    shown.page.get_by_role("button", name="Pick points").click()
    corners = [line[end] for line in scene["stations"][1]["lines"] for end in ("start_m", "end_m")]
    spread = sorted(corners, key=lambda corner: corner[0])
    for corner in (spread[0], spread[len(spread) // 2], spread[-1], max(corners, key=lambda each: each[1])):
        for station, point in ((target, pose.apply(corner).tolist()), (source, corner)):
            shown.page.evaluate("(found) => tielineViewer.help.take(found)", {"station": station, "point": point})
    shown.page.get_by_role("button", name="Register from these points").click()
    shown.page.locator("#viewer[data-new-job]").wait_for(timeout=20_000)
    chosen = str(shown.page.locator("#viewer").get_attribute("data-new-job"))
    result = service.result(chosen)
    start = result["pairs"][0]["start"]
    assert (start["chosen_by"], start["how"]) == ("a person", "picked-points")
    assert start["shift_m"] < 0.05
    assert result["pairs"][0]["status"] == service.http.get(f"/jobs/{job}/results").json()["pairs"][0]["status"]
    assert shown.errors == []


def test_picks_on_a_line_are_refused_with_a_pointer(service: RunningService, job: str) -> None:
    inputs = service.http.get(f"/jobs/{job}/inputs").json()
    names = [station["name"] for station in inputs["stations"]]
    line: list[Any] = [[float(k), 0.0, 0.0, float(k), 0.0, 0.0] for k in range(4)]
    answer = service.http.post(
        "/processes/register/execution",
        json={"inputs": {**inputs, "starts": [{"target": names[0], "source": names[1], "picked_points": line}]}},
    )
    assert answer.status_code == 400
    (fault,) = answer.json()["errors"]
    assert fault["pointer"] == "/inputs/starts/0/picked_points"
    assert "not on one line" in fault["detail"]


def test_a_narrow_window_shows_it_too(chromium: Any, service: RunningService, job: str) -> None:
    page = ViewerPage(chromium, service.url, job, width=390)
    page.wait_for_picture()
    assert page.colours() > 20
    assert page.page.evaluate("document.documentElement.scrollWidth") <= 390
