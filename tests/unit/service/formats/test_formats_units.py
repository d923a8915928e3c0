"""Units that files declare, or their owners state."""

import struct
from pathlib import Path

import laspy
import numpy as np
import pytest
from laspy.vlrs.known import WktCoordinateSystemVlr
from pye57 import libe57

from algorithms.arrays import Array
from service.errors import UnreadableFileError
from service.formats import inspect_file, read_scan
from service.formats.crs_units import unit_of_crs
from service.formats.units import DeclaredUnit, UnknownUnit, unit_in_comments

FOOT, SURVEY_FOOT = 0.3048, 1200.0 / 3937.0
GEOGRAPHIC = (
    'GEOGCS["NAD83",DATUM["North_American_Datum_1983",SPHEROID["GRS 1980",6378137,298.257222101]],'
    'PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]]'
)


def projected(unit: str) -> str:
    return (
        f'PROJCS["grid",{GEOGRAPHIC},PROJECTION["Transverse_Mercator"],PARAMETER["latitude_of_origin",0],'
        f'PARAMETER["central_meridian",9],PARAMETER["scale_factor",1],PARAMETER["false_easting",500000],'
        f'PARAMETER["false_northing",0],{unit}]'
    )


US = 'UNIT["US survey foot",0.304800609601219]'
METRE = 'UNIT["metre",1]'
COMPOUND = f'COMPD_CS["both",{projected(US)},VERT_CS["height",VERT_DATUM["mean sea",2005],{METRE}]]'
FAR = np.array([6e5, 8e5, 100.0])
POINTS = np.random.default_rng(3).uniform(0.0, 30.0, (200, 3)).round(3)


def las(path: Path, points: Array, wkt: str = "", keys: list[tuple[int, int]] | None = None) -> Path:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, 1e-7), np.floor(points.min(axis=0))
    if wkt:
        header.vlrs.append(WktCoordinateSystemVlr(wkt))
    if keys:
        content = struct.pack("<4H", 1, 1, 0, len(keys)) + b"".join(struct.pack("<4H", k, 0, 1, v) for k, v in keys)
        header.vlrs.append(laspy.VLR("LASF_Projection", 34735, "", content))
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = points.T
    cloud.write(path)
    return path


def extent(path: Path) -> Array:
    bounds_m = inspect_file(path, path.name)[0].bounds_m
    assert bounds_m is not None
    return np.asarray(np.diff(bounds_m, axis=0)[0])


@pytest.mark.parametrize(
    ("wkt", "keys", "factors"),
    [
        (projected(US), None, [SURVEY_FOOT] * 3),
        (projected('UNIT["foot",0.3048]'), None, [FOOT] * 3),
        (projected(METRE), None, [1.0] * 3),
        (COMPOUND, None, [SURVEY_FOOT, SURVEY_FOOT, 1.0]),
        (f'LOCAL_CS["site",{US}]', None, [SURVEY_FOOT] * 3),
        ("", [(1024, 1), (3072, 2263)], [SURVEY_FOOT] * 3),
        ("", [(1024, 1), (3072, 32767), (3076, 9002)], [FOOT] * 3),
        ("", [(1024, 1), (3072, 32618), (4099, 9003)], [1.0, 1.0, SURVEY_FOOT]),
    ],
)
def test_las_in_feet_is_converted_to_metres(
    wkt: str, keys: list[tuple[int, int]] | None, factors: list[float], tmp_path: Path
) -> None:
    path = las(tmp_path / "a.las", POINTS + FAR, wkt, keys)
    # steps of 1e-7 of the file
    assert np.allclose(extent(path), np.ptp(POINTS, axis=0) * factors, rtol=0.0, atol=1e-6)


def test_a_conversion_is_said_and_one_of_nothing_is_not(tmp_path: Path) -> None:
    feet = inspect_file(las(tmp_path / "a.las", POINTS, projected(US)), "a.las")[0]
    metres = inspect_file(las(tmp_path / "b.las", POINTS, projected(METRE)), "b.las")[0]
    assert (feet.unit, metres.unit, metres.warnings) == ("us-ft", "m", ())
    assert "from US survey feet to metres" in feet.warnings[0]


@pytest.mark.parametrize(("wkt", "keys"), [(GEOGRAPHIC, None), ("", [(1024, 2), (2048, 4326)])])
def test_degrees_are_refused_with_the_way_out(wkt: str, keys: list[tuple[int, int]] | None, tmp_path: Path) -> None:
    with pytest.raises(UnreadableFileError, match=r"degrees of longitude and latitude.*projected system in metres"):
        inspect_file(las(tmp_path / "a.las", POINTS / 1e4 + np.array([8.5, 47.4, 0.0]), wkt, keys), "a.las")


def test_degrees_that_cannot_be_leave_the_unit_open(tmp_path: Path) -> None:
    info = inspect_file(las(tmp_path / "a.las", POINTS * 6.0, GEOGRAPHIC), "a.las")[0]
    assert "state their `unit`" in (info.open_unit or "")


def test_a_system_that_nobody_understands_is_warned_of(tmp_path: Path) -> None:
    info = inspect_file(las(tmp_path / "a.las", POINTS, 'PROJCS["oops",'), "a.las")[0]
    assert info.unit is None
    assert "taken for metres" in info.warnings[0]


