"""COPC 1.0: LAZ 1.4 in the order of an octree, so that viewers load what they show."""

import os
import struct
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, BinaryIO, final

import numpy as np

from algorithms.arrays import Array, Vector3
from algorithms.progress import Progress, ProgressSection
from service.formats.writers.base import StationCloud, Written
from service.formats.writers.las import DATE_OFFSET, las_notes
from service.formats.writers.las_records import (
    LAS_KINDS,
    SCALE_M,
    STATIONS_RECORD,
    STATIONS_USER,
    LasLayout,
    names_record,
)
from service.formats.writers.octree import CELL_LEVELS, CELLS, OctreeSorter, morton
from service.formats.writers.placed import PlacedClouds, placed
from service.formats.writers.whole_files import require_length, whole_file

DEEPEST_LEAF = 10
"""Levels of the octree; the cells of its deepest nodes divide it 131072 times a side."""
MOST_IN_LEAF = 100_000
"""A node with more points is divided."""
EXTRA_BYTES_RECORD = 4
RECORD_HEAD = struct.Struct("<2x16sHH32s")
"""User, number, length and description of a record; 20 bytes before the end of its head stands the length."""
RECORDS_OFFSET = 100
"""Number of records in the header."""


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
        cube = _Cube.around(everything, layout)
        leaves = _leaves(everything, layout, cube, ProgressSection(progress, 0.0, 0.25))
        with whole_file(path) as partial, tempfile.TemporaryFile(dir=path.parent) as spool:
            _spool(spool, everything, layout, cube, leaves, ProgressSection(progress, 0.25, 0.5))
            written = _write_nodes(
                partial, spool, everything, layout, cube, leaves, ProgressSection(progress, 0.5, 1.0)
            )
            require_length(partial, written)
            _name_extra_bytes(partial, layout, everything)
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
class _Leaves:
    """The leaves of the octree in Morton order."""

    levels: Array
    codes: Array
    """Morton number of each at its own level."""
    starts: Array
    """Morton number of the first cell of each at the deepest level."""
    offsets: Array
    """(leaves + 1,) number of points before each."""


def _leaves(clouds: PlacedClouds, layout: LasLayout, cube: _Cube, progress: Progress) -> _Leaves:
    """Count the points of the deepest cells and join cells to leaves that are not too large."""
    codes, counts = np.zeros(0, dtype=np.uint64), np.zeros(0, dtype=np.int64)
    for number, cloud, piece in clouds.pieces(progress):
        code = morton(cube.cells(layout.records(number, cloud, piece), DEEPEST_LEAF))
        fresh, count = np.unique(code, return_counts=True)
        merged, inverse = np.unique(np.concatenate([codes, fresh]), return_inverse=True)
        counts = np.bincount(inverse, weights=np.concatenate([counts, count]), minlength=len(merged)).astype(np.int64)
        codes = merged
    levels = np.zeros(len(codes), dtype=np.int64)
    for level in range(DEEPEST_LEAF):
        above = codes >> np.uint64(3 * (DEEPEST_LEAF - level))
        _, inverse = np.unique(above, return_inverse=True)
        crowded = np.bincount(inverse, weights=counts)[inverse] > MOST_IN_LEAF
        levels[crowded] = level + 1
    shifts = (3 * (DEEPEST_LEAF - levels)).astype(np.uint64)
    starts, first = np.unique((codes >> shifts) << shifts, return_index=True)
    sums = np.add.reduceat(counts, first) if len(first) else counts
    return _Leaves(levels[first], codes[first] >> shifts[first], starts, np.concatenate([[0], np.cumsum(sums)]))


def _spool(
    spool: Any, clouds: PlacedClouds, layout: LasLayout, cube: _Cube, leaves: _Leaves, progress: Progress
) -> None:
    """Write the records of each leaf to its place in a file."""
    size, descriptor = layout.dtype.itemsize, spool.fileno()
    places = leaves.offsets[:-1].copy()
    for number, cloud, piece in clouds.pieces(progress):
        records = layout.records(number, cloud, piece)
        leaf = np.searchsorted(leaves.starts, morton(cube.cells(records, DEEPEST_LEAF)), side="right") - 1
        if len(leaves.starts) < 1 << 16:
            leaf = leaf.astype(np.uint16)  # sorted by counting, in a fraction of the time
        order = np.argsort(leaf, kind="stable")
        records, leaf = records[order], leaf[order]
        ends = np.flatnonzero(np.diff(leaf)) + 1
        for start, end in pairwise([0, *ends.tolist(), len(leaf)]):
            at = leaf[start]
            _write_all(descriptor, records[start:end].tobytes(), int(places[at]) * size)
            places[at] += end - start


def _write_all(descriptor: int, data: bytes, place: int) -> None:
    written = 0
    while written < len(data):
        written += os.pwrite(descriptor, data[written:], place + written)


def _sorted_nodes(spool: Any, layout: LasLayout, cube: _Cube, leaves: _Leaves) -> Iterator[Any]:
    size, descriptor = layout.dtype.itemsize, spool.fileno()
    sorter, rng = OctreeSorter(DEEPEST_LEAF), np.random.default_rng(0)
    for at, (start, end) in enumerate(pairwise(leaves.offsets.tolist())):
        data = os.pread(descriptor, (end - start) * size, start * size)
        records = rng.permutation(np.frombuffer(data, dtype=layout.dtype))
        cells = cube.cells(records, DEEPEST_LEAF + CELL_LEVELS)
        yield from sorter.leaf(int(leaves.levels[at]), int(leaves.codes[at]), cells, records)
    yield from sorter.ends()


def _write_nodes(
    path: Path,
    spool: Any,
    clouds: PlacedClouds,
    layout: LasLayout,
    cube: _Cube,
    leaves: _Leaves,
    progress: Progress,
) -> int:
    """Compress node after node; give the bytes that the file must have at least."""
    import copclib

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
    header.points_by_return = [clouds.points, *[0] * 14]
    writer = copclib.FileWriter(str(path), config)
    end, done, total = 0, 0, max(1, clouds.points)
    for key, records in _sorted_nodes(spool, layout, cube, leaves):
        node = writer.AddNode(copclib.VoxelKey(*key), copclib.VectorChar(records.view(np.int8)))
        end = max(end, node.offset + node.byte_size)
        done += len(records)
        progress.report(done / total, "writing nodes")
    writer.Close()
    return end


def _name_extra_bytes(path: Path, layout: LasLayout, clouds: PlacedClouds) -> None:
    """Describe the extra bytes: copclib leaves room for each byte, but has no way to say what they are.

    What is left of its record becomes one of its own, with the names of the stations where they have room.
    """
    descriptors = b"".join(
        struct.pack("<2xBB32s4x120x32s", LAS_KINDS[s.kind], 0, s.name.encode(), s.description.encode()[:32])
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
