"""A LAS file whose points carry flags, classes and returns goes in over HTTP; what they say is heeded and kept."""

from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pyproj
import pytest
from laspy.vlrs.known import WktCoordinateSystemVlr

from tests.e2e.other_processes.test_clean_and_colour_over_http import run
from tests.e2e.running.running_service import Document, RunningService

N = 20_000
SLOPE = 0.02
SEED = 0


def slope_with_false_points(path: Path, point_format: int) -> tuple[int, int]:
    """Write a slope, below it a patch of withheld points, below and above it noise; return how many of both."""
    rng = np.random.default_rng(SEED)
    xy = rng.uniform(0.0, 100.0, (N, 2))
    z = SLOPE * xy[:, 0] + rng.normal(0.0, 0.03, N)
    patch = (np.abs(xy - 70.0) < 6.0).all(axis=1) & (rng.random(N) < 0.5)
    z[patch] -= 2.0
    noise = np.flatnonzero(~patch)[:40]
    z[noise[:20]] -= 5.0
    z[noise[20:]] += 40.0
    classes = np.ones(N, np.uint8)
    classes[noise[:20]], classes[noise[20:]] = 7, 18
    header = laspy.LasHeader(point_format=point_format, version="1.4" if point_format >= 6 else "1.2")
    header.scales = [0.001] * 3
    cloud: Any = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = xy[:, 0], xy[:, 1], z
    cloud.return_number = cloud.number_of_returns = np.ones(N, np.uint8)
    cloud.classification, cloud.withheld = classes, patch
    cloud.write(path)
    return int(patch.sum()), len(noise)


@pytest.mark.parametrize(("point_format", "ending"), [(1, "las"), (6, "laz")])
def test_withheld_points_and_noise_are_no_terrain(
    service: RunningService, tmp_path: Path, point_format: int, ending: str
) -> None:
    path = tmp_path / f"slope-{point_format}.{ending}"
    withheld, noise = slope_with_false_points(path, point_format)
    file: Document = service.upload(path)
    said = f"points left out as the file marks them: {withheld} withheld, {noise} noise (classes 7 and 18)"
    assert said in file["warnings"]
    inputs = {"stations": [{"name": "slope", "scan": {"file": file["id"]}}], "maps": False}
    result = run(service, "terrain", inputs, {"points": {}, "artifacts": {}})
    assert result["points"] == N - withheld - noise
    links = {each["name"]: each["href"] for each in result["artifacts"]}
    for model in ("dtm.asc", "dsm.asc"):
        lines = service.get(links[model]).text.splitlines()
        head = {name: float(value) for name, value in (line.split() for line in lines[:6])}
        heights = np.array([line.split() for line in lines[6:]], dtype=float)
        x = head["xllcorner"] + head["cellsize"] * (np.arange(heights.shape[1]) + 0.5)
        assert np.abs(heights - SLOPE * x).max() < 0.2


def with_attributes(path: Path, point_format: int) -> Any:
    """Write a slope in UTM whose points have classes, times, returns, angles and strips; return what is in it."""
    rng = np.random.default_rng(SEED)
    count = 5000
    header = laspy.LasHeader(point_format=point_format, version="1.4" if point_format >= 6 else "1.2")
    header.scales, header.offsets = [0.001] * 3, [500_000.0, 5_400_000.0, 400.0]
    header.vlrs.append(WktCoordinateSystemVlr(pyproj.CRS.from_epsg(25832).to_wkt("WKT1_GDAL")))
    header.add_extra_dim(laspy.ExtraBytesParams("Echo width", "f4", "[ns]"))
    cloud: Any = laspy.LasData(header)
    xy = rng.uniform(0.0, 60.0, (count, 2))
    cloud.x, cloud.y = 500_000.0 + xy[:, 0], 5_400_000.0 + xy[:, 1]
    cloud.z = 400.0 + 0.05 * xy[:, 0] + rng.normal(0.0, 0.01, count)
    cloud.classification, cloud.gps_time = rng.choice([2, 5, 6], count), 3e5 + np.arange(count) * 1e-5
    cloud.number_of_returns, cloud.return_number = np.full(count, 3), rng.integers(1, 4, count)
    cloud.point_source_id, cloud.user_data = rng.integers(11, 15, count), np.full(count, 9)
    cloud.withheld = rng.random(count) < 0.1
    cloud["Echo width"] = rng.uniform(3.0, 5.0, count)
    cloud.write(path)
    return cloud


