"""The viewer with 20 stations of two million points: time to the first picture, bytes before it, time of a frame.

The scans are two simulated rooms, of which each stands ten times at different places; the service is the web
application over files on the disk, with all its routes. Chromium draws in software here, many times slower than any
graphics card.
"""

import json
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from scipy.spatial.transform import RigidTransform

from algorithms.progress import NoProgress
from algorithms.scans.scan import Scan
from service.adapters.files.local_files import LocalFiles
from service.formats.writers import cloud_of
from service.formats.writers.viewer_points import write_viewer_points
from tests.e2e.clients.served_scene import JOB, ShownStation, served_scene
from tests.e2e.clients.viewer_page import ViewerPage, browser

pytestmark = pytest.mark.benchmark
STATIONS, ROOMS, POINTS = 20, 2, 2_000_000
MOST_MS, MOST_BYTES = 2000.0, 20_000_000
HALF_M = (12.0, 9.0, 3.0)


def a_room(number: int) -> Scan:
    """Look around in a room: as many points in each direction."""
    rng = np.random.default_rng(number)
    directions = rng.normal(size=(POINTS, 3))
    points = directions * (np.array(HALF_M) / np.abs(directions)).min(axis=1)[:, None]
    return Scan(points=points, origin_m=np.zeros(3), intensity=rng.random(POINTS, dtype=np.float32))


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    home = tmp_path_factory.mktemp("viewer")
    blobs, seconds = LocalFiles(home / "blobs"), []
    for room in range(ROOMS):
        began = time.perf_counter()
        listed = write_viewer_points(home / "points", cloud_of(a_room(room)), NoProgress())
        seconds.append(time.perf_counter() - began)
        blobs.put_file(f"features/{room}/points", home / "points")
        blobs.write_bytes(f"features/{room}/points.json", json.dumps(listed).encode())
    print(f"blocks of {POINTS} points: {np.median(seconds):.1f} s a station")
    stations = [
        ShownStation(
            name=f"S{number + 1}",
            half_m=HALF_M,
            pose=RigidTransform.from_translation([20.0 * (number % 5), 15.0 * (number // 5), 0.0]),
            points=f"features/{number % ROOMS}/points",
            point_count=POINTS,
            planes=False,
        )
        for number in range(STATIONS)
    ]
    with served_scene(home, blobs, stations) as served:
        yield served.url


def test_the_first_picture_comes_soon_and_takes_little(address: str) -> None:
    with browser() as running:
        warm = ViewerPage(running, address, JOB)  # the service is warm, and so is the browser
        warm.wait_for_picture()
        warm.page.close()
        before_s = processor_s()
        page = ViewerPage(running, address, JOB)
        first_ms, size = page.wait_for_picture()
        took_s = processor_s() - before_s
        bundle = sum(path.stat().st_size for path in _static())
        scene = len(page.page.request.get(f"{address}/jobs/{JOB}/scene").body())
        page.settle()
        frames: list[Any] = page.page.evaluate(
            """async () => {
              const {viewer} = tielineViewer, times = [];
              for (let k = 0; k < 40; k += 1) {
                viewer.views.step(1, 0, false);
                const began = performance.now();
                viewer.draw();
                viewer.waitForPixels();
                times.push(performance.now() - began);
                await new Promise((done) => setTimeout(done, 0));
              }
              const drawn = viewer.detail.inMotion;
              viewer.isMoving = false;
              const began = performance.now();
              viewer.draw();
              viewer.waitForPixels();
              return [times.slice(20), drawn, performance.now() - began, viewer.detail.shown];
            }"""
        )
        turning, drawn, whole_ms, shown = frames
        print(
            f"first picture after {first_ms:.0f} ms ({took_s:.1f} s of processor), "
            f"{(size + scene + bundle) / 1e6:.1f} MB before it (points "
            f"{size / 1e6:.1f}, scene {scene / 1e6:.2f}, program {bundle / 1e6:.2f}); drawn in software, a frame takes "
            f"{np.median(turning):.0f} ms while the picture turns ({drawn:.0f} points), {whole_ms:.0f} ms at rest "
            f"({shown} points)"
        )
        assert size + scene + bundle <= MOST_BYTES
        assert first_ms <= MOST_MS


def processor_s() -> float:
    """Sum up the processor time of the browser, which other work on the machine does not change."""
    total = 0.0
    for process in psutil.Process().children(recursive=True):
        with suppress(psutil.Error):
            times = process.cpu_times()
            total += times.user + times.system
    return total


def _static() -> list[Path]:
    folder = Path(__file__).resolve().parents[2] / "service" / "web" / "static"
    return [folder / "viewer.js", folder / "viewer.css"]
