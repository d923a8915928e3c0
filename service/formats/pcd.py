"""Point Cloud Library PCD 0.5–0.7: ascii, binary and binary_compressed, fields of any count (padding too)."""

import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import final

import numpy as np

from algorithms.arrays import Array, Colors, Vector3
from service.formats.base import RECORDS_AT_ONCE, ReadLimits, ScanFile, ScanRecords
from service.formats.finishing import check_count, check_packing
from service.formats.number_table import read_table, refuse_long_lines
from service.formats.units import DeclaredUnit, UnknownUnit, not_understood, unit_in_comments, way_out

KINDS = {("F", 4): "<f4", ("F", 8): "<f8"} | {(t, s): f"<{t.lower()}{s}" for t in "IU" for s in (1, 2, 4, 8)}
ENTRIES = ("VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA")
INTENSITY_NAMES = ("intensity", "reflectance", "reflectivity")
LONGEST_HEADER = 1 << 16
MOST_COMMENTS = 200
LARGEST_LZF_GAIN = 100
"""LZF writes at most 264 bytes for 3, so its output is less than 100 times its input."""
FREE_BYTES, LARGEST_GAIN = 64_000_000, 20
"""Nine of ten cells of a grid without a return are packed ten to one; a little may be packed as it likes."""


@dataclass(frozen=True)
class _Header:
    dtype: np.dtype[np.void]
    width: int
    height: int
    points: int
    sensor_m: Vector3 | None
    encoding: str
    length: int
    lines: int
    comments: tuple[str, ...]


@final
@dataclass(frozen=True)
class PcdReader:
    """Read PCD. An organised cloud (HEIGHT > 1) gives a grid; NaN coordinates are its missing returns."""

    name: str = "PCD"
    extensions: tuple[str, ...] = (".pcd",)
    signed: bool = True

    def sniff(self, head: bytes) -> bool:
        """Tell whether the first entry, after comments, is one of PCD's."""
        for line in head[:4096].splitlines():
            if line.strip() and not line.startswith(b"#"):
                return line.split()[0] in {b"VERSION", b"FIELDS", b"COLUMNS"}
        return head.startswith(b"# .PCD")

    def complaint(self, head: bytes) -> str:  # noqa: ARG002 - a signature tells no more
        """Say no more than that the signature is missing."""
        return ""

    def scans(self, file: ScanFile, limits: ReadLimits, wanted: int | None = None) -> Iterator[ScanRecords]:
        """Yield the one cloud of a file."""
        header = _read_header(file)
        if header.points and wanted in {None, 0}:
            yield _records(header, _read_table(file, header, limits), 0, *_unit(file, header))

    def pieces(self, file: ScanFile, limits: ReadLimits, index: int) -> Iterator[ScanRecords]:
        """Yield the one cloud of a file piece by piece; only that of a text, or compressed, is read as a whole."""
        header = _read_header(file)
        if index or not header.points:
            return
        table, said = _read_table(file, header, limits), _unit(file, header)
        for start in range(0, header.points, RECORDS_AT_ONCE):
            yield _records(header, table[start : start + RECORDS_AT_ONCE], start, *said)


def _records(
    header: _Header, table: Array, first: int, unit: DeclaredUnit | None, warnings: tuple[str, ...]
) -> ScanRecords:
    """Give some of the records, from record number `first` on."""
    points = np.empty((len(table), 3))
    names = _small(table.dtype.names or ())
    for axis, name in enumerate("xyz"):
        points[:, axis] = table[names[name]]
    row = column = None
    if header.height > 1 and header.width * header.height == header.points:
        number = np.arange(first, first + len(table))
        row, column = number // header.width, number % header.width
    return ScanRecords(
        index=0,
        points=points,
        row=row,
        column=column,
        intensity=next((np.asarray(table[names[n]], dtype=np.float32) for n in INTENSITY_NAMES if n in names), None),
        color=_color(table, names),
        sensor_in_scan_m=header.sensor_m,
        unit=unit,
        warnings=warnings,
    )


def _small(names: Sequence[str]) -> dict[str, str]:
    """Give fields by their names in small letters; one that is written so comes before others."""
    return {name.lower(): name for name in reversed(names)} | {name: name for name in names if name.islower()}


def _unit(file: ScanFile, header: _Header) -> tuple[DeclaredUnit | None, tuple[str, ...]]:
    found = unit_in_comments(header.comments)
    if not isinstance(found, UnknownUnit):
        return found, ()
    if found.is_angle:
        raise file.unreadable(f"according to {found.source} {way_out(found)}", "header")
    return None, (not_understood(found),)


