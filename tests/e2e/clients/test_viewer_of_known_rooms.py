"""What the viewer shows of rooms follows from their geometry: pixels in plan, distances to planes, targets, words."""

import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from algorithms.progress import NoProgress
from algorithms.scans.scan import Scan
from service.adapters.files.local_files import LocalFiles
from service.formats.writers import cloud_of
from service.formats.writers.viewer_points import write_viewer_points
from service.names.scene_keys import scene_key
from tests.e2e.clients.served_scene import JOB, ServedScene, ShownStation, served_scene
from tests.e2e.clients.viewer_page import ViewerPage, browser

pytestmark = pytest.mark.service
HALF_M = (6.0, 4.5, 1.5)
POINTS = 150_000
APART_M = 14.0
OFF_M = 0.006
"""By how much the third station lies wrong along x: the walls across x are off by it, all others fit."""
ROOMS = {"S1": 0.0, "S2": APART_M, "S3": OFF_M}
TARGET = {"name": "K7", "recognised": True, "kind": "sphere", "centre_m": [1.0, 2.0, 0.5], "std_m": [1e-4, 2e-4, 3e-4]}
MEASURED = {"name": "1001", "kind": "stated", "centre_m": [1.0, -2.0, 0.5], "state": "removed"}
CONTROL = {
    "id": "control/1001", "name": "1001", "use": "check", "state": "check", "stations": ["S1", "S2"],
    "known_m": [15.0, -2.0, 0.5], "place_m": [15.005, -2.0, 0.5], "difference_m": [0.005, 0.0, 0.0],
    "statistic": 40.0, "critical": 16.3,
}  # fmt: skip
SHARES = """
([boxes, colours]) => {
  const canvas = document.querySelector('#viewer canvas'), gl = canvas.getContext('webgl2');
  const [w, h] = [canvas.width, canvas.height], pixels = new Uint8Array(4 * w * h);
  gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  return boxes.map(([x0, x1, y0, y1]) => colours.map((colour) => {
    let hits = 0, all = 0;
    for (let y = Math.ceil((y0 + 1) / 2 * h); y < (y1 + 1) / 2 * h - 1; y += 1)
      for (let x = Math.ceil((x0 + 1) / 2 * w); x < (x1 + 1) / 2 * w - 1; x += 1) {
        const at = 4 * (y * w + x);
        all += 1;
        if (colour.every((value, k) => Math.abs(pixels[at + k] - value) <= 3)) hits += 1;
      }
    return hits / all;
  }));
}
"""


def a_room(seed: int) -> Scan:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1.0, 1.0, (POINTS, 3))
    axis = rng.choice(3, p=[0.1, 0.1, 0.8], size=POINTS)
    points[np.arange(POINTS), axis] = np.sign(points[np.arange(POINTS), axis])
    return Scan(points=points * HALF_M, origin_m=np.zeros(3))


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServedScene]:
    home = tmp_path_factory.mktemp("rooms")
    blobs, stations = LocalFiles(home / "blobs"), []
    for seed, (name, x_m) in enumerate(ROOMS.items()):
        listed = write_viewer_points(home / "points", cloud_of(a_room(seed)), NoProgress())
        blobs.put_file(f"features/{name}/points", home / "points")
        blobs.write_bytes(f"features/{name}/points.json", json.dumps(listed).encode())
        pose = RigidTransform.from_translation([x_m, 0.0, 0.0])
        stations.append(ShownStation(name, HALF_M, pose, f"features/{name}/points", POINTS, file=f"file-{name}"))
    with served_scene(home, blobs, stations) as running:
        asked = {"station": {"name": "S1", "scan": {"file": "file-S1", "index": 0}}, "targets": [{"kind": "sphere"}]}
        scene = json.loads(blobs.local_path(scene_key(JOB)).read_bytes())
        scene["stations"][1]["targets"] = [{**MEASURED, "residual_m": [0.002, 0.0, 0.0]}]
        blobs.write_bytes(scene_key(JOB), json.dumps({**scene, "control": [CONTROL]}).encode())
        running.finish("targets0", "find-targets", asked, {"targets": [TARGET]})
        yield running


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    with browser() as running:
        yield running