def test_the_system_may_stand_behind_the_points(tmp_path: Path) -> None:
    path = las(tmp_path / "a.las", POINTS)
    content, wkt = bytearray(path.read_bytes()), projected(US).encode()
    struct.pack_into("<QI", content, 235, len(content), 1)
    content += struct.pack("<2x16sHQ32x", b"LASF_Projection", 2112, len(wkt)) + wkt
    path.write_bytes(content)
    assert inspect_file(path, "a.las")[0].unit == "us-ft"


def test_a_stated_unit_converts_all_lengths(tmp_path: Path) -> None:
    path = tmp_path / "a.ptx"
    head = "5\n1\n1000 2000 3000\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n1000 2000 3000 1\n"
    path.write_text(head + "1000 0 0 1\n2000 0 0 1\n0 3000 0 1\n0 0 4000 1\n500 0 0 1\n")
    scan = read_scan(path, "a.ptx", unit="mm")
    assert scan.points.max(axis=0).tolist() == [2.0, 3.0, 4.0]
    assert scan.world_from_scan is not None
    assert scan.world_from_scan.translation.tolist() == [1.0, 2.0, 3.0]


def test_a_stated_unit_that_contradicts_the_file_is_refused(tmp_path: Path) -> None:
    path = las(tmp_path / "a.las", POINTS, projected(US))
    with pytest.raises(UnreadableFileError, match="US survey feet"):
        read_scan(path, "a.las", unit="mm")
    assert len(read_scan(path, "a.las", unit="us-ft")) == len(POINTS)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.xyz", "# unit: mm\n"),
        ("a.csv", "X[mm];Y[mm];Z[mm]\n"),
        ("a.txt", "x_mm y_mm z_mm\n"),
        ("a.ply", "ply\nformat ascii 1.0\ncomment unit: mm\nelement vertex 200\n"),
        ("b.ply", "ply\nformat ascii 1.0\nobj_info units millimeters\nelement vertex 200\n"),
        (
            "a.pcd",
            "# units = mm\nVERSION 0.7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 200\nHEIGHT 1\n",
        ),
    ],
)
def test_units_of_comments_and_names_are_converted(name: str, content: str, tmp_path: Path) -> None:
    ends = {
        ".ply": "property double x\nproperty double y\nproperty double z\nend_header\n",
        ".pcd": "POINTS 200\nDATA ascii\n",
    }
    path, separator = tmp_path / name, ";" if name.endswith(".csv") else " "
    rows = "".join(separator.join(f"{v:.1f}" for v in row) + "\n" for row in POINTS * 1000.0)
    path.write_text(content + ends.get(path.suffix, "") + rows)
    assert inspect_file(path, name)[0].unit == "mm"
    assert np.allclose(extent(path), np.ptp(POINTS, axis=0), rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("comment", "name"),
    [
        ("unit: mm", "mm"),
        ("Units are feet", "ft"),
        ("unit = US survey feet", "us-ft"),
        ("coordinates in metres", "m"),
        ("linear_unit: centimeters", "cm"),
    ],
)
def test_comments_that_name_the_unit(comment: str, name: str) -> None:
    unit = unit_in_comments(["made by hand", comment])
    assert isinstance(unit, DeclaredUnit)
    assert unit.name == name


@pytest.mark.parametrize("comment", ["intensity unit: dB", "angle unit: degrees", "unit test", "made in Meters Hall"])
def test_comments_that_do_not_name_it(comment: str) -> None:
    assert unit_in_comments([comment]) is None


def test_a_unit_that_is_none_of_length_is_unknown() -> None:
    assert isinstance(unit_in_comments(["unit: furlongs"]), UnknownUnit)


def test_a_definition_without_content_says_nothing() -> None:
    assert unit_of_crs(" \0", "here") is None


@pytest.mark.parametrize(("wkt", "is_open"), [(projected(US), True), (projected(METRE), False), (GEOGRAPHIC, True)])
def test_e57_whose_system_is_not_in_metres_leaves_the_unit_open(wkt: str, is_open: bool, tmp_path: Path) -> None:
    path = tmp_path / "a.e57"
    e57(path, wkt)
    info = inspect_file(path, "a.e57")[0]
    assert (info.open_unit is not None) is is_open
    assert np.allclose(extent(path), np.ptp(POINTS, axis=0))


def e57(path: Path, wkt: str) -> None:
    """Write one scan in a file that names a coordinate reference system."""
    file = libe57.ImageFile(str(path), "w")
    root = file.root()
    data = libe57.VectorNode(file, True)
    scan, prototype = libe57.StructureNode(file), libe57.StructureNode(file)
    root.set("coordinateMetadata", libe57.StringNode(file, wkt))
    root.set("data3D", data)
    columns = {}
    for axis, name in enumerate(("cartesianX", "cartesianY", "cartesianZ")):
        prototype.set(name, libe57.FloatNode(file, 0.0, libe57.E57_DOUBLE))
        columns[name] = np.ascontiguousarray(POINTS[:, axis])
    points = libe57.CompressedVectorNode(file, prototype, libe57.VectorNode(file, True))
    scan.set("points", points)
    data.append(scan)
    buffers = libe57.VectorSourceDestBuffer()
    for name, array in columns.items():
        buffers.append(libe57.SourceDestBuffer(file, name, array, len(array), True, True))
    writer = points.writer(buffers)
    writer.write(len(POINTS))
    writer.close()
    file.close()
