"""Strips and their flight go in over HTTP; corrected strips, pictures and a protocol come out."""

import json
from pathlib import Path
from typing import Any

import cv2
import laspy
import numpy as np
import pyproj
import pytest
from laspy.vlrs.known import WktCoordinateSystemVlr
from laspy.vlrs.vlrlist import VLRList

from algorithms.arrays import Array
from algorithms.simulation.strip_flights import FlownStrip
from tests.e2e.other_processes.test_clean_and_colour_over_http import refusal, run
from tests.e2e.running.command_line import tieline
from tests.e2e.running.running_service import Document, RunningService
from tests.scenes.flown_strips import known_places, planted_errors, village

ORIGIN_M, ORIGIN_S = np.array([500_000.0, 5_600_000.0, 300.0]), 300_000_000.0


def written(flown: FlownStrip, path: Path, point_format: int = 6) -> Path:
    """Write a strip as LAZ, in disorder, as some programs do."""
    strip = flown.strip
    order = np.random.default_rng(0).permutation(len(strip.points))
    header = laspy.LasHeader(point_format=point_format, version="1.4" if point_format >= 6 else "1.2")
    header.scales, header.offsets = np.full(3, 0.001), ORIGIN_M
    data = laspy.LasData(header)
    data.x, data.y, data.z = (strip.points + ORIGIN_M)[order].T
    data.classification = (np.arange(len(order)) % 3).astype(np.uint8)
    if point_format not in {0, 2}:
        data.gps_time = (strip.times_s + ORIGIN_S)[order]
    data.write(str(path))
    return path


@pytest.fixture(scope="module")
def flown() -> list[FlownStrip]:
    return village(planted_errors(1))


