"""What a LAS file says of each point beside its place comes back from the files that are written."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pyproj
import pytest
from laspy.vlrs.known import GeoKeyDirectoryVlr, WktCoordinateSystemVlr

from algorithms.progress import NoProgress
from service.formats import read_scan
from service.formats.base import ScanFile
from service.formats.point_selection import ALL_POINTS
from service.formats.streaming import stream_scan
from service.formats.writers import cloud_of, copc, writer_of
from service.formats.writers.octree_spool import OctreeShape

N = 3000
SEED = 6
UTM_WKT = pyproj.CRS.from_epsg(25832).to_wkt("WKT1_GDAL")
SAME = (
    "classification", "return_number", "number_of_returns", "point_source_id", "user_data", "gps_time", "synthetic",
    "key_point", "withheld", "scan_direction_flag", "edge_of_flight_line",
)  # fmt: skip
NEW = ("overlap", "scanner_channel", "scan_angle")
COLORS = ("red", "green", "blue")


def full_of_attributes(path: Path, point_format: int, *, standard_time: bool = False, wkt: bool = True) -> Any:
    """Write a file in which all attributes differ from point to point; return what is in it."""
    rng = np.random.default_rng(SEED)
    header = laspy.LasHeader(point_format=point_format, version="1.4")
    header.scales, header.offsets = [0.001] * 3, [500_000.0, 5_400_000.0, 400.0]
    header.add_extra_dim(laspy.ExtraBytesParams("Amplitude [dB]", "u2", "echo", scales=[0.01], offsets=[0.0]))
    header.add_extra_dim(laspy.ExtraBytesParams("Deviation", "u2", "pulse shape"))
    if wkt:
        header.vlrs.append(WktCoordinateSystemVlr(UTM_WKT))
        header.global_encoding.wkt = True
    if standard_time:
        header.global_encoding.gps_time_type = laspy.header.GpsTimeType.STANDARD
    cloud: Any = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = (low + rng.uniform(0.0, 40.0, N) for low in header.offsets)
    names = set(cloud.point_format.dimension_names)
    cloud.number_of_returns = rng.integers(1, 6, N)
    cloud.return_number = rng.integers(1, np.asarray(cloud.number_of_returns) + 1)
    cloud.classification = rng.choice([2, 3, 5, 6, 7, 12, 18], N).astype(np.uint8)
    for name in ("synthetic", "key_point", "withheld", "scan_direction_flag", "edge_of_flight_line", "overlap"):
        if name in names:
            cloud[name] = rng.integers(0, 2, N)
    cloud.point_source_id, cloud.user_data = rng.integers(0, 65536, N), rng.integers(0, 256, N)
    cloud.intensity = rng.integers(0, 65536, N)
    if "scan_angle_rank" in names:
        cloud.scan_angle_rank = rng.integers(-90, 91, N).astype(np.int8)
    else:
        cloud.scan_angle = rng.integers(-30_000, 30_001, N).astype(np.int16)
        cloud.scanner_channel = rng.integers(0, 4, N)
    if "gps_time" in names:
        cloud.gps_time = 3e8 + np.arange(N) * 1e-5
    for name in (*COLORS, "nir"):
        if name in names:
            cloud[name] = rng.integers(0, 65536, N)
    cloud["Amplitude [dB]"], cloud["Deviation"] = rng.integers(0, 5000, N) * 0.01, rng.integers(0, 9, N)
    cloud.write(path)
    return cloud


def written_again(path: Path, name: str, target: Path) -> tuple[Any, tuple[str, ...]]:
    cloud = stream_scan(ScanFile(path, path.name, selection=ALL_POINTS, attributes=True))
    written = writer_of(name).write(target, [cloud], NoProgress())
    assert written.points == N
    back = laspy.read(target)
    order = np.lexsort([back.Deviation, back.x, back.y, back.z])
    return (back, order), cloud.notes


@pytest.mark.parametrize("name", ["laz", "copc"])
@pytest.mark.parametrize("ending", ["las", "laz"])
@pytest.mark.parametrize("point_format", [0, 1, 2, 3, 6, 7, 8])
def test_all_attributes_come_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, point_format: int, ending: str, name: str
) -> None:
    monkeypatch.setattr(copc, "SHAPE", OctreeShape(most_in_leaf=500))
    given = full_of_attributes(tmp_path / f"a.{ending}", point_format)
    (back, order), notes = written_again(tmp_path / f"a.{ending}", name, tmp_path / "b.laz")
    assert notes == ()
    of_given = np.lexsort([given.Deviation, given.x, given.y, given.z])
    names = set(given.point_format.dimension_names)
    for each in ({*SAME, *NEW, *COLORS, "nir", "intensity", "Amplitude [dB]", "Deviation"}) & names:
        np.testing.assert_array_equal(np.asarray(back[each])[order], np.asarray(given[each])[of_given], err_msg=each)
    if point_format < 6:
        np.testing.assert_array_equal(np.asarray(back.overlap)[order], np.asarray(given.classification)[of_given] == 12)
        degrees = np.rint(np.asarray(back.scan_angle)[order] * 0.006)
        np.testing.assert_array_equal(degrees, np.asarray(given.scan_angle_rank)[of_given])
    assert back.header.parse_crs().to_epsg() == 25832
    counts = np.bincount(np.asarray(given.return_number), minlength=16)[1:]
    assert np.asarray(back.header.number_of_points_by_return).tolist() == counts.tolist()


@pytest.mark.parametrize("name", ["laz", "copc"])
@pytest.mark.parametrize("is_standard", [False, True])
def test_times_keep_what_they_count_from(tmp_path: Path, name: str, is_standard: bool) -> None:
    full_of_attributes(tmp_path / "a.las", 6, standard_time=is_standard)
    (back, _), _ = written_again(tmp_path / "a.las", name, tmp_path / "b.laz")
    assert int(back.header.global_encoding.gps_time_type) == int(is_standard)


@pytest.mark.parametrize("name", ["ply", "pcd", "xyz", "e57", "pts", "ptx"])
def test_formats_without_a_place_write_columns_or_say_so(tmp_path: Path, name: str) -> None:
    full_of_attributes(tmp_path / "a.las", 6)
    cloud = stream_scan(ScanFile(tmp_path / "a.las", "a.las", attributes=True))
    writer = writer_of(name)
    written = writer.write(tmp_path / f"b{writer.ending}", [cloud], NoProgress())
    if name in {"pts", "ptx"}:
        assert any("classification, " in note and "gps_time" in note for note in written.notes)
    else:
        content = (tmp_path / f"b{writer.ending}").read_bytes()
        assert all(word in content for word in (b"classification", b"gps_time", b"amplitude__db_", b"scan_angle_deg"))
    assert any("withheld" in note for note in cloud.notes)


def test_a_scan_in_memory_has_the_attributes_of_the_points_that_are_used(tmp_path: Path) -> None:
    given = full_of_attributes(tmp_path / "a.las", 6)
    scan = read_scan(tmp_path / "a.las", "a.las", attributes=True)
    used = (np.asarray(given.withheld) == 0) & ~np.isin(given.classification, [7, 18])
    found = {field.name: values for field, values in scan.attributes.items()}
    np.testing.assert_array_equal(found["point_source_id"], np.asarray(given.point_source_id)[used])
    assert scan.crs_wkt == UTM_WKT
    writer_of("laz").write(tmp_path / "b.laz", [replace(cloud_of(scan), crs_wkt=scan.crs_wkt)], NoProgress())
    np.testing.assert_array_equal(laspy.read(tmp_path / "b.laz").gps_time, np.asarray(given.gps_time)[used])


def test_attributes_that_say_nothing_make_no_columns(tmp_path: Path) -> None:
    header = laspy.LasHeader(point_format=6, version="1.4")
    cloud: Any = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = np.random.default_rng(SEED).uniform(0.0, 9.0, (3, N))
    cloud.write(tmp_path / "a.las")
    assert read_scan(tmp_path / "a.las", "a.las", attributes=True).attributes == {}


def test_keys_of_geotiff_name_the_system_of_an_old_file(tmp_path: Path) -> None:
    keys = GeoKeyDirectoryVlr()
    keys.parse_record_data(np.array([1, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, 25832], dtype="<u2").tobytes())
    given = full_of_attributes(tmp_path / "a.las", 1, wkt=False)
    given.header.vlrs.append(keys)
    given.write(tmp_path / "a.las")
    (back, _), notes = written_again(tmp_path / "a.las", "laz", tmp_path / "b.laz")
    assert (back.header.parse_crs().to_epsg(), notes) == (25832, ())


@pytest.mark.parametrize("name", ["laz", "copc", "ply", "pcd", "xyz", "e57"])
def test_odd_names_of_extra_bytes_are_written_to_every_format(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr(copc, "SHAPE", OctreeShape(most_in_leaf=500))
    header = laspy.LasHeader(point_format=1, version="1.2")
    odd = ["overlap", "nir", "station", "Höhe", "above_ground_m", "intensity_2", "Amplitude", "amplitude", "a" * 32]
    for each in odd:
        header.add_extra_dim(laspy.ExtraBytesParams(each, "u1"))
    header.add_extra_dim(laspy.ExtraBytesParams("v" * 32, "3f4"))
    cloud: Any = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = np.random.default_rng(SEED).uniform(0.0, 9.0, (3, N))
    for number, each in enumerate(odd):
        cloud[each] = np.full(N, number + 1)
    cloud["v" * 32] = np.tile([1.0, 2.0, 3.0], (N, 1))
    cloud.write(tmp_path / "a.las")
    source = stream_scan(ScanFile(tmp_path / "a.las", "a.las", attributes=True))
    assert len(source.scalars) == len(odd) - 1 + 3
    writer = writer_of(name)
    target = tmp_path / f"b{writer.ending}"
    assert writer.write(target, [source], NoProgress()).points == N
    assert len(read_scan(target, target.name)) == N
    if name in {"laz", "copc"}:
        back = laspy.read(target)
        values = {each: set(np.unique(back[each]).tolist()) for each in back.point_format.extra_dimension_names}
        assert {1, 2, 4, 5, 6, 7, 8, 9} <= set().union(*values.values())
        assert values["Amplitude"] == {7}
