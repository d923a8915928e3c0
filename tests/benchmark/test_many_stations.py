"""How pairs tried, processor time and memory grow from five to forty stations, and a campaign of large scans.

Environment: TIELINE_STATIONS (numbers with commas between, 5,10,20,40 by default), TIELINE_STATIONS_IN (rooms, the
default, or street), and TIELINE_BIG=20 for twenty stations of two million points in a street through the service.
"""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from room_row import room_row_scene
from scipy.spatial.transform import RigidTransform

from algorithms.simulation.scanner import VirtualScanner, scanner_with_step
from algorithms.simulation.scanning import simulate_stations
from algorithms.simulation.scene import Scene
from algorithms.simulation.street_square import street_scene
from service.client import ServiceClient
from service.embedded import embedded_service
from service.formats.writers import write_scans
from tests.measures.memory_watch import MemoryWatch

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(7200)]

SMALL = VirtualScanner(rows=160, columns=400, range_noise_std_m=0.003)
COUNTS = [int(count) for count in os.environ.get("TIELINE_STATIONS", "5,10,20,40").split(",")]
SCENE = {"rooms": room_row_scene, "street": street_scene}[os.environ.get("TIELINE_STATIONS_IN", "rooms")]
PARTS = ("features", "choice", "pairs", "network")
LARGEST_ERROR_M = 0.02
"""Of a station's place that the network gives: far above the noise (3 mm), far below one house."""
BIG_STATIONS, BIG_STEP_RAD = int(os.environ.get("TIELINE_BIG", "0")), float(np.deg2rad(0.131))
"""2748 x 1145 pixels, 63 % of which meet something in the street: two million points a station."""


def written(scene: Scene, stations: int, scanner: VirtualScanner, folder: Path) -> list[Path]:
    """Scan from the first stations and write the scans as E57."""
    folder.mkdir()
    paths = []
    scans = simulate_stations(scene, scene.stations[:stations], scanner, np.random.default_rng(1))
    for number, scan in enumerate(scans, start=1):
        paths.append(folder / f"S{number}.e57")
        write_scans(paths[-1], [scan])
    return paths


def errors_m(scene: Scene, poses: dict[str, list[list[float]]]) -> list[float]:
    """How far each connected station is from its true place in the frame of the first."""
    first = scene.stations[0].inv()
    return [
        float(
            np.linalg.norm(
                RigidTransform.from_matrix(np.array(matrix)).translation
                - (first * scene.stations[int(station)]).translation
            )
        )
        for station, matrix in poses.items()
    ]


@pytest.fixture(scope="module")
def rows() -> dict[int, dict]:
    """What was measured, by the number of stations."""
    return {}


@pytest.mark.parametrize("count", COUNTS)
def test_all_stations_that_are_connected_are_right(count: int, rows: dict[int, dict], tmp_path: Path) -> None:
    scene = SCENE(count, np.random.default_rng(11))
    paths = written(scene, count, SMALL, tmp_path / "scans")
    job = tmp_path / "scans.json"
    job.write_text(json.dumps({"warm_up": [str(path) for path in paths[:3]], "stations": [str(p) for p in paths]}))
    child = Path(__file__).with_name("many_stations_child.py")
    done = subprocess.run([sys.executable, str(child), str(job)], stdout=subprocess.PIPE, check=True, timeout=7000)
    row = json.loads(done.stdout)
    errors = errors_m(scene, row["poses"])
    rows[count] = row | {"connected": len(errors), "largest_mm": 1e3 * max(errors)}
    print(f"\n{count} stations: {rows[count] | {'poses': len(errors)}}")
    assert max(errors) < LARGEST_ERROR_M


def test_growth_is_printed(rows: dict[int, dict]) -> None:
    if not rows:
        pytest.skip("no network was registered")
    columns = {
        "pairs tried": [row["tried"] for row in rows.values()],
        "accepted": [row["accepted"] for row in rows.values()],
        **{f"{part} s": [row["seconds"][part] for row in rows.values()] for part in PARTS},
        "all s": [sum(row["seconds"].values()) for row in rows.values()],
        "peak MB": [row["peak_mb"] for row in rows.values()],
        "connected": [row["connected"] for row in rows.values()],
        "worst mm": [row["largest_mm"] for row in rows.values()],
    }
    print("\n\nprocessor seconds; exponent e of n^e over all rows")
    print("stations " + " ".join(f"{name:>12s}" for name in columns))
    for place, count in enumerate(rows):
        print(f"{count:8d} " + " ".join(f"{values[place]:12.1f}" for values in columns.values()))
    if len(rows) > 1:
        exponents = [
            np.polyfit(np.log(list(rows)), np.log(np.maximum(values, 1e-3)), 1)[0]
            for name, values in columns.items()
            if name not in {"connected", "worst mm"}
        ]
        print("exponent " + " ".join(f"{exponent:12.2f}" for exponent in exponents))
    assert all(row["tried"] > 0 for row in rows.values())


@pytest.mark.skipif(not BIG_STATIONS, reason="TIELINE_BIG=20 runs it")
def test_stations_of_two_million_points_take_nine_seconds_each_at_most_and_4_gb(tmp_path: Path) -> None:
    scene = street_scene(BIG_STATIONS, np.random.default_rng(11))
    paths = written(scene, BIG_STATIONS, scanner_with_step(BIG_STEP_RAD), tmp_path / "scans")
    with MemoryWatch() as memory, embedded_service() as url, ServiceClient(url) as client:
        begun = time.perf_counter()
        uploaded = [client.upload(path) for path in paths]
        uploading = time.perf_counter() - begun
        files = zip(paths, uploaded, strict=True)
        stations = [{"name": path.stem, "scan": {"file": file["id"]}} for path, file in files]
        begun = time.perf_counter()
        result = client.wait(client.execute("register", {"stations": stations}))
        seconds = time.perf_counter() - begun
    registered = [station for station in result["stations"] if station["status"] in {"fixed", "registered"}]
    poses = {str(int(each["name"][1:]) - 1): each["world_from_scan"]["matrix"] for each in registered}
    worst_m = max(errors_m(scene, poses))
    print(
        f"\n{BIG_STATIONS} stations: sent in {uploading:.0f} s, registered in {seconds:.0f} s, at most "
        f"{memory.peak / 1e9:.2f} GB, {len(result['pairs'])} pairs tried, {len(registered)} connected, the worst "
        f"{1e3 * worst_m:.1f} mm off, {result['provenance']['timings_s']}"
    )
    assert worst_m < LARGEST_ERROR_M
    assert seconds < 9.0 * BIG_STATIONS
    assert memory.peak < 4e9