def _read_header(file: ScanFile) -> _Header:
    with file.path.open("rb") as stream:
        head = stream.read(LONGEST_HEADER)
    entries: dict[str, list[str]] = {}
    comments: list[str] = []
    length = lines = 0
    while "DATA" not in entries:
        newline = head.find(b"\n", length)
        if newline < 0:
            raise file.unreadable("the header does not end with a DATA line", f"line {lines + 1}, header")
        words = head[length:newline].decode("latin-1").split()
        length, lines = newline + 1, lines + 1
        if not words or words[0].startswith("#"):
            comments.append(" ".join(words).lstrip("# "))
            continue
        keyword = "FIELDS" if words[0] == "COLUMNS" else words[0]
        if keyword not in ENTRIES:
            raise file.unreadable(f"'{words[0][:40]}' is no entry of a PCD header", f"line {lines}, header")
        entries[keyword] = words[1:]
    try:
        return _understood(entries, length, lines, tuple(comments[:MOST_COMMENTS]))
    except (ValueError, KeyError, IndexError, OverflowError, TypeError) as fault:
        raise file.unreadable(f"the header contradicts itself or lacks an entry: {fault}", "header") from fault


def _understood(entries: dict[str, list[str]], length: int, lines: int, comments: tuple[str, ...]) -> _Header:
    names = entries["FIELDS"]
    sizes = [int(word) for word in entries["SIZE"]]
    counts = [int(word) for word in entries.get("COUNT", ["1"] * len(names))]
    if not {"x", "y", "z"} <= _small(names).keys():
        raise ValueError(f"no fields x, y and z among {' '.join(names)[:60]}")
    if any(count < 1 or count > 65536 for count in counts):
        raise ValueError("a COUNT is out of range")
    columns: list[tuple[str, str, tuple[int, ...]]] = []
    for i, (name, size, kind, count) in enumerate(zip(names, sizes, entries["TYPE"], counts, strict=True)):
        # padding fields are all called '_'; a record type needs them apart
        unique = name if name != "_" and name not in names[:i] else f"_{i}"
        if name.lower() in {"x", "y", "z"} and count != 1:
            raise ValueError(f"field {name} has COUNT {count}")
        columns.append((unique, KINDS[kind.upper(), size], () if count == 1 else (count,)))
    width, height = int(entries["WIDTH"][0]), int(entries.get("HEIGHT", ["1"])[0])
    points = int(entries["POINTS"][0]) if "POINTS" in entries else width * height
    if min(width, height, points) < 0 or points != width * height:
        raise ValueError(f"WIDTH {width}, HEIGHT {height} and POINTS {points} do not agree")
    return _Header(
        dtype=np.dtype(columns),
        width=width,
        height=height,
        points=points,
        sensor_m=_sensor(entries.get("VIEWPOINT")),
        encoding=entries["DATA"][0],
        length=length,
        lines=lines,
        comments=comments,
    )


def _sensor(viewpoint: list[str] | None) -> Vector3 | None:
    """Take the instrument's position from VIEWPOINT.

    PCL defines it as the acquisition pose *in the coordinates of the points* (`sensor_origin_`), so it is a position
    among them and no transform to another frame. The default `0 0 0 1 0 0 0` is written by everyone and says nothing.
    """
    if viewpoint is None:
        return None
    values = np.array([float(word) for word in viewpoint])
    if values.shape != (7,) or not np.isfinite(values).all():
        raise ValueError("VIEWPOINT is not seven numbers")
    return None if np.array_equal(values, [0, 0, 0, 1, 0, 0, 0]) else values[:3]


def _read_table(file: ScanFile, header: _Header, limits: ReadLimits) -> Array:
    record = header.dtype.itemsize
    if header.encoding == "ascii":
        smallest = 2.0 * sum(int(np.prod(header.dtype[n].shape)) for n in header.dtype.names or ())
        check_count(file, header.points, smallest, limits, "header", spare=2)
        refuse_long_lines(file)
        return _read_ascii(file, header)
    if header.encoding == "binary":
        check_count(file, header.points, record, limits, "header")
        if header.length + header.points * record > file.size:
            raise file.unreadable(
                f"the file ends after {(file.size - header.length) // record} of {header.points} points",
                f"byte {file.size}",
            )
        return np.memmap(file.path, dtype=header.dtype, mode="r", offset=header.length, shape=(header.points,))
    if header.encoding == "binary_compressed":
        check_count(file, header.points, record / LARGEST_LZF_GAIN, limits, "header")
        check_packing(file, header.points, "header")
        if header.points * record > FREE_BYTES + LARGEST_GAIN * file.size:
            raise file.unreadable(f"{file.size} bytes that unpack to {header.points * record} are no scan", "header")
        return _read_compressed(file, header)
    raise file.unreadable(f"unknown DATA '{header.encoding[:40]}'", f"line {header.lines}, header")


