"""Stanford PLY: ascii and binary of both byte orders, float64 kept."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from typing import final

import numpy as np

from algorithms.arrays import Array, Colors, Floats32
from service.formats.base import RECORDS_AT_ONCE, ReadLimits, ScanFile, ScanRecords
from service.formats.finishing import check_count, colors_8bit
from service.formats.number_table import read_table, refuse_long_lines
from service.formats.ply_lists import Property, RecordsEndError, plain, read_records, without_lists
from service.formats.units import DeclaredUnit, UnknownUnit, not_understood, unit_in_comments, way_out

TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
BYTE_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
INTENSITY_NAMES = ("intensity", "scalar_intensity", "reflectance", "scalar_reflectance")
COLOR_NAMES = (("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue"))
LONGEST_HEADER = 1 << 16
MOST_COMMENTS = 200


@dataclass(frozen=True)
class _Element:
    name: str
    count: int
    properties: tuple[Property, ...]

    @property
    def has_list(self) -> bool:
        """Tell whether records differ in length."""
        return any(counted is not None for _, _, counted in self.properties)


@dataclass(frozen=True)
class _Header:
    encoding: str
    elements: tuple[_Element, ...]
    length: int
    lines: int
    comments: tuple[str, ...]


@final
@dataclass(frozen=True)
class PlyReader:
    """Read the vertices of a PLY file; faces, other elements and lists are passed over."""

    name: str = "PLY"
    extensions: tuple[str, ...] = (".ply",)
    signed: bool = True

    def sniff(self, head: bytes) -> bool:
        """Tell whether the file begins with the PLY magic line."""
        return head.startswith((b"ply\n", b"ply\r"))

    def complaint(self, head: bytes) -> str:  # noqa: ARG002 - a signature tells no more
        """Say no more than that the signature is missing."""
        return ""

    def scans(self, file: ScanFile, limits: ReadLimits, wanted: int | None = None) -> Iterator[ScanRecords]:
        """Yield the one cloud of a file."""
        if wanted not in {None, 0} or (opened := _opened(file, limits)) is None:
            return
        yield opened.records(slice(None))

    def pieces(self, file: ScanFile, limits: ReadLimits, index: int) -> Iterator[ScanRecords]:
        """Yield the one cloud of a file piece by piece; only that of a text, or with lists, is read as a whole."""
        opened = _opened(file, limits) if index == 0 else None
        if opened is None:
            return
        for start in range(0, opened.vertex.count, RECORDS_AT_ONCE):
            yield opened.records(slice(start, start + RECORDS_AT_ONCE))


@dataclass(frozen=True, eq=False)
class _Opened:
    """The table of the vertices, as a rule a view into the file."""

    table: Array
    vertex: _Element
    unit: DeclaredUnit | None
    warnings: tuple[str, ...]

    def records(self, part: slice) -> ScanRecords:
        """Give some of the records."""
        names, table = _names(self.vertex), self.table[part]
        points = np.empty((len(table), 3))
        for axis, name in enumerate("xyz"):
            points[:, axis] = table[names[name]]
        return ScanRecords(
            index=0,
            points=points,
            intensity=_intensity(table, names),
            color=_color(table, self.vertex, self._largest_color),
            unit=self.unit,
            warnings=self.warnings,
        )

    @cached_property
    def _largest_color(self) -> float:
        """The largest number that a channel has anywhere, of which its scale is told."""
        channels = _channels(self.vertex)
        if channels is None or self.table.dtype[channels[0]] == np.uint8:
            return 255.0
        return max(float(np.nan_to_num(self.table[name]).max(initial=0.0)) for name in channels)


def _opened(file: ScanFile, limits: ReadLimits) -> _Opened | None:
    """Look at the header and give the vertices; None without any."""
    header = _read_header(file)
    skipped, vertex = _vertex_element(file, header)
    if vertex.count == 0:
        return None
    if header.encoding == "ascii":
        check_count(file, vertex.count, 2.0 * len(vertex.properties), limits, "element vertex", spare=2)
        refuse_long_lines(file)
        table = _read_ascii(file, header, skipped, vertex)
    else:
        check_count(file, vertex.count, float(_smallest_bytes(vertex)), limits, "element vertex")
        table = _read_binary(file, header, skipped, vertex)
    return _Opened(table, vertex, *_unit(file, header))


def _unit(file: ScanFile, header: _Header) -> tuple[DeclaredUnit | None, tuple[str, ...]]:
    found = unit_in_comments(header.comments)
    if not isinstance(found, UnknownUnit):
        return found, ()
    if found.is_angle:
        raise file.unreadable(f"according to {found.source} {way_out(found)}", "header")
    return None, (not_understood(found),)


def _names(vertex: _Element) -> dict[str, str]:
    """Give the properties by their names in small letters; one that is written so comes before others."""
    names = [name for name, _ in plain(vertex.properties)]
    return {name.lower(): name for name in reversed(names)} | {name: name for name in names if name.islower()}


def _smallest_bytes(element: _Element) -> int:
    return sum(np.dtype(counted or kind).itemsize for _, kind, counted in element.properties)


def _read_header(file: ScanFile) -> _Header:
    with file.path.open("rb") as stream:
        head = stream.read(LONGEST_HEADER)
    end = head.find(b"end_header")
    newline = head.find(b"\n", end)
    if end < 0 or newline < 0:
        raise file.unreadable("the header does not end", f"byte {len(head)}, header")
    encoding = ""
    elements: list[_Element] = []
    comments: list[str] = []
    lines = head[:end].decode("latin-1").splitlines()
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if words and words[0] in {"comment", "obj_info"}:
            comments.append(line.strip().partition(" ")[2])
        if not words or words[0] in {"ply", "comment", "obj_info"}:
            continue
        place = f"line {number}, header"
        if words[0] == "format" and len(words) == 3:
            encoding = words[1]
        elif words[0] == "element" and len(words) == 3 and _is_count(words[2]):
            elements.append(_Element(words[1], int(words[2]), ()))
        elif words[0] == "property" and elements:
            elements[-1] = _with_property(file, elements[-1], words, place)
        else:
            raise file.unreadable(f"'{line.strip()[:60]}' is no PLY header line", place)
    if encoding != "ascii" and encoding not in BYTE_ORDERS:
        raise file.unreadable(f"unknown PLY format '{encoding[:40]}'", "header")
    return _Header(
        encoding, tuple(elements), newline + 1, head.count(b"\n", 0, newline + 1), tuple(comments[:MOST_COMMENTS])
    )


def _is_count(word: str) -> bool:
    return word.isascii() and word.isdigit() and len(word) < 19


def _with_property(file: ScanFile, element: _Element, words: list[str], place: str) -> _Element:
    counted = None
    if len(words) == 5 and words[1] == "list" and TYPES.get(words[2], "f").startswith(("i", "u")):
        counted, words = TYPES[words[2]], [words[0], words[3], words[4]]
    if len(words) != 3 or words[1] not in TYPES:
        raise file.unreadable(f"unknown property '{' '.join(words)[:60]}'", place)
    if words[2] in {name for name, _, _ in element.properties}:
        raise file.unreadable(f"property '{words[2][:40]}' is declared twice", place)
    return _Element(element.name, element.count, (*element.properties, (words[2], TYPES[words[1]], counted)))


def _vertex_element(file: ScanFile, header: _Header) -> tuple[tuple[_Element, ...], _Element]:
    position = next((i for i, element in enumerate(header.elements) if element.name.lower() == "vertex"), None)
    if position is None:
        raise file.unreadable("the file has no element 'vertex'", "header")
    vertex = header.elements[position]
    if not {"x", "y", "z"} <= _names(vertex).keys():
        raise file.unreadable("the vertices have no x, y and z", "header, element vertex")
    return header.elements[:position], vertex


def _read_binary(file: ScanFile, header: _Header, skipped: tuple[_Element, ...], vertex: _Element) -> Array:
    order = BYTE_ORDERS[header.encoding]
    if not any(element.has_list for element in (*skipped, vertex)):
        dtype = np.dtype([(name, order + kind) for name, kind in plain(vertex.properties)])
        offset = header.length + sum(element.count * _smallest_bytes(element) for element in skipped)
        if offset + vertex.count * dtype.itemsize > file.size:
            raise file.unreadable(
                f"the file ends before the last of {vertex.count} vertices", f"byte {file.size}, element vertex"
            )
        return np.memmap(file.path, dtype=dtype, mode="r", offset=offset, shape=(vertex.count,))
    data, at = np.memmap(file.path, dtype=np.uint8, mode="r"), header.length
    for element in (*skipped, vertex):
        if element.count * _smallest_bytes(element) > file.size:
            raise file.unreadable(f"{element.count} records do not fit the file", f"element {element.name[:40]}")
        try:
            table, at = read_records(data, at, element.count, element.properties, order)
        except RecordsEndError as fault:
            raise file.unreadable(
                f"the file ends before the last of {element.count} records, or a list in it is damaged",
                f"{fault}, element {element.name[:40]}",
            ) from fault
    return table


def _read_ascii(file: ScanFile, header: _Header, skipped: tuple[_Element, ...], vertex: _Element) -> Array:
    before = sum(element.count for element in skipped)
    if before > file.size:  # every line has a byte
        raise file.unreadable(f"{before} lines before the vertices do not fit the file", "header")
    first = header.lines + before
    # structured, so that a line with a property too few or too many is refused
    dtype = [(name, "f8") for name, _ in plain(vertex.properties)]
    with file.path.open("rb") as stream:
        lines: Iterator[bytes] = islice(stream, first, first + vertex.count)
        if vertex.has_list:
            lines = without_lists(lines, vertex.properties)
        table = read_table(file, lines, first + 1, dtype=dtype)
    if len(table) != vertex.count:
        raise file.unreadable(
            f"the file ends after {len(table)} of {vertex.count} vertices", f"line {first + len(table)}"
        )
    return table


def _intensity(table: Array, names: Mapping[str, str]) -> Floats32 | None:
    return next((np.asarray(table[names[name]], dtype=np.float32) for name in INTENSITY_NAMES if name in names), None)


def _channels(vertex: _Element) -> list[str] | None:
    """Give the properties that are red, green and blue."""
    names = _names(vertex)
    channels = next((three for three in COLOR_NAMES if set(three) <= names.keys()), None)
    return None if channels is None else [names[name] for name in channels]


def _color(table: Array, vertex: _Element, largest: float) -> Colors | None:
    kinds, channels = dict(plain(vertex.properties)), _channels(vertex)
    if channels is None:
        return None
    values = np.column_stack([table[name] for name in channels])
    if kinds[channels[0]].startswith("f"):
        return colors_8bit(values, 1.0 if largest <= 1.0 else 255.0)
    return colors_8bit(values, 255.0 if largest <= 255.0 else 65535.0)
