"""ASPRS LAS, LAZ and COPC through laspy and lazrs."""

import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np

from algorithms.arrays import Array, Flags
from algorithms.scans.scan import ScalarField
from service.formats.base import LargeScan, ReadLimits, ScanFile, ScanRecords
from service.formats.finishing import check_count, check_packing, colors_8bit, times_of
from service.formats.instruments import Instrument, day_of, stated_instrument, system_of_las
from service.formats.intensities import LARGEST_16_BIT
from service.formats.las_attributes import attributes_of, lost_attributes
from service.formats.las_units import las_crs, las_unit
from service.formats.laz_chunks import check_chunk_table, check_compression
from service.formats.units import DeclaredUnit, UnknownUnit, can_be_degrees, no_degrees, not_understood, way_out

POINTS_AT_ONCE = 1_000_000
LASZIP_RECORD = 22204
LAZ_BIT = 0x80
"""Set in the point format of a compressed file."""


@final
@dataclass(frozen=True)
class LasReader:
    """Read LAS 1.0–1.4. LAS knows no scanner frame, so the scan has neither sensor nor pose."""

    name: str = "LAS"
    extensions: tuple[str, ...] = (".las", ".laz")
    signed: bool = True

    def sniff(self, head: bytes) -> bool:
        """Tell whether the file carries the LAS signature."""
        return head.startswith(b"LASF")

    def complaint(self, head: bytes) -> str:  # noqa: ARG002 - a signature tells no more
        """Say no more than that the signature is missing."""
        return ""

    def scans(self, file: ScanFile, limits: ReadLimits, wanted: int | None = None) -> Iterator[ScanRecords | LargeScan]:
        """Yield the one cloud of a file."""
        if wanted not in {None, 0}:
            return
        opened, cloud = OpenedLas(file, limits), None
        for chunk in opened.chunks():
            if opened.count > limits.at_once:
                yield LargeScan(0, opened.count)
                return
            cloud = _Cloud(chunk, opened.count, file) if cloud is None else cloud
            cloud.take(chunk, opened)
        if cloud is not None:
            records = replace(cloud.records(opened.offsets), instrument=opened.instrument, **opened.told)
            yield _with_unit(file, records, opened.unit)

    def pieces(self, file: ScanFile, limits: ReadLimits, index: int) -> Iterator[ScanRecords]:
        """Yield the one cloud of a file piece by piece."""
        opened, largest = OpenedLas(file, limits), 0.0
        for chunk in opened.chunks() if index == 0 else ():
            cloud = _Cloud(chunk, len(chunk), file)
            cloud.take(chunk, opened)
            if not largest and cloud.channels is not None and cloud.channels.any():
                largest = _largest_color(cloud.channels)  # of the first points that are not black
            color = None if cloud.channels is None else colors_8bit(cloud.channels, largest or 255.0)
            # a later piece may have points that are left out
            valid = np.ones(len(chunk), dtype=np.bool_) if cloud.valid is None else cloud.valid
            records = ScanRecords(
                0, cloud.points, base_m=opened.offsets, valid=valid, left_out=cloud.left_out,
                intensity=cloud.intensity, intensity_scale=LARGEST_16_BIT, color=color, gps_time_s=cloud.span_s,
                instrument=opened.instrument,
                point_sources=frozenset(cloud.point_sources), attributes=cloud.attributes, **opened.told,
            )  # fmt: skip
            yield _with_unit(file, records, opened.unit)


