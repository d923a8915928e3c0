"""GeoTIFF grids (OGC 19-008r4): one band of float32, deflated, placed by pixel scale and tie point.

A reference system is not stated, for the service knows none: metres, and the coordinates of the world.
"""

import struct
import zlib

import numpy as np

from algorithms.deviations.rasters import Grid, GridValues
from service.formats.writers.esri_grid import NO_DATA

SHORT, LONG, ASCII, DOUBLE = 3, 4, 2, 12
DEFLATE, MINIMUM_IS_BLACK, IEEE_FLOAT = 8, 1, 3
PROJECTED, PIXEL_IS_AREA, METRE = 1, 1, 9001
STRIP_BYTES = 1 << 20


def geotiff(values: GridValues, grid: Grid, origin: tuple[float, float] = (0.0, 0.0)) -> bytes:
    """Give a grid as GeoTIFF, the northernmost row first; parameters as of `esri_ascii`."""
    rows, columns = grid.shape
    cells = np.ascontiguousarray(np.where(np.isfinite(values), values, NO_DATA)[::-1], dtype="<f4")
    per_strip = max(1, STRIP_BYTES // (4 * columns))
    strips = [zlib.compress(cells[start : start + per_strip].tobytes()) for start in range(0, rows, per_strip)]
    starts = 8 + np.cumsum([0, *(len(strip) for strip in strips[:-1])])
    west = origin[0] + grid.u_min_m
    north = origin[1] + grid.v_min_m + rows * grid.cell_m
    keys = [1, 1, 0, 3, 1024, 0, 1, PROJECTED, 1025, 0, 1, PIXEL_IS_AREA, 3076, 0, 1, METRE]
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