def fetched(service: RunningService, artifact: Document, folder: Path) -> Any:
    path = folder / str(artifact["name"])
    path.write_bytes(service.get(str(artifact["href"])).content)
    return laspy.read(path)


CARRIED = ("gps_time", "number_of_returns", "return_number", "point_source_id", "user_data", "Echo width")


@pytest.mark.parametrize(("point_format", "name"), [(1, "laz"), (6, "copc")])
def test_attributes_and_reference_system_stay(
    service: RunningService, tmp_path: Path, point_format: int, name: str
) -> None:
    path = tmp_path / f"attributes-{point_format}.las"
    given = with_attributes(path, point_format)
    stations = [{"name": "S", "scan": {"file": service.upload(path)["id"]}}]
    withheld = np.asarray(given.withheld) != 0
    (file,) = run(service, "transform", {"stations": stations, "format": name})["files"]
    back = fetched(service, file, tmp_path)
    order, of_given = np.argsort(back.gps_time), np.argsort(given.gps_time)
    for each in (*CARRIED, "classification", "withheld"):
        np.testing.assert_array_equal(np.asarray(back[each])[order], np.asarray(given[each])[of_given], err_msg=each)
    assert back.header.parse_crs().to_epsg() == 25832

    cleaned = run(
        service, "clean", {"stations": stations, "cleaning": {}}, {"cleaned": {"format": name}, "remarks": {}}
    )
    classified = run(
        service, "terrain", {"stations": stations, "maps": False},
        {"classified": {"format": name}, "remarks": {}, "points": {}},
    )  # fmt: skip
    for result, kind, classes in ((cleaned, "cleaned", "classification"), (classified, "classified", "class_before")):
        (file,) = result[kind]
        back = fetched(service, file, tmp_path)
        assert back.header.parse_crs().to_epsg() == 25832
        assert any(f"{withheld.sum()} withheld" in remark for remark in result["remarks"])
        of_time = np.searchsorted(np.asarray(given.gps_time), np.asarray(back.gps_time))
        assert not withheld[of_time].any()
        for each in CARRIED:
            np.testing.assert_array_equal(np.asarray(back[each]), np.asarray(given[each])[of_time], err_msg=each)
        np.testing.assert_array_equal(np.asarray(back[classes]), np.asarray(given.classification)[of_time])


def test_what_a_format_cannot_hold_and_a_pose_moves_is_said(service: RunningService, tmp_path: Path) -> None:
    path = tmp_path / "attributes.laz"
    given = with_attributes(path, 6)
    station = {"name": "S", "scan": {"file": service.upload(path)["id"]}}
    (file,) = run(service, "transform", {"stations": [station], "format": "pts"})["files"]
    said = " / ".join(file["notes"])
    assert file["points"] == (np.asarray(given.withheld) == 0).sum()
    assert all(word in said for word in ("withheld", "gps_time", "coordinate reference system"))
    moved = np.eye(4)
    moved[:3, 3] = 1.0
    posed = {**station, "world_from_scan": moved.tolist()}
    (file,) = run(service, "transform", {"stations": [posed], "format": "laz"})["files"]
    assert any("coordinate reference system of the file is not named" in note for note in file["notes"])


def test_a_file_of_withheld_points_alone_is_refused_in_words(service: RunningService, tmp_path: Path) -> None:
    path = tmp_path / "nothing.las"
    cloud = with_attributes(path, 6)
    cloud.withheld = np.ones(len(cloud), np.uint8)
    cloud.write(path)
    answer = service.post("/files", files={"file": (path.name, path.read_bytes())})
    assert answer.status_code == 400
    assert "no point of the scan is left: points left out as the file marks them: 5000 withheld" in answer.text


HOUSE = {"name": "house", "corners_m": [(20.0, 20.0), (40.0, 20.0), (40.0, 35.0), (20.0, 35.0)], "ground_m": 0.0}


