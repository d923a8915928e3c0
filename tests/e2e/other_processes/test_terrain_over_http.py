"""A cloud with hills, houses and trees goes in over HTTP; ground, models and drawings come out."""

import json
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pyproj
import pytest
from laspy.vlrs.known import WktCoordinateSystemVlr

from tests.e2e.other_processes.test_clean_and_colour_over_http import refusal, run
from tests.e2e.running.running_service import Document, RunningService
from tests.scenes.simulated_terrain import hills_with_houses
from tests.unit.service.formats.test_grid_files import keys_of, tags_of

SHIFT_M = np.array([500_000.0, 5_600_000.0, 300.0])
"""The project lies far from the origin of its coordinates."""


@pytest.fixture(scope="module")
def station(service: RunningService, tmp_path_factory: pytest.TempPathFactory) -> Document:
    points, _ = hills_with_houses()
    path = tmp_path_factory.mktemp("terrain") / "hills.xyz"
    np.savetxt(path, points + SHIFT_M, fmt="%.3f")
    return {"name": "hills", "scan": {"file": service.upload(path)["id"]}}


def test_ground_models_and_drawings_come_out(service: RunningService, station: Document, tmp_path: Path) -> None:
    inputs = {
        "stations": [station],
        "compare_filters": ["block-min"],
        "contour_interval_m": 1.0,
        "mesh": True,
        "canopy": True,
    }
    result = run(
        service, "terrain", inputs,
        {"classified": {"format": "laz"}, "ground": {}, "points": {}, "compared": {}, "artifacts": {}},
    )  # fmt: skip
    _, truth = hills_with_houses()
    (file,) = result["classified"]
    path = tmp_path / file["name"]
    path.write_bytes(service.get(file["href"]).content)
    classes = np.asarray(laspy.read(path).classification)
    assert (classes == 2).sum() == result["ground"]
    assert ((classes == 2) == truth).mean() > 0.98
    assert [row["name"] for row in result["compared"]] == ["block-min"]
    names = {each["name"] for each in result["artifacts"]}
    assert {
        "dtm.asc",
        "dsm.asc",
        "ndsm.asc",
        "hillshade.png",
        "contours.dxf",
        "terrain.ply",
        "density.png",
        "stand-height.asc",
    } <= names
    grid = service.get(next(each["href"] for each in result["artifacts"] if each["name"] == "dtm.asc")).text
    header = dict(line.split() for line in grid.splitlines()[:6])
    assert float(header["xllcorner"]) == pytest.approx(SHIFT_M[0], abs=2.0)


def test_the_slope_filter_learns_from_labelled_terrain(
    service: RunningService, station: Document, tmp_path: Path
) -> None:
    points, ground = hills_with_houses(density=1.0, seed=5)
    training = {}
    for name, part in (("ground", points[ground]), ("objects", points[~ground])):
        np.savetxt(tmp_path / f"{name}.xyz", part, fmt="%.3f")
        training[name] = {"file": service.upload(tmp_path / f"{name}.xyz")["id"]}
    inputs = {"stations": [station], "filter": {"name": "slope", "adaptive": False, "slope": 0.1}, "training": training}
    result = run(service, "terrain", inputs, {"ground": {}, "points": {}, "filter": {}})
    _, truth = hills_with_houses()
    assert result["ground"] / result["points"] == pytest.approx(truth.mean(), abs=0.02)
    allowed = result["filter"]["allowed_m"]
    assert allowed == sorted(allowed)
    problem = refusal(service, "terrain", {"stations": [station], "training": training})
    assert "/inputs/training" in str(problem)
    assert "learns nothing" in str(problem)


def test_a_filter_that_is_none_is_refused(service: RunningService, station: Document) -> None:
    problem = refusal(service, "terrain", {"stations": [station], "filter": {"name": "wizardry"}})
    assert "/inputs/filter" in str(problem)
    assert "opening" in str(problem)