def _read_ascii(file: ScanFile, header: _Header) -> Array:
    wide = [(n, "f8", header.dtype[n].shape) for n in header.dtype.names or ()]
    # packed colours are integers or floats by bit pattern: keep the declared type for them
    wide = [(n, header.dtype[n].str, s) if n.lower() in {"rgb", "rgba"} else (n, t, s) for n, t, s in wide]
    with file.path.open("rb") as stream:
        lines = islice(stream, header.lines, header.lines + header.points)
        table = read_table(file, lines, header.lines + 1, dtype=wide)
    if len(table) != header.points:
        raise file.unreadable(
            f"the file ends after {len(table)} of {header.points} points", f"line {header.lines + len(table)}"
        )
    return table


def _read_compressed(file: ScanFile, header: _Header) -> Array:
    with file.path.open("rb") as stream:
        stream.seek(header.length)
        sizes = stream.read(8)
        place = f"byte {header.length}"
        if len(sizes) < 8:
            raise file.unreadable("the sizes of the compressed block are missing", place)
        packed_bytes, plain_bytes = struct.unpack("<II", sizes)
        expected = header.points * header.dtype.itemsize
        if plain_bytes != expected:
            raise file.unreadable(f"the block unpacks to {plain_bytes} bytes, the header needs {expected}", place)
        packed = stream.read(packed_bytes)
    if len(packed) < packed_bytes:
        raise file.unreadable(f"the compressed block ends after {len(packed)} of {packed_bytes} bytes", place)
    try:
        plain = lzf_unpacked(packed, plain_bytes)
    except ValueError as fault:
        raise file.unreadable(f"damaged compressed block: {fault}", place) from fault
    # field after field, not point after point
    table = np.empty(header.points, dtype=header.dtype)
    start = 0
    for name in header.dtype.names or ():
        field = header.dtype[name]
        stop = start + field.itemsize * header.points
        values = np.frombuffer(plain, dtype=field.base, count=-1, offset=start)[: (stop - start) // field.base.itemsize]
        table[name] = values.reshape((header.points, *field.shape))
        start = stop
    return table


def lzf_unpacked(packed: bytes, length: int) -> bytes:
    """Unpack an LZF block (LibLZF's format: literal runs up to 32 bytes, back references up to 264 bytes, 8 kB away).

    Parameters
    ----------
    length
        Bytes the block must give.

    Raises
    ------
    ValueError
        The block is cut off, refers to before its start, or gives another length.
    """
    plain = bytearray()
    at, end = 0, len(packed)
    try:
        while at < end:
            control = packed[at]
            at += 1
            if control < 32:
                plain += packed[at : at + control + 1]
                at += control + 1
                continue
            run = control >> 5
            if run == 7:
                run += packed[at]
                at += 1
            back = ((control & 31) << 8 | packed[at]) + 1
            at += 1
            run += 2
            start = len(plain) - back
            if start < 0:
                raise ValueError("a reference points before the start")
            if back >= run:
                plain += plain[start : start + run]
            else:
                plain += (plain[start:] * (run // back + 1))[:run]
            if len(plain) > length:
                break
    except IndexError as fault:
        raise ValueError("it ends within an instruction") from fault
    if at != end or len(plain) != length:
        raise ValueError(f"it gives {len(plain)} bytes instead of {length}")
    return bytes(plain)


def _color(table: Array, names: Mapping[str, str]) -> Colors | None:
    """Unpack PCL's colours: 0x00RRGGBB in a float's bit pattern or an integer."""
    name = next((names[n] for n in ("rgb", "rgba") if n in names), None)
    if name is None or table.dtype[name].itemsize != 4 or table.dtype[name].shape:
        return None
    bits = np.ascontiguousarray(table[name]).view(np.uint32)
    return np.stack([bits >> 16 & 255, bits >> 8 & 255, bits & 255], axis=1).astype(np.uint8)