@pytest.fixture(scope="module")
def shown(chromium: Any, served: ServedScene) -> ViewerPage:
    page = ViewerPage(chromium, served.url, JOB)
    page.wait_for_picture()
    page.settle()
    return page


def choose(shown: ViewerPage, label: str, value: str) -> None:
    shown.page.get_by_label(label, exact=True).select_option(value)
    shown.settle()


def test_the_plan_shows_each_room_at_its_place_in_its_colour(shown: ViewerPage) -> None:
    """Against the drawing by hand: an orthographic plan 1.1 times as large as the rooms, of points in one colour."""
    choose(shown, "view", "plan")
    shown.page.evaluate(
        """() => {
          const {viewer} = tielineViewer;
          for (const kind of Object.keys(viewer.visible)) viewer.visible[kind] = kind === 'points';
          viewer.hidden.add('S3');
          viewer.relayout();
          viewer.applyVisibility();
          viewer.views.fit();
        }"""
    )
    shown.page.wait_for_timeout(300)  # until the picture is at rest
    shown.settle()
    aspect = shown.page.evaluate("(({clientWidth: w, clientHeight: h}) => w / h)(tielineViewer.canvas)")
    length, depth = APART_M + 2 * HALF_M[0], 2 * HALF_M[1]
    half = 0.55 * max(depth, length / aspect)
    inset_m = 0.3
    boxes = []
    for middle_m, width_m in ((0.0, HALF_M[0]), (APART_M, HALF_M[0]), (APART_M / 2, APART_M / 2 - HALF_M[0])):
        x = (middle_m - APART_M / 2 + np.array([-1, 1]) * (width_m - inset_m)) / (half * aspect)
        y = np.array([-1, 1]) * (HALF_M[1] - inset_m) / half
        boxes.append([*x.tolist(), *y.tolist()])
    own = shown.page.evaluate("tielineViewer.viewer.stations.map(({colour: c}) => [c.r, c.g, c.b].map((v) => 255 * v))")
    colours = [(0.55 * np.array(each)).tolist() for each in own[:2]] + [[0x12, 0x17, 0x1C]]
    shares = np.array(shown.page.evaluate(SHARES, [boxes, colours]))
    assert shares[0, 0] > 0.85  # S1 where S1 is, and so on; the rest are gaps between points
    assert shares[1, 1] > 0.85
    assert shares[2, 2] == 1.0
    assert max(shares[0, 1], shares[1, 0], shares[2, 0], shares[2, 1]) == 0.0


def test_points_are_coloured_by_their_distance_to_planes_of_other_stations(shown: ViewerPage) -> None:
    shown.page.evaluate("() => { tielineViewer.viewer.hidden.clear(); tielineViewer.viewer.relayout(); }")
    choose(shown, "points by", "residual")
    at = """([name, point]) => {
      const {viewer} = tielineViewer, own = viewer.byName.get(name);
      return viewer.residuals.of(own, point, new Float32Array([0, 0, 0]))[0] - 1;
    }"""
    end_wall = shown.page.evaluate(at, ["S3", [HALF_M[0], 0.0, 0.0]])
    floor = shown.page.evaluate(at, ["S3", [1.0, 1.0, -HALF_M[2]]])
    alone = shown.page.evaluate(at, ["S2", [1.0, 1.0, -HALF_M[2]]])
    assert end_wall == pytest.approx(OFF_M, abs=1e-6)
    assert floor == pytest.approx(0.0, abs=1e-6)
    assert alone == -1.0  # no plane of another station is there
    assert "another station" in str(shown.page.locator(".viewer-legend").text_content())
    assert shown.errors == []


def test_targets_of_another_job_are_shown_and_a_row_leads_to_them(shown: ViewerPage) -> None:
    shown.page.get_by_text("Features of all stations").click()
    row = shown.page.locator('tr[data-feature="target/S1/K7"]')
    row.click()
    told = str(shown.page.locator(".viewer-info").text_content())
    assert "S1/K7" in told
    assert "sphere" in told
    assert "0.10 mm" in told
    assert "viewer-selected" in str(row.get_attribute("class"))
    assert shown.page.get_by_label("targets").is_checked()