class OpenedLas:
    """A file whose header is checked when the first points are asked for."""

    def __init__(self, file: ScanFile, limits: ReadLimits) -> None:
        self._file, self._limits = file, limits
        self.header: Any = None
        self.count = 0
        self.scales, self.offsets = np.ones(3), np.zeros(3)
        self.unit: DeclaredUnit | UnknownUnit | None = None
        self.instrument: Instrument | None = None
        self.told: dict[str, Any] = {}
        """Coordinate reference system, and what of the points is not read, for `ScanRecords`."""

    def chunks(self) -> Iterator[Any]:
        """Read the points some at a time, as laspy gives them.

        Raises
        ------
        UnreadableFileError
            The file is damaged.
        """
        import laspy

        file = self._file
        _check_header(file)
        place = "header"
        try:
            # no extended records: they trust counts that may be damaged
            with laspy.open(file.path, laz_backend=laspy.LazBackend.Lazrs, read_evlrs=False) as reader:
                if self._look_at(reader.header):
                    reader.laz_backend = laspy.LazBackend.LazrsParallel
                found = 0
                for chunk in reader.chunk_iterator(POINTS_AT_ONCE) if self.count else ():
                    found += len(chunk)
                    place = f"point {found}"
                    yield chunk
        except BaseException as fault:
            if not _is_damage(fault):
                raise
            raise file.unreadable(f"damaged LAS: {fault}", place) from fault
        if found != self.count:
            raise file.unreadable(f"the points end after {found} of {self.count}", f"point {found}")

    def _look_at(self, header: Any) -> bool:
        """Take note of a header; tell whether its points can be decompressed by several threads."""
        file, self.count, self.header = self._file, int(header.point_count), header
        if self.count == 0:
            return False
        self.scales, self.offsets = np.array(header.scales, dtype=float), np.array(header.offsets, dtype=float)
        finite = np.isfinite(self.scales).all() and np.isfinite(self.offsets).all()
        if not (finite and (self.scales != 0).all()):
            raise file.unreadable("scale or offset is zero or not finite", "header")
        parallel = False
        if header.are_points_compressed:
            where, record_bytes = header.offset_to_point_data, header.point_format.size
            parallel = check_compression(file, where, record_bytes, self.count, _laszip_record(file, header))
        smallest = 0.0 if header.are_points_compressed else float(header.point_format.size)
        check_count(file, self.count, smallest, self._limits, "header")
        check_packing(file, self.count, "header")
        self.unit = las_unit(file, header.vlrs)
        crs_wkt, why_none = las_crs(file, header.vlrs)
        lost = [f"not read: {each}" for each in lost_attributes(header)] if file.attributes else []
        self.told = {"crs_wkt": crs_wkt, "lost": (*lost, *([why_none] if why_none else []))}
        stated = Instrument(model=system_of_las(header.system_identifier), file_date=day_of(header.creation_date))
        self.instrument = stated_instrument(stated)
        return parallel


def _with_unit(file: ScanFile, records: ScanRecords, unit: DeclaredUnit | UnknownUnit | None) -> ScanRecords:
    """Add what the file says of its unit; a definition that nobody understands says nothing.

    Raises
    ------
    UnreadableFileError
        The coordinates are angles.
    """
    if not isinstance(unit, UnknownUnit):
        return replace(records, unit=unit)
    if not unit.is_angle:
        return replace(records, warnings=(not_understood(unit),))
    low, high = (np.asarray(side(records.points, axis=0)) + records.base_m for side in (np.min, np.max))
    if can_be_degrees(low, high):
        raise file.unreadable(f"according to {unit.source} {way_out(unit)}", "header")
    return replace(records, open_unit=no_degrees(unit, low, high))


