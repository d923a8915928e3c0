"""COPC 1.0: LAZ 1.4 in the order of an octree, so that viewers load what they show."""

import struct
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, final

import numpy as np

from algorithms.arrays import Array, Vector3
from algorithms.progress import Progress, ProgressSection
from algorithms.scans.octree import Key
from service.formats.writers.base import StationCloud, Written
from service.formats.writers.las import DATE_OFFSET, las_notes
from service.formats.writers.las_records import (
    LAS_KINDS,
    MOST_RETURNS,
    SCALE_M,
    STATIONS_RECORD,
    STATIONS_USER,
    LasLayout,
    names_record,
)
from service.formats.writers.octree_spool import OctreeShape, octree_nodes
from service.formats.writers.placed import PlacedClouds, placed
from service.formats.writers.whole_files import require_length, whole_file

SHAPE = OctreeShape(most_in_leaf=100_000)
CELLS = 1 << SHAPE.cell_levels
EXTRA_BYTES_RECORD = 4
RECORD_HEAD = struct.Struct("<2x16sHH32s")
"""User, number, length and description of a record; 20 bytes before the end of its head stands the length."""
RECORDS_OFFSET = 100
"""Number of records in the header."""
ENCODING_OFFSET = 6
"""Global encoding, whose first bit says that times are standard GPS times."""
RETURNS_OFFSET = 255
"""Points of each return in the header."""


@final
@dataclass(frozen=True)
class CopcWriter:
    """Write COPC through copclib: steps of 0.1 mm from an offset near the data, WKT, stations as extra bytes."""

    name: str = "copc"
    ending: str = ".copc.laz"
    media_type: str = "application/vnd.laszip+copc"

    def write(self, path: Path, clouds: Sequence[StationCloud], progress: Progress) -> Written:
        """Write stations into one file in the world frame; the points lie in a file beside it in between."""
        everything = placed(clouds, with_stations=True)
        layout = LasLayout.of(everything, path.name)
        points = _LasPoints(everything, layout, _Cube.around(everything, layout))
        with whole_file(path) as partial, tempfile.TemporaryFile(dir=path.parent) as spool:
            counts = np.zeros(MOST_RETURNS, dtype="<u8")
            nodes = octree_nodes(points, spool, SHAPE, ProgressSection(progress, 0.0, 0.5))
            counted = _counting(nodes, counts)
            written = _write_nodes(partial, points, counted, ProgressSection(progress, 0.5, 1.0))
            require_length(partial, written)
            _complete(partial, layout, everything, counts)
        return Written(everything.points, las_notes(everything))


@dataclass(frozen=True, eq=False)
class _Cube:
    """The root of the octree, in the steps of the records."""

    low: Vector3
    side: float

    @staticmethod
    def around(clouds: PlacedClouds, layout: LasLayout) -> "_Cube":
        low_m, high_m = clouds.bounds_m()
        side = float((high_m - low_m).max()) / SCALE_M + 20.0
        return _Cube(np.floor((low_m - layout.offset_m) / SCALE_M) - 10.0, side)

    def cells(self, records: Array, level: int) -> Array:
        """Give the (n, 3) cells of a level in which records lie."""
        steps = np.column_stack([records[axis] for axis in "XYZ"]) - self.low
        return np.asarray(np.minimum(steps * (2.0**level / self.side), 2**level - 1)).astype(np.int64)


@dataclass(frozen=True, eq=False)
class _LasPoints:
    """The records of a file, for the octree."""

    clouds: PlacedClouds
    layout: LasLayout
    cube: _Cube

    @property
    def dtype(self) -> np.dtype[Any]:
        return self.layout.dtype

    def pieces(self, progress: Progress) -> Iterator[Array]:
        for number, cloud, piece in self.clouds.pieces(progress):
            yield self.layout.records(number, cloud, piece)

    def cells(self, records: Array, level: int) -> Array:
        return self.cube.cells(records, level)


