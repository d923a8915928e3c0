"""Stanford PLY: ascii and binary of both byte orders, float64 kept."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from typing import final

import numpy as np

from algorithms.arrays import Array, Colors, Floats32
from service.formats.base import ReadLimits, ScanFile, ScanRecords
from service.formats.finishing import check_count, colors_8bit
from service.formats.number_table import read_table, refuse_long_lines

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
INTENSITY_NAMES = ("intensity", "scalar_intensity", "scalar_Intensity", "reflectance", "scalar_reflectance")
COLOR_NAMES = (("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue"))
LONGEST_HEADER = 1 << 16


@dataclass(frozen=True)
class _Element:
    name: str
    count: int
    properties: tuple[tuple[str, str], ...]
    has_list: bool


@dataclass(frozen=True)
class _Header:
    encoding: str
    elements: tuple[_Element, ...]
    length: int
    lines: int


@final
@dataclass(frozen=True)
class PlyReader:
    """Read the vertices of a PLY file; faces and other elements are passed over."""

    name: str = "PLY"
    extensions: tuple[str, ...] = (".ply",)
    signed: bool = True

    def sniff(self, head: bytes) -> bool:
        """Tell whether the file begins with the PLY magic line."""
        return head.startswith((b"ply\n", b"ply\r"))

    def scans(self, file: ScanFile, limits: ReadLimits, wanted: int | None = None) -> Iterator[ScanRecords]:
        """Yield the one cloud of a file."""
        header = _read_header(file)
        skipped, vertex = _vertex_element(file, header)
        if vertex.count == 0 or wanted not in {None, 0}:
            return
        if header.encoding == "ascii":
            check_count(file, vertex.count, 2.0 * len(vertex.properties), limits, "element vertex", spare=2)
            refuse_long_lines(file)
            table = _read_ascii(file, header, skipped, vertex)
        else:
            order = BYTE_ORDERS[header.encoding]
            dtype = np.dtype([(name, order + kind) for name, kind in vertex.properties])
            check_count(file, vertex.count, dtype.itemsize, limits, "element vertex")
            offset = header.length + sum(
                element.count * sum(np.dtype(kind).itemsize for _, kind in element.properties) for element in skipped
            )
            if offset + vertex.count * dtype.itemsize > file.size:
                raise file.unreadable(
                    f"the file ends before the last of {vertex.count} vertices", f"byte {file.size}, element vertex"
                )
            table = np.memmap(file.path, dtype=dtype, mode="r", offset=offset, shape=(vertex.count,))
        points = np.empty((vertex.count, 3))
        for axis, name in enumerate("xyz"):
            points[:, axis] = table[name]
        yield ScanRecords(index=0, points=points, intensity=_intensity(table), color=_color(table, vertex))


def _read_header(file: ScanFile) -> _Header:
    with file.path.open("rb") as stream:
        head = stream.read(LONGEST_HEADER)
    end = head.find(b"end_header")
    newline = head.find(b"\n", end)
    if end < 0 or newline < 0:
        raise file.unreadable("the header does not end", f"byte {len(head)}, header")
    encoding = ""
    elements: list[_Element] = []
    lines = head[:end].decode("latin-1").splitlines()
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if not words or words[0] in {"ply", "comment", "obj_info"}:
            continue
        place = f"line {number}, header"
        if words[0] == "format" and len(words) == 3:
            encoding = words[1]
        elif words[0] == "element" and len(words) == 3 and _is_count(words[2]):
            elements.append(_Element(words[1], int(words[2]), (), has_list=False))
        elif words[0] == "property" and elements:
            elements[-1] = _with_property(file, elements[-1], words, place)
        else:
            raise file.unreadable(f"'{line.strip()[:60]}' is no PLY header line", place)
    if encoding != "ascii" and encoding not in BYTE_ORDERS:
        raise file.unreadable(f"unknown PLY format '{encoding[:40]}'", "header")
    return _Header(encoding, tuple(elements), newline + 1, head.count(b"\n", 0, newline + 1))


def _is_count(word: str) -> bool:
    return word.isascii() and word.isdigit() and len(word) < 19


def _with_property(file: ScanFile, element: _Element, words: list[str], place: str) -> _Element:
    if len(words) == 5 and words[1] == "list":
        return _Element(element.name, element.count, element.properties, has_list=True)
    if len(words) != 3 or words[1] not in TYPES:
        raise file.unreadable(f"unknown property '{' '.join(words)[:60]}'", place)
    if words[2] in dict(element.properties):
        raise file.unreadable(f"property '{words[2][:40]}' is declared twice", place)
    properties = (*element.properties, (words[2], TYPES[words[1]]))
    return _Element(element.name, element.count, properties, element.has_list)


def _vertex_element(file: ScanFile, header: _Header) -> tuple[tuple[_Element, ...], _Element]:
    position = next((i for i, element in enumerate(header.elements) if element.name == "vertex"), None)
    if position is None:
        raise file.unreadable("the file has no element 'vertex'", "header")
    vertex = header.elements[position]
    if not {"x", "y", "z"} <= dict(vertex.properties).keys():
        raise file.unreadable("the vertices have no x, y and z", "header, element vertex")
    if vertex.has_list:
        raise file.unreadable("vertices with lists are not supported", "header, element vertex")
    skipped = header.elements[:position]
    if header.encoding != "ascii" and any(element.has_list for element in skipped):
        raise file.unreadable("lists before the vertices are not supported", "header")
    return skipped, vertex


def _read_ascii(file: ScanFile, header: _Header, skipped: tuple[_Element, ...], vertex: _Element) -> Array:
    before = sum(element.count for element in skipped)
    if before > file.size:  # every line has a byte
        raise file.unreadable(f"{before} lines before the vertices do not fit the file", "header")
    first = header.lines + before
    # structured, so that a line with a property too few or too many is refused
    dtype = [(name, "f8") for name, _ in vertex.properties]
    with file.path.open("rb") as stream:
        table = read_table(file, islice(stream, first, first + vertex.count), first + 1, dtype=dtype)
    if len(table) != vertex.count:
        raise file.unreadable(
            f"the file ends after {len(table)} of {vertex.count} vertices", f"line {first + len(table)}"
        )
    return table


def _intensity(table: Array) -> Floats32 | None:
    names = table.dtype.names or ()
    return next((np.asarray(table[name], dtype=np.float32) for name in INTENSITY_NAMES if name in names), None)


def _color(table: Array, vertex: _Element) -> Colors | None:
    kinds = dict(vertex.properties)
    channels = next((three for three in COLOR_NAMES if set(three) <= kinds.keys()), None)
    if channels is None:
        return None
    values = np.column_stack([table[name] for name in channels])
    largest = float(np.nan_to_num(values).max())
    if kinds[channels[0]].startswith("f"):
        return colors_8bit(values, 1.0 if largest <= 1.0 else 255.0)
    return colors_8bit(values, 255.0 if largest <= 255.0 else 65535.0)