class _Cloud:
    """The arrays of a cloud, filled chunk by chunk."""

    def __init__(self, chunk: Any, count: int, file: ScanFile) -> None:
        names = set(chunk.point_format.dimension_names)
        self.points = np.empty((count, 3))
        """As stored, scaled: the offset is added once, in float64, after the origin is known."""
        self.intensity = np.empty(count, dtype=np.float32)
        self.channels = np.empty((count, 3), dtype=np.uint16) if "red" in names else None
        self.valid: Flags | None = None
        self.left_out: Counter[str] = Counter()
        self.attributes: dict[ScalarField, Array] = {}
        self.point_sources: set[int] = set()
        self._file = file
        self._times = np.empty(count) if "gps_time" in names else None
        self._filled = 0

    def take(self, chunk: Any, opened: OpenedLas) -> None:
        """Copy the next points."""
        part = slice(self._filled, self._filled + len(chunk))
        for axis, name in enumerate("XYZ"):
            np.multiply(chunk[name], opened.scales[axis], out=self.points[part, axis])
        self.intensity[part] = chunk["intensity"]
        if self.channels is not None:
            for channel, name in enumerate(("red", "green", "blue")):
                self.channels[part, channel] = chunk[name]
        if self._times is not None:
            self._times[part] = chunk["gps_time"]
        for each, values in attributes_of(chunk, opened.header) if self._file.attributes else ():
            if each not in self.attributes:
                self.attributes[each] = np.full(len(self.points), each.absent, each.kind)
            self.attributes[each][part] = values
        chosen = self._file.selection.chosen(chunk, self.left_out)
        if chosen is not None:
            if self.valid is None:
                self.valid = np.ones(len(self.points), dtype=np.bool_)
            self.valid[part] = chosen
        sources = np.asarray(chunk["point_source_id"])
        counts = np.bincount(sources if chosen is None else sources[chosen], minlength=1)
        self.point_sources.update(np.flatnonzero(counts).tolist())
        self._filled = part.stop

    @property
    def span_s(self) -> tuple[float, float] | None:
        """Least and largest time; None: there are none, or not all are finite."""
        if self._times is None:
            return None
        low, high = float(self._times.min()), float(self._times.max())
        return (low, high) if np.isfinite([low, high]).all() else None

    def records(self, offsets: Array) -> ScanRecords:
        """Give what was copied."""
        channels, times = self.channels, self._times
        coloured = channels is not None and channels.any()
        return ScanRecords(
            index=0,
            points=self.points,
            base_m=offsets,
            valid=self.valid,
            left_out=self.left_out,
            attributes=self.attributes,
            point_sources=frozenset(self.point_sources),
            intensity=self.intensity,
            intensity_scale=LARGEST_16_BIT,
            color=colors_8bit(channels, _largest_color(channels)) if coloured and channels is not None else None,
            gps_time_s=self.span_s,
            times_s=None if times is None else times_of(times),
        )


def _laszip_record(file: ScanFile, header: Any) -> bytes:
    """Give the content of the record that says how the points are compressed."""
    for record in header.vlrs:
        if record.record_id == LASZIP_RECORD:
            return bytes(record.record_data)
    raise file.unreadable("the points are compressed, but the LASzip record is missing", "header")


def _check_header(file: ScanFile) -> None:
    """Refuse header fields that would send the library far beyond the end of the file (LAS 1.4 R15, table 3)."""
    with file.path.open("rb") as stream:
        head = stream.read(227)
    if len(head) < 227:
        raise file.unreadable("the header is cut off", f"byte {len(head)}, header")
    header_bytes, data_offset, records = struct.unpack_from("<HII", head, 94)
    if not 227 <= header_bytes <= data_offset <= file.size:
        raise file.unreadable(
            f"header of {header_bytes} bytes and points from byte {data_offset} do not fit a file of {file.size} bytes",
            "byte 94, header",
        )
    if records * 54 > data_offset - header_bytes:
        raise file.unreadable(f"{records} variable-length records do not fit before the points", "byte 100, header")
    if head[104] & LAZ_BIT:
        check_chunk_table(file, data_offset)


def _is_damage(fault: BaseException) -> bool:
    """Tell what laspy and lazrs raise where a file is not as it should be."""
    import laspy

    # lazrs' own error is a RuntimeError; where it checks nothing it panics, which is no exception like others
    kinds = (
        laspy.LaspyException,
        struct.error,
        RuntimeError,
        ValueError,
        LookupError,
        TypeError,
        ArithmeticError,
        OSError,
    )
    return isinstance(fault, (*kinds, MemoryError)) or type(fault).__name__ == "PanicException"


def _largest_color(channels: Array) -> float:
    """Tell the largest number of a channel: the standard wants 16 bits, many writers store 8."""
    return 65535.0 if channels.max() > 255 else 255.0
