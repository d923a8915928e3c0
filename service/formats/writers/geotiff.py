"""GeoTIFF grids (OGC 19-008r4): one band of float32, deflated, placed by pixel scale and tie point.

The reference system is named by its EPSG codes; one without a code by its definition, as ArcGIS writes it.
"""

import struct
import zlib
from dataclasses import dataclass
from xml.sax.saxutils import escape

import numpy as np

from algorithms.deviations.rasters import Grid, GridValues
from service.formats.writers.esri_grid import NO_DATA

SHORT, LONG, ASCII, DOUBLE = 3, 4, 2, 12
DEFLATE, MINIMUM_IS_BLACK, IEEE_FLOAT = 8, 1, 3
PROJECTED, PIXEL_IS_AREA, METRE = 1, 1, 9001
MODEL, RASTER, CITATION, PROJECTED_SYSTEM, SYSTEM_CITATION, LINEAR_UNIT = 1024, 1025, 1026, 3072, 3073, 3076
VERTICAL_SYSTEM, VERTICAL_UNIT = 4096, 4099
"""Keys (OGC 19-008r4, annex D)."""
USER_DEFINED, TEXTS = 32767, 34737
STRIP_BYTES = 1 << 20


@dataclass(frozen=True)
class GridSystem:
    """A projected coordinate reference system in metres."""

    name: str
    wkt: str
    """WKT 1, with heights where they are known."""
    esri_wkt: str
    """WKT 1 of the plane coordinates, as ArcGIS reads it."""
    code: int | None
    """EPSG code of the plane coordinates; None: there is none."""
    vertical_code: int | None
    """EPSG code of the heights; None: there is none."""


def geotiff(
    values: GridValues,
    grid: Grid,
    origin: tuple[float, float] = (0.0, 0.0),
    system: GridSystem | None = None,
    unit: str = "",
) -> bytes:
    """Return a grid as GeoTIFF, the northernmost row first.

    Parameters
    ----------
    values, grid, origin
        As of `esri_ascii`.
    system
        Of the coordinates; None: metres of a system that nobody states.
    unit
        Of the values; empty: not said.
    """
    rows, columns = grid.shape
    cells = np.ascontiguousarray(np.where(np.isfinite(values), values, NO_DATA)[::-1], dtype="<f4")
    per_strip = max(1, STRIP_BYTES // (4 * columns))
    strips = [zlib.compress(cells[start : start + per_strip].tobytes()) for start in range(0, rows, per_strip)]
    starts = 8 + np.cumsum([0, *(len(strip) for strip in strips[:-1])])
    west = origin[0] + grid.u_min_m
    north = origin[1] + grid.v_min_m + rows * grid.cell_m
    keys, texts = _keys(system)
    told = f'<GDALMetadata><Item name="UNITTYPE" sample="0" role="unittype">{escape(unit)}</Item></GDALMetadata>'
    tags: list[tuple[int, int, bytes]] = [
        (256, LONG, struct.pack("<I", columns)),
        (257, LONG, struct.pack("<I", rows)),
        (258, SHORT, struct.pack("<H", 32)),
        (259, SHORT, struct.pack("<H", DEFLATE)),
        (262, SHORT, struct.pack("<H", MINIMUM_IS_BLACK)),
        (273, LONG, struct.pack(f"<{len(strips)}I", *starts.tolist())),
        (277, SHORT, struct.pack("<H", 1)),
        (278, LONG, struct.pack("<I", per_strip)),
        (279, LONG, struct.pack(f"<{len(strips)}I", *(len(strip) for strip in strips))),
        (339, SHORT, struct.pack("<H", IEEE_FLOAT)),
        (33550, DOUBLE, struct.pack("<3d", grid.cell_m, grid.cell_m, 0.0)),
        (33922, DOUBLE, struct.pack("<6d", 0.0, 0.0, 0.0, west, north, 0.0)),
        (34735, SHORT, struct.pack(f"<{len(keys)}H", *keys)),
        *([(TEXTS, ASCII, texts)] if texts else []),
        *([(42112, ASCII, told.encode("ascii", "replace") + b"\0")] if unit else []),
        (42113, ASCII, f"{NO_DATA}\0".encode()),
    ]
    body = b"".join(strips)
    body += b"\0" * (len(body) % 2)
    directory = 8 + len(body)
    beside = directory + 2 + 12 * len(tags) + 4
    entries, data = [], b""
    sizes = {SHORT: 2, LONG: 4, ASCII: 1, DOUBLE: 8}
    for tag, kind, value in tags:
        place = value.ljust(4, b"\0") if len(value) <= 4 else struct.pack("<I", beside + len(data))
        if len(value) > 4:
            data += value + b"\0" * (len(value) % 2)
        entries.append(struct.pack("<HHI", tag, kind, len(value) // sizes[kind]) + place)
    head = struct.pack("<2sHI", b"II", 42, directory)
    return head + body + struct.pack("<H", len(tags)) + b"".join(entries) + struct.pack("<I", 0) + data


def _keys(system: GridSystem | None) -> tuple[list[int], bytes]:
    """Return the directory of GeoTIFF keys, and the texts that it points to."""
    numbers = {MODEL: PROJECTED, RASTER: PIXEL_IS_AREA, LINEAR_UNIT: METRE}
    written: dict[int, str] = {}
    if system is not None:
        numbers[PROJECTED_SYSTEM] = USER_DEFINED if system.code is None else system.code
        written[CITATION] = system.name
        if system.code is None:
            numbers[MODEL] = USER_DEFINED  # else GDAL looks for a projection among the keys
            written[SYSTEM_CITATION] = f"ESRI PE String = {system.esri_wkt}"
        if system.vertical_code is not None:
            numbers |= {VERTICAL_SYSTEM: system.vertical_code, VERTICAL_UNIT: METRE}
    entries = {key: [key, 0, 1, number] for key, number in numbers.items()}
    texts = b""
    for key, text in written.items():
        content = text.replace("|", "/").encode("ascii", "replace") + b"|"
        entries[key] = [key, TEXTS, len(content), len(texts)]
        texts += content
    directory = [1, 1, 0, len(entries), *(number for key in sorted(entries) for number in entries[key])]
    return directory, texts + b"\0" if texts else b""