def _write_nodes(path: Path, points: _LasPoints, nodes: Iterator[tuple[Key, Array]], progress: Progress) -> int:
    """Compress node after node; give the bytes that the file must have at least."""
    import copclib

    clouds, layout, cube = points.clouds, points.layout, points.cube
    extra = sum(np.dtype(field.kind).itemsize for field in layout.scalars)
    config = copclib.CopcConfigWriter(
        layout.point_format,
        copclib.Vector3(*[SCALE_M] * 3),
        copclib.Vector3(*layout.offset_m.tolist()),
        clouds.crs_wkt or "",
        copclib.EbVlr(extra),
        False,
    )
    half_m = 0.5 * cube.side * SCALE_M
    centre_m = cube.low * SCALE_M + layout.offset_m + half_m
    low_m, high_m = clouds.bounds_m()
    info, header = config.copc_info, config.las_header
    info.center_x, info.center_y, info.center_z = centre_m.tolist()
    info.halfsize, info.spacing = half_m, 2.0 * half_m / CELLS
    header.min, header.max = copclib.Vector3(*low_m.tolist()), copclib.Vector3(*high_m.tolist())
    writer = copclib.FileWriter(str(path), config)
    end, done, total = 0, 0, max(1, clouds.points)
    for key, records in nodes:
        node = writer.AddNode(copclib.VoxelKey(*key), copclib.VectorChar(records.view(np.int8)))
        end = max(end, node.offset + node.byte_size)
        done += len(records)
        progress.report(done / total, "writing nodes")
    writer.Close()
    return end


def _counting(nodes: Iterator[tuple[Key, Array]], counts: Array) -> Iterator[tuple[Key, Array]]:
    """Yield nodes, and add up the points of each number of a return."""
    for key, records in nodes:
        counts += np.bincount(records["returns"] & MOST_RETURNS, minlength=MOST_RETURNS + 1)[1:].astype(counts.dtype)
        yield key, records


def _complete(path: Path, layout: LasLayout, clouds: PlacedClouds, counts: Array) -> None:
    """Write counts and kind of time into the header, and describe the extra bytes, for which copclib has no way.

    What is left of its record of extra bytes becomes one of its own, with the names of the stations where they have
    room.
    """
    descriptors = b"".join(
        struct.pack(
            "<2xBB32s4x120x32s", LAS_KINDS[s.kind], 0, (s.title or s.name).encode(), s.description.encode()[:32]
        )
        for s in layout.scalars
    )
    with path.open("r+b") as file:
        place, length, records = _record(file)
        left = length - len(descriptors) - RECORD_HEAD.size
        if left < 0:
            raise RuntimeError(f"copclib left {length} bytes for {len(layout.scalars)} fields")
        names = names_record(clouds.clouds)
        file.seek(place - 34)
        file.write(struct.pack("<H", len(descriptors)))
        file.seek(place)
        head = RECORD_HEAD.pack(STATIONS_USER.encode(), STATIONS_RECORD, left, b"names of stations")
        file.write(descriptors + head + (names if len(names) <= left else b"{}").ljust(left))
        file.seek(RECORDS_OFFSET)
        file.write(struct.pack("<I", records + 1))
        file.seek(DATE_OFFSET)
        file.write(bytes(4))
        file.seek(RETURNS_OFFSET)
        file.write(counts.tobytes())
        file.seek(ENCODING_OFFSET)
        encoding = struct.unpack("<H", file.read(2))[0] | int(layout.is_standard_time)
        file.seek(ENCODING_OFFSET)
        file.write(struct.pack("<H", encoding))


def _record(file: BinaryIO) -> tuple[int, int, int]:
    """Find the record of extra bytes: where its content begins, how long it is, and how many records there are."""
    head = file.read(375)
    place, count = struct.unpack_from("<H", head, 94)[0], struct.unpack_from("<I", head, RECORDS_OFFSET)[0]
    for _ in range(count):
        file.seek(place)
        _, number, length, _ = RECORD_HEAD.unpack(file.read(RECORD_HEAD.size))
        place += RECORD_HEAD.size
        if number == EXTRA_BYTES_RECORD:
            return place, length, count
        place += length
    raise RuntimeError("copclib wrote no record of extra bytes")