def house_below_a_tree(path: Path) -> dict[int, int]:
    """Write ground (class 2), a flat roof 5 m above it (6) and a crown 9 m above (5), whose pulses go on below."""
    rng = np.random.default_rng(SEED)
    xy = rng.uniform(0.0, 60.0, (N, 2))
    roof = (xy[:, 0] > 20.0) & (xy[:, 0] < 40.0) & (xy[:, 1] > 20.0) & (xy[:, 1] < 35.0)
    crown = rng.random(N) < 0.4
    classes = np.where(crown, 5, np.where(roof, 6, 2)).astype(np.uint8)
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = [0.001] * 3
    cloud: Any = laspy.LasData(header)
    cloud.x, cloud.y = xy.T
    cloud.z = np.select([crown, roof], [9.0, 5.0], 0.0) + rng.normal(0.0, 0.01, N)
    cloud.classification = classes
    cloud.return_number, cloud.number_of_returns = np.where(crown, 1, 2), np.full(N, 2)
    cloud.write(path)
    return {each: int((classes == each).sum()) for each in (2, 5, 6)}


def test_requests_choose_classes_and_returns(service: RunningService, tmp_path: Path) -> None:
    counts = house_below_a_tree(tmp_path / "house.laz")
    stations = [{"name": "house", "scan": {"file": service.upload(tmp_path / "house.laz")["id"]}}]

    rain = run(service, "drainage", {"stations": stations, "classes": [2]}, {"points": {}, "remarks": {}})
    assert rain["points"] == counts[2]
    assert any(f"{counts[6]} of class 6" in remark for remark in rain["remarks"])

    inputs = {"stations": stations, "returns": "last", "maps": False}
    result = run(service, "terrain", inputs, {"points": {}, "models": {}, "remarks": {}})
    assert result["points"] == counts[2] + counts[6]
    assert next(each for each in result["models"] if each["name"] == "dsm")["highest_m"] < 5.1
    assert f"house: points left out as the file marks them: {counts[5]} of other returns" in result["remarks"]

    plane = {"name": "roof", "point_m": [30.0, 27.0, 5.0], "normal": [0.0, 0.0, 1.0]}
    inputs = {"cloud": stations, "planes": [plane], "classes": [6], "max_distance_m": 20.0}
    compared = run(service, "compare", inputs, {"points": {}, "figures": {}, "remarks": {}})
    assert compared["points"] == compared["figures"]["count"] == counts[6]
    assert any(f"{counts[5]} of class 5" in remark for remark in compared["remarks"])

    inputs = {"stations": stations, "cleaning": {}, "classes": [5, 6], "returns": "first"}
    cleaned = run(service, "clean", inputs, {"points_after": {}, "remarks": {}})
    assert cleaned["points_after"] == counts[5]
    assert any(f"{counts[2]} of class 2, {counts[6]} of other returns" in remark for remark in cleaned["remarks"])

    inputs = {"stations": stations, "plans": [HOUSE], "classes": [2, 6]}
    roofs = run(service, "roofs", inputs, {"buildings": {}, "remarks": {}})
    assert roofs["buildings"][0]["volume_m3"] == pytest.approx(20.0 * 15.0 * 5.0, rel=0.01)
    assert roofs["remarks"] == [f"house: points left out as the file marks them: {counts[5]} of class 5"]


def test_a_class_that_no_point_has_is_refused_with_those_there_are(service: RunningService, tmp_path: Path) -> None:
    counts = house_below_a_tree(tmp_path / "house.las")
    stations = [{"name": "house", "scan": {"file": service.upload(tmp_path / "house.las")["id"]}}]
    job = service.execute("drainage", {"stations": stations, "classes": [9]})
    assert service.finished(job)["status"] == "failed"
    problem = service.get(f"/jobs/{job}/results").json()
    assert "no point of the scan is left" in problem["detail"]
    assert f"{counts[6]} of class 6" in problem["detail"]


def test_files_without_classes_are_used_whole_and_it_is_said(service: RunningService, tmp_path: Path) -> None:
    np.savetxt(tmp_path / "plain.xyz", np.random.default_rng(SEED).uniform(0.0, [40.0, 40.0, 0.1], (4000, 3)))
    stations = [{"name": "plain", "scan": {"file": service.upload(tmp_path / "plain.xyz")["id"]}}]
    rain = run(service, "drainage", {"stations": stations, "classes": [2]}, {"points": {}, "remarks": {}})
    assert rain["points"] == 4000
    assert "plain: the file tells no classes, returns or overlap: all its points are used" in rain["remarks"]