def test_targets_and_known_points_of_the_registration_are_shown_and_their_rows_lead_to_them(shown: ViewerPage) -> None:
    shown.page.evaluate("tielineViewer.lists.querySelector('details').open = true")
    shown.page.locator('tr[data-feature="target/S2/1001"]').click()
    told = str(shown.page.locator(".viewer-info").text_content())
    assert "left out" in told
    assert "2.00 mm" in told
    row = shown.page.locator('tr[data-feature="control/1001"]')
    row.click()
    told = str(shown.page.locator(".viewer-info").text_content())
    assert all(each in told for each in ("check", "5.00 mm", "40.0; 16.3", "S1, S2"))
    assert "100 times" in str(shown.page.locator(".viewer-legend").text_content())
    shown.canvas.focus()
    shown.page.keyboard.press("Escape")
    assert "viewer-selected" not in str(row.get_attribute("class"))
    shown.settle()
    at_middle = "({viewer, canvas}) => viewer.featureAt(canvas.clientWidth / 2, canvas.clientHeight / 2)"
    assert shown.page.evaluate(f"({at_middle})(tielineViewer)") == CONTROL["id"]
    shown.page.evaluate("(id) => tielineViewer.viewer.select(id)", CONTROL["id"])
    assert "viewer-selected" in str(row.get_attribute("class"))
    assert shown.errors == []


def test_rows_of_planes_lead_to_them_too(shown: ViewerPage) -> None:
    shown.page.locator('tr[data-feature="S2/P6"]').click()
    assert f"{4 * HALF_M[0] * HALF_M[1]:.2f} m²" in str(shown.page.locator('tr[data-feature="S2/P6"]').text_content())
    assert shown.page.evaluate("tielineViewer.viewer.selected") == "S2/P6"


def test_a_comparison_is_shown_with_the_legend_of_its_deviations_and_nothing_of_registrations(
    chromium: Any, served: ServedScene
) -> None:
    scene = json.loads(served.blobs.local_path(scene_key(JOB)).read_bytes())
    scene |= {"stations": scene["stations"][:1], "points": scene["points"][:1], "control": []}
    scene["stations"][0] |= {"planes": [], "noise_std_m": None}
    legend = {"limits_m": [-0.008, 0.008], "colours": [[20, 55, 230], [255, 255, 255], [230, 55, 20]]}
    scene["deviations"] = {**legend, "insignificant": [120, 120, 120], "without": None}
    served.blobs.write_bytes(scene_key("compare0"), json.dumps(scene).encode())
    served.finish("compare0", "compare", {}, None)
    page = ViewerPage(chromium, served.url, "compare0")
    page.wait_for_picture()
    told = str(page.page.locator(".viewer-legend").text_content())
    assert "≤ -8.0 mm" in told
    assert "> +8.0 mm" in told
    assert "level of detection" in told
    assert "within reach" not in told
    assert page.page.locator(".viewer-classes .viewer-chip").count() == 3
    assert not page.page.get_by_role("button", name="Help the registration").is_visible()
    assert page.page.get_by_label("points by").locator("option").count() == 2
    assert page.errors == []


def test_it_speaks_german_with_german_numbers(chromium: Any, served: ServedScene) -> None:
    page = ViewerPage(chromium, served.url, JOB, language="de")
    page.wait_for_picture()
    page.page.get_by_label("Punkte nach").select_option("height")
    page.settle()
    legend = str(page.page.locator(".viewer-legend").text_content())
    assert "Höhe" in legend
    assert f"{HALF_M[2]:.2f} m".replace(".", ",") in legend
    assert page.page.get_by_role("button", name="Der Registrierung helfen").is_visible()
    # every text was found: none is shown by its key
    assert (
        page.page.evaluate("/\\b(tell|keys|kinds|legend|measuring|views|by)\\.[a-z_]+/.exec(document.body.innerText)")
        is None
    )
    assert page.errors == []