@pytest.fixture(scope="module")
def files(flown: list[FlownStrip], tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("strips")
    paths = [written(each, folder / f"{each.strip.name}.laz") for each in flown]
    table = []
    for each in flown:
        path = each.strip.trajectory
        angles = np.degrees(path.angles_rad)
        angles[:, 2] %= 360.0
        table.append(np.column_stack([path.times_s + ORIGIN_S, path.positions_m + ORIGIN_M, angles]))
    trajectory = folder / "flight.txt"
    np.savetxt(trajectory, np.concatenate(table), fmt="%.6f", header="time x y z roll pitch heading", comments="")
    return [*paths, trajectory]


@pytest.fixture(scope="module")
def inputs(service: RunningService, files: list[Path]) -> Document:
    ids = [service.upload(path)["id"] for path in files]
    control = [
        {"name": patch.name, "x": x, "y": y, "z": z, "std_m": 0.01}
        for patch in known_places()
        for x, y, z in (patch.points_m + ORIGIN_M).tolist()
    ]
    return {
        "strips": [{"file": each} for each in ids[:-1]],
        "trajectories": [{"file": ids[-1]}],
        "control": control,
    }


def test_strips_are_corrected_and_everything_is_told(
    service: RunningService, inputs: Document, flown: list[FlownStrip], tmp_path: Path
) -> None:
    told = (
        "conclusion",
        "strips",
        "datum",
        "patches",
        "heights_before",
        "heights_after",
        "boresight",
        "regularisation",
        "artifacts",
    )
    wanted = {**{name: {} for name in told}, "corrected": {"format": "laz"}}
    result = run(service, "adjust-strips", inputs, wanted)
    assert [strip["name"] for strip in result["strips"]] == [each.strip.name for each in flown]
    assert all(motion["determined"] for motion in result["datum"])
    assert "without trajectories" not in result["conclusion"]
    assert result["patches"]["mismatched_share"] <= 0.004
    assert result["patches"]["rms_after_m"] < 0.01 < 0.05 < result["patches"]["rms_before_m"]
    assert result["heights_after"]["median_m"] < 0.02 < 0.05 < result["heights_before"]["median_m"]
    planted = planted_errors(1)
    for told, true in zip(result["boresight"], planted.boresight_rad, strict=True):
        assert told["unit"] == "mgon"
        assert told["value"] == pytest.approx(true * 200_000.0 / np.pi, abs=3.0 * told["std"])
    assert any("held by observations of zero" in line for line in result["regularisation"])
    files = {each["name"]: each for each in result["artifacts"]}
    for name in ("discrepancies-before.png", "discrepancies-after.png"):
        picture = cv2.imdecode(np.frombuffer(service.get(files[name]["href"]).content, np.uint8), cv2.IMREAD_COLOR)
        assert min(picture.shape[:2]) > 100
    assert service.get(files["patches.csv"]["href"]).text.startswith("patch,strip,x_m")
    assert service.get(files["corrections.csv"]["href"]).text.startswith("strip,parameter,power")
    for each, artifact, told in zip(flown, result["corrected"], result["strips"], strict=True):
        path = tmp_path / artifact["name"]
        path.write_bytes(service.get(artifact["href"]).content)
        data = laspy.read(path)
        assert data.header.point_format.id == 6
        order = np.random.default_rng(0).permutation(len(each.strip.points))
        np.testing.assert_array_equal(np.asarray(data.classification), np.arange(len(order)) % 3)
        np.testing.assert_allclose(np.asarray(data.gps_time), (each.strip.times_s + ORIGIN_S)[order])
        left = np.asarray(data.xyz) - ORIGIN_M - each.true_points[order]
        off_m = np.sqrt((left**2).sum(axis=1).mean())
        assert off_m < 2.0 * told["correction_std_m"]


def test_without_trajectories_points_are_as_wrong_as_said_and_no_boresight_is_told(
    service: RunningService, inputs: Document, flown: list[FlownStrip], tmp_path: Path
) -> None:
    told = "conclusion", "strips", "boresight", "common", "waves", "advice", "adjustment", "artifacts"
    wanted = {**{name: {} for name in told}, "corrected": {"format": "laz"}}
    blind = {name: value for name, value in inputs.items() if name != "trajectories"}
    result = run(service, "adjust-strips", blind, wanted)
    assert result["boresight"] == []
    assert [each["parameter"] for each in result["common"]] == [
        "shift_forward", "shift_left", "common_roll", "common_pitch", "common_heading",
    ]  # fmt: skip
    assert any("no trajectory says where the scanner was" in line for line in result["advice"])
    assert result["adjustment"]["along"]["degrees"] > 0
    files = {each["name"]: each for each in result["artifacts"]}
    assert service.get(files["waves.csv"]["href"]).text.startswith("strip,gps_time_s,shift_x_m")
    for each, artifact, strip in zip(flown, result["corrected"], result["strips"], strict=True):
        path = tmp_path / artifact["name"]
        path.write_bytes(service.get(artifact["href"]).content)
        order = np.random.default_rng(0).permutation(len(each.strip.points))
        off = np.asarray(laspy.read(path).xyz) - ORIGIN_M - each.true_points[order]
        stds = np.hypot(strip["correction_std_xyz_m"], 0.02)
        assert (np.sqrt((off**2).mean(axis=0)) < 2.5 * stds).all()


def tiled(flown: list[FlownStrip], folder: Path) -> list[tuple[Path, Array]]:
    """Write the strips as two tiles, told by point source, a sliver of a sixth; return them with the true points."""
    rng = np.random.default_rng(1)
    points = np.concatenate([each.strip.points for each in flown])
    true = np.concatenate([each.true_points for each in flown])
    times = np.concatenate([each.strip.times_s for each in flown])
    sources = np.concatenate([np.full(len(each.strip.points), 101 + k) for k, each in enumerate(flown)])
    sources[:30] = 9
    withheld = rng.random(len(points)) < 0.01
    points[withheld] -= [0.0, 0.0, 30.0]
    found = []
    for name, own in (("west", points[:, 0] < 120.0), ("east", points[:, 0] >= 120.0)):
        order = rng.permutation(np.flatnonzero(own))
        header = laspy.LasHeader(point_format=6, version="1.4")
        header.scales, header.offsets = np.full(3, 0.001), ORIGIN_M
        data: Any = laspy.LasData(header)
        data.x, data.y, data.z = (points + ORIGIN_M)[order].T
        data.gps_time, data.point_source_id = (times + ORIGIN_S)[order], sources[order]
        data.withheld = withheld[order]
        wkt = WktCoordinateSystemVlr(pyproj.CRS.from_epsg(25832).to_wkt("WKT1_GDAL"))
        header.global_encoding.wkt = True
        data.evlrs = VLRList([wkt])
        data.write(str(folder / f"{name}.laz"))
        found.append((folder / f"{name}.laz", true[order]))
    return found


def test_tiles_of_several_strips_are_told_by_point_source(
    service: RunningService, inputs: Document, flown: list[FlownStrip], tmp_path: Path
) -> None:
    tiles = tiled(flown, tmp_path)
    uploaded = [service.upload(path) for path, _ in tiles]
    assert [file["scans"][0]["point_sources"] for file in uploaded] == [5, 4]
    told = {name: {} for name in ("strips", "patches", "boresight", "remarks")}
    strips = [{"file": file["id"]} for file in uploaded]
    result = run(
        service, "adjust-strips", {**inputs, "strips": strips}, {**told, "corrected": {"format": "laz"}}
    )  # fmt: skip
    assert [each["point_source"] for each in result["strips"]] == [101, 102, 103, 104, 105]
    assert {each["name"] for each in result["strips"]} >= {"source-101"}
    assert result["patches"]["rms_after_m"] < 0.01 < 0.05 < result["patches"]["rms_before_m"]
    for each, true in zip(result["boresight"], planted_errors(1).boresight_rad, strict=True):
        assert each["value"] == pytest.approx(true * 200_000.0 / np.pi, abs=3.0 * each["std"])
    assert sum("withheld" in remark for remark in result["remarks"]) == 2
    assert any("point source 9 has " in remark for remark in result["remarks"])
    for (_, true), artifact in zip(tiles, result["corrected"], strict=True):
        path = tmp_path / artifact["name"]
        path.write_bytes(service.get(artifact["href"]).content)
        data = laspy.read(path)
        assert data.header.parse_crs().to_epsg() == 25832
        good = (np.asarray(data.withheld) == 0) & (np.asarray(data.point_source_id) > 100)
        left = (np.asarray(data.xyz) - ORIGIN_M - true)[good]
        assert np.sqrt((left**2).sum(axis=1).mean()) < 2.0 * max(each["correction_std_m"] for each in result["strips"])


def test_a_tile_alone_is_adjusted_and_one_strip_alone_is_refused(
    service: RunningService, flown: list[FlownStrip], tmp_path: Path
) -> None:
    west = service.upload(tiled(flown, tmp_path)[0][0])["id"]
    result = run(service, "adjust-strips", {"strips": [{"file": west}], "passes": 1}, {"strips": {}})
    assert len(result["strips"]) == 4
    answer = refusal(service, "adjust-strips", {"strips": [{"file": west, "one_strip": True}]})
    assert "several point sources" in answer["errors"][0]["detail"]


def test_a_tile_without_point_sources_is_divided_at_pauses(
    service: RunningService, flown: list[FlownStrip], tmp_path: Path
) -> None:
    header = laspy.LasHeader(point_format=1, version="1.2")
    header.scales, header.offsets = np.full(3, 0.001), ORIGIN_M
    data: Any = laspy.LasData(header)
    data.x, data.y, data.z = np.concatenate([each.strip.points + ORIGIN_M for each in flown[:4]]).T
    data.gps_time = np.concatenate([each.strip.times_s + 100_000.0 + 400.0 * k for k, each in enumerate(flown[:4])])
    data.write(str(tmp_path / "tile.las"))
    strips = [{"file": service.upload(tmp_path / "tile.las")["id"]}]
    result = run(
        service, "adjust-strips", {"strips": strips, "passes": 1}, {"strips": {}, "remarks": {}, "patches": {}}
    )
    assert [each["points"] for each in result["strips"]] == [len(each.strip.points) for each in flown[:4]]
    assert result["patches"]["rms_after_m"] < 0.01 < 0.05 < result["patches"]["rms_before_m"]
    assert "tile: its times pause 3 times for more than 120 s" in result["remarks"][0]


def test_what_are_no_strips_is_refused_where_it_stands(
    service: RunningService, inputs: Document, flown: list[FlownStrip], tmp_path: Path
) -> None:
    timeless = service.upload(written(flown[0], tmp_path / "timeless.las", 0))["id"]
    first, second = inputs["strips"][0]["file"], inputs["strips"][1]["file"]

    def pointers(**changed: object) -> list[str]:
        answer = refusal(service, "adjust-strips", {**inputs, **changed})
        assert answer["type"]
        return [error["pointer"] for error in answer["errors"]]

    assert pointers(strips=[{"file": first}, {"file": timeless}]) == ["/inputs/strips/1/file"]
    assert pointers(strips=[{"file": first}, {"file": "nothing"}]) == ["/inputs/strips/1/file"]
    assert "/inputs/strips/1/file" in pointers(strips=[{"file": first}, {"file": first, "name": "again"}])
    assert pointers(strips=[{"file": first, "name": "a"}, {"file": second, "name": "a"}]) == ["/inputs/strips/1/name"]
    assert pointers(strips=[{"file": first}], control=[]) == ["/inputs/strips"]
    assert pointers(trajectories=[{"file": first}]) == ["/inputs/trajectories/0/file"]
    assert pointers(control=[{"name": "a", "x": 0.0, "y": 0.0}]) == ["/inputs/control/0/z"]
    assert pointers(corrections={"shift_degree": 99}) == ["/inputs/corrections/shift_degree"]


def test_a_trajectory_of_another_time_ends_the_job_with_advice(
    service: RunningService, inputs: Document, tmp_path: Path
) -> None:
    path = tmp_path / "other.txt"
    path.write_text("time x y z\n" + "".join(f"{k} {500000 + k} 5600000 800\n" for k in range(10)))
    job = service.execute("adjust-strips", {**inputs, "trajectories": [{"file": service.upload(path)["id"]}]})
    assert service.finished(job)["status"] == "failed"
    problem = service.get(f"/jobs/{job}/results").json()
    assert "none covers the times of strip" in problem["detail"]


def test_the_command_adjusts_strips_without_a_trajectory(
    service: RunningService, files: list[Path], tmp_path: Path
) -> None:
    where = ("--url", service.url, "--output", tmp_path / "kept", "--corrected", "laz")
    done = tieline("adjust-strips", *files[:3], "--corrections-tilt-degree", "-1", "--passes", "1", *where)
    assert done.returncode == 0, done.stderr
    kept = {path.name for path in (tmp_path / "kept").iterdir()}
    assert {"result.json", "discrepancies-after.png", "strip-1-corrected.laz"} <= kept
    told = json.loads((tmp_path / "kept" / "result.json").read_text())
    assert "a bore-sight is estimated only as shifts and turns that strips have in common" in told["conclusion"]
    assert any("give `trajectories`" in line for line in told["advice"])