def test_a_lake_has_no_data(service: RunningService, tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    x, y = rng.uniform(0.0, 90.0, (2, 16_000))
    dry = np.hypot(x - 40.0, y - 40.0) > 20.0
    np.savetxt(tmp_path / "lake.xyz", np.column_stack([x, y, 5.0 + 0.05 * x])[dry], fmt="%.3f")
    stations = [{"name": "lake", "scan": {"file": service.upload(tmp_path / "lake.xyz")["id"]}}]
    for gap_m, is_lake in ((20.0, True), (60.0, False)):
        inputs = {"stations": stations, "gap_m": gap_m, "mesh": True, "contour_interval_m": 0.5}
        result = run(service, "terrain", inputs, {"artifacts": {}, "remarks": {}, "no_data_share": {}, "models": {}})
        links = {each["name"]: each["href"] for each in result["artifacts"]}
        assert any("no data" in each for each in result["remarks"]) == is_lake
        assert result["no_data_share"] == pytest.approx(np.pi * 20.0**2 / 90.0**2 if is_lake else 0.0, rel=0.1)
        for model in ("dtm", "dsm", "ndsm"):
            lines = service.get(links[f"{model}.asc"]).text.splitlines()
            heights = np.array([line.split() for line in lines[6:]], dtype=float)[::-1]
            v, u = np.indices(heights.shape) + 0.5
            lake, shore = np.hypot(u - 40.0, v - 40.0) < 19.0, np.hypot(u - 40.0, v - 40.0) > 21.0
            assert (heights[lake] == -9999.0).all() == is_lake
            assert (heights[shore] != -9999.0).all()
        assert next(each for each in result["models"] if each["name"] == "dtm")["lowest_m"] > 4.9
    rain = run(service, "drainage", {"stations": stations}, {"artifacts": {}, "remarks": {}})
    assert any("no data" in each for each in rain["remarks"])
    links = {each["name"]: each["href"] for each in rain["artifacts"]}
    text = service.get(links["slope.asc"]).text
    assert "-9999" in text.split("NODATA_value -9999", 1)[1]


PLACE_M = np.array([600_000.0, 150_000.0, 300.0])
"""In metres of the systems below."""
SYSTEMS = {
    "EPSG:2222": (26948, None, "feet"),
    "EPSG:2227": (26943, None, "US survey feet"),
    "EPSG:2227+5703": (26943, 5703, "US survey feet (heights: metres)"),
    "EPSG:26943+6360": (26943, 5703, "metres (heights: US survey feet)"),
    "EPSG:25832+7837": (25832, 7837, ""),
}
"""EPSG codes of plane coordinates and heights in metres, and the words for the unit that was converted."""


def slope_in(path: Path, definition: str, *, keys: bool) -> None:
    """Write a slope of 1 in 10 whose coordinates are in the unit of a system, named by WKT or by GeoTIFF keys."""
    system = pyproj.CRS(definition)
    axes = [axis.unit_conversion_factor for part in system.sub_crs_list or [system] for axis in part.axis_info]
    units = np.array([axes[0], axes[1], axes[-1]])
    xy = np.random.default_rng(0).uniform(0.0, 40.0, (6000, 2))
    points = (np.column_stack([xy, 0.1 * xy[:, 0]]) + PLACE_M) / units
    header = laspy.LasHeader(point_format=1 if keys else 6, version="1.2" if keys else "1.4")
    header.scales, header.offsets = [0.001] * 3, np.floor(points[0])
    if keys:
        codes = [part.to_epsg() for part in system.sub_crs_list or [system]]
        entries = [(1024, 1), (3072, codes[0]), *([(4096, codes[1])] if len(codes) > 1 else [])]
        numbers = [1, 1, 0, len(entries), *(n for key, value in entries for n in (key, 0, 1, value))]
        header.vlrs.append(laspy.VLR("LASF_Projection", 34735, "", np.array(numbers, "<u2").tobytes()))
    else:
        header.vlrs.append(WktCoordinateSystemVlr(system.to_wkt("WKT1_GDAL")))
        header.global_encoding.wkt = True
    cloud: Any = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = points.T
    cloud.write(path)


@pytest.mark.parametrize("definition", SYSTEMS)
@pytest.mark.parametrize("keys", [True, False])
def test_feet_become_metres_and_it_is_said(
    service: RunningService, tmp_path: Path, definition: str, *, keys: bool
) -> None:
    code, vertical_code, unit = SYSTEMS[definition]
    slope_in(tmp_path / "slope.las", definition, keys=keys)
    stations = [{"name": "slope", "scan": {"file": service.upload(tmp_path / "slope.las")["id"]}}]
    stem = "dtm-metres" if unit else "dtm"
    wanted = {"remarks": {}, "artifacts": {}, "models": {}}
    result = run(
        service, "terrain", {"stations": stations, "maps": False, "grid_format": "geotiff"},
        {**wanted, "classified": {"format": "laz"}},
    )  # fmt: skip
    assert any(f"converted from {unit} to metres" in each for each in result["remarks"]) == bool(unit)
    links = {each["name"]: each["href"] for each in result["artifacts"]}
    content = service.get(links[f"{stem}.tif"]).content
    found, tags = keys_of(content), tags_of(content)
    assert (found[3072], found[3076], found.get(4096)) == (code, 9001, vertical_code)
    west, north = np.frombuffer(tags[33922], "<f8")[3:5]
    assert (west, north) == pytest.approx((PLACE_M[0], PLACE_M[1] + 40.0), abs=1.01)
    model = next(each for each in result["models"] if each["name"] == "dtm")
    assert (model["lowest_m"], model["highest_m"]) == pytest.approx((300.0, 304.0), abs=0.2)
    (file,) = result["classified"]
    assert file["name"] == ("classified-metres.laz" if unit else "classified.laz")
    (tmp_path / "back.laz").write_bytes(service.get(file["href"]).content)
    cloud = laspy.read(tmp_path / "back.laz")
    system = cloud.header.parse_crs()
    assert (system.sub_crs_list or [system])[0].to_epsg() == code
    assert np.asarray(cloud.x).mean() == pytest.approx(PLACE_M[0] + 20.0, abs=1.0)

    result = run(service, "drainage", {"stations": stations}, {"remarks": {}, "artifacts": {}})
    names = {each["name"]: each["href"] for each in result["artifacts"]}
    stem = "filled-metres" if unit else "filled"
    assert {f"{stem}.asc", f"{stem}.prj", f"{stem}.asc.aux.xml"} <= set(names)
    assert pyproj.CRS.from_wkt(service.get(names[f"{stem}.prj"]).text).to_epsg(20) == code


def geocentric_files(folder: Path) -> list[Path]:
    """Write a slope on the earth seen from its middle: named by WKT, by a GeoTIFF key, and as plain numbers."""
    latitude, longitude = np.radians([48.2, 16.3])
    up = np.array([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)])
    east = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    xy = np.random.default_rng(0).uniform(0.0, 40.0, (6000, 2))
    local = np.column_stack([xy, 0.1 * xy[:, 0]])
    points = local @ np.array([east, np.cross(up, east), up]) + 6_367_000.0 * up
    for name in ("wkt", "key"):
        header = laspy.LasHeader(point_format=6 if name == "wkt" else 1, version="1.4" if name == "wkt" else "1.2")
        header.scales, header.offsets = [0.001] * 3, np.floor(points[0])
        if name == "wkt":
            header.vlrs.append(WktCoordinateSystemVlr(pyproj.CRS(4978).to_wkt("WKT1_GDAL")))
        else:
            numbers = np.array([1, 1, 0, 2, 1024, 0, 1, 3, 2048, 0, 1, 4258], "<u2")
            header.vlrs.append(laspy.VLR("LASF_Projection", 34735, "", numbers.tobytes()))
        cloud: Any = laspy.LasData(header)
        cloud.x, cloud.y, cloud.z = points.T
        cloud.write(folder / f"{name}.las")
    np.savetxt(folder / "numbers.xyz", points, fmt="%.3f")
    return [folder / name for name in ("wkt.las", "key.las", "numbers.xyz")]


