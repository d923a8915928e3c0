"""Grids say in which reference system and unit they are, as programs for maps read it."""

import struct

import numpy as np
import pyproj
import pytest

from algorithms.deviations.rasters import Grid
from schemas.values.crs import metre_wkt_1
from service.formats.writers.geotiff import geotiff
from service.formats.writers.grid_files import GridFrame, grid_files, grid_system

GRID = Grid(10.0, 20.0, 2.0, 3, 4)
VALUES = np.arange(12.0).reshape(3, 4)
FEET = ("EPSG:2227", "EPSG:2222", "EPSG:2263+6360", "EPSG:26943+6360", "EPSG:2227+5703", "EPSG:24370", "EPSG:2964")
"""US survey and international feet, feet in one part of a compound, Indian feet, no sibling in metres."""


def tags_of(content: bytes) -> dict[int, bytes]:
    (at,) = struct.unpack_from("<I", content, 4)
    (count,) = struct.unpack_from("<H", content, at)
    found = {}
    for k in range(count):
        tag, kind, number, place = struct.unpack_from("<HHII", content, at + 2 + 12 * k)
        size = number * {2: 1, 3: 2, 4: 4, 12: 8}[kind]
        start = at + 2 + 12 * k + 8 if size <= 4 else place
        found[tag] = content[start : start + size]
    return found


def keys_of(content: bytes) -> dict[int, int | str]:
    tags = tags_of(content)
    numbers = struct.unpack(f"<{len(tags[34735]) // 2}H", tags[34735])
    found: dict[int, int | str] = {}
    for key, place, count, value in np.reshape(numbers[4:], (-1, 4)).tolist():
        found[key] = value if place == 0 else tags[34737][value : value + count - 1].decode()
    assert list(found) == sorted(found)
    return found


@pytest.mark.parametrize("definition", FEET)
def test_a_system_in_feet_becomes_that_in_metres_at_the_same_places(definition: str) -> None:
    given, found = pyproj.CRS(definition), pyproj.CRS.from_wkt(metre_wkt_1(definition))
    assert all(axis.unit_conversion_factor == 1.0 for part in found.sub_crs_list or [found] for axis in part.axis_info)
    assert len(found.sub_crs_list) == len(given.sub_crs_list)
    level, metres = ((each.sub_crs_list or [each])[0] for each in (given, found))
    feet = level.axis_info[0].unit_conversion_factor
    place = np.array([600_000.0, 150_000.0])
    of_feet = pyproj.Transformer.from_crs(level, level.geodetic_crs, always_xy=True).transform(*place / feet)
    of_metres = pyproj.Transformer.from_crs(metres, metres.geodetic_crs, always_xy=True).transform(*place)
    np.testing.assert_allclose(of_metres, of_feet, atol=1e-10)


def test_systems_in_metres_stay() -> None:
    assert pyproj.CRS.from_wkt(metre_wkt_1("EPSG:25832+7837")).to_epsg(100) is None
    assert pyproj.CRS.from_wkt(metre_wkt_1("EPSG:25832")).to_epsg() == 25832
    assert metre_wkt_1("EPSG:4978").startswith("GEOCCS[")


@pytest.mark.parametrize(
    ("definition", "keys"),
    [("EPSG:25832+7837", (25832, 7837)), ("EPSG:2227+6360", (26943, 5703)), ("EPSG:2263", (32118, None))],
)
def test_geotiff_names_the_codes(definition: str, keys: tuple[int, int | None]) -> None:
    found = keys_of(geotiff(VALUES, GRID, (5e5, 5e6), grid_system(metre_wkt_1(definition)), "m"))
    assert (found[1024], found[3072], found[3076]) == (1, keys[0], 9001)
    assert (found.get(4096), found.get(4099)) == (keys[1], None if keys[1] is None else 9001)


def test_geotiff_defines_a_system_that_has_no_code() -> None:
    found = keys_of(geotiff(VALUES, GRID, (5e5, 5e6), grid_system(metre_wkt_1("EPSG:24370")), "m"))
    begin = "ESRI PE String = "
    assert (found[1024], found[3072]) == (32767, 32767)
    assert str(found[3073]).startswith(begin)
    defined = pyproj.CRS.from_wkt(str(found[3073]).removeprefix(begin))
    assert defined.axis_info[0].unit_conversion_factor == 1.0


def test_esri_grids_have_their_system_beside_them() -> None:
    frame = GridFrame(GRID, (5e5, 5e6), metre_wkt_1("EPSG:2227+6360"))
    files = grid_files("dtm", VALUES, frame, "m")
    assert set(files) == {"dtm.asc", "dtm.prj", "dtm.asc.aux.xml"}
    assert pyproj.CRS.from_wkt(files["dtm.prj"][1].decode()).to_epsg(20) == 26943
    assert b"COMPD_CS[" in files["dtm.asc.aux.xml"][1]
    assert b"<UnitType>m</UnitType>" in files["dtm.asc.aux.xml"][1]
    assert set(grid_files("dtm", VALUES, GridFrame(GRID, (0.0, 0.0)), "m")) == {"dtm.asc"}