def test_geocentric_coordinates_have_no_heights(service: RunningService, tmp_path: Path) -> None:
    for path in geocentric_files(tmp_path):
        file = service.upload(path)
        assert any("geocentric" in each for each in file["warnings"])
        stations = [{"name": "slope", "scan": {"file": file["id"]}}]
        for process in ("terrain", "drainage", "roofs"):
            problem = refusal(service, process, {"stations": stations})
            assert "/inputs/stations/0/scan" in str(problem)
            assert "z is no height" in str(problem)
        levelled = [{**stations[0], "levelled_std_gon": 0.01}, {**stations[0], "name": "other"}]
        assert "z is no height" in str(refusal(service, "register", {"stations": levelled}))
        # with a pose to a level frame there are heights
        middle = np.array(json.loads(service.get(f"/files/{file['id']}").text)["scans"][0]["bounds_m"]).mean(axis=0)
        up = middle / np.linalg.norm(middle)
        east = np.cross([0.0, 0.0, 1.0], up) / np.linalg.norm(np.cross([0.0, 0.0, 1.0], up))
        turn = np.array([east, np.cross(up, east), up])
        pose = np.vstack([np.column_stack([turn, -turn @ middle]), [0.0, 0.0, 0.0, 1.0]])
        posed = [{**stations[0], "world_from_scan": pose.tolist()}]
        result = run(service, "terrain", {"stations": posed, "maps": False}, {"ground": {}, "points": {}})
        assert result["ground"] > 0.95 * result["points"]
