"""Tables of points in text: XYZ, PTS and CSV, with or without column names, any usual delimiter."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from typing import final

import numpy as np

from service.errors import FileTooLargeError
from service.formats.base import ReadLimits, ScanFile, ScanRecords
from service.formats.finishing import check_count, colors_8bit
from service.formats.number_table import read_table, refuse_long_lines

HEAD_BYTES = 1 << 16
BYTE_ORDER_MARK = b"\xef\xbb\xbf"
COMMENTS = ("#", "//", "%", "!")
ROLES = {
    **dict.fromkeys(("x", "easting", "east", "e"), "x"),
    **dict.fromkeys(("y", "northing", "north", "n"), "y"),
    **dict.fromkeys(("z", "height", "elevation", "h"), "z"),
    **dict.fromkeys(("intensity", "i", "reflectance", "scalar_intensity", "amplitude"), "intensity"),
    **dict.fromkeys(("r", "red"), "red"),
    **dict.fromkeys(("g", "green"), "green"),
    **dict.fromkeys(("b", "blue"), "blue"),
}
COLOR = ("red", "green", "blue")
SHORTEST_LINE = len("0 0 0\n")


@dataclass(frozen=True)
class _Layout:
    skipped_lines: int
    delimiter: str | None
    declared_points: int | None
    columns: dict[str, int] = field(default_factory=dict)
    """Role -> column."""
    width: int = 0
    pick: bool = False
    """Whether only the columns with a role are read: others may hold words."""


class _LayoutError(Exception):
    def __init__(self, reason: str, line: int) -> None:
        self.line = line
        super().__init__(reason)


@final
@dataclass(frozen=True)
class TextReader:
    """Read text tables. They know no scanner frame, so the scan has neither sensor nor pose."""

    name: str = "XYZ text"
    extensions: tuple[str, ...] = (".xyz", ".pts", ".csv", ".txt", ".asc")
    signed: bool = False

    def sniff(self, head: bytes) -> bool:
        """Tell whether the first line after comments, names and count is one of at least three numbers."""
        try:
            return _layout(head).width >= 3
        except _LayoutError:
            return False

    def scans(self, file: ScanFile, limits: ReadLimits, wanted: int | None = None) -> Iterator[ScanRecords]:
        """Yield the one cloud of a file."""
        with file.path.open("rb") as stream:
            head = stream.read(HEAD_BYTES)
        try:
            layout = _layout(head)
        except _LayoutError as fault:
            raise file.unreadable(str(fault), f"line {fault.line}") from fault
        if wanted not in {None, 0}:
            return
        refuse_long_lines(file)
        if layout.declared_points is not None:
            check_count(file, layout.declared_points, SHORTEST_LINE, limits, "count line", spare=1)
        roles = list(layout.columns)
        chosen = [layout.columns[role] for role in roles]
        with file.path.open(encoding="utf-8-sig" if head.startswith(BYTE_ORDER_MARK) else "latin-1") as stream:
            for _ in range(layout.skipped_lines):
                stream.readline()
            table = read_table(
                file,
                islice(stream, limits.max_points + 1),
                layout.skipped_lines + 1,
                delimiter=layout.delimiter,
                columns=chosen if layout.pick else None,
                comment="#",
            )
        if len(table) > limits.max_points:
            raise FileTooLargeError(
                f"{file.filename}, line {limits.max_points},", len(table), limits.max_points, "points"
            )
        if layout.declared_points not in {None, len(table)}:
            raise file.unreadable(
                f"the first line declares {layout.declared_points} points, the file has {len(table)}",
                f"line {layout.skipped_lines + len(table)}",
            )
        column = {role: table[:, at if layout.pick else layout.columns[role]] for at, role in enumerate(roles)}
        color = None
        if set(COLOR) <= column.keys():
            channels = np.column_stack([column[role] for role in COLOR])
            largest = float(np.nan_to_num(channels).max())
            color = colors_8bit(channels, 255.0 if 1.0 < largest <= 255.0 else 1.0 if largest <= 1.0 else 65535.0)
        yield ScanRecords(
            index=0,
            points=np.column_stack([column[axis] for axis in "xyz"]),
            intensity=column["intensity"].astype(np.float32) if "intensity" in column else None,
            color=color,
        )


def _layout(head: bytes) -> _Layout:
    """Find out from the head of a file what its columns are."""
    if b"\0" in head:
        raise _LayoutError("the file holds zero bytes, so it is no text", head.count(b"\n", 0, head.find(b"\0")) + 1)
    text = head.removeprefix(BYTE_ORDER_MARK).decode("latin-1")
    lines = text.split("\n")
    if len(head) >= HEAD_BYTES and len(lines) > 1:
        lines.pop()
    names: list[str] | None = None
    declared: int | None = None
    for at, raw in enumerate(lines):
        line = raw.strip()
        bare = line.lstrip("#/%! ")
        if not line:
            continue
        delimiter = _delimiter(bare)
        words = _words(bare, delimiter)
        if line.startswith(COMMENTS):
            names = _names(words) or names
        elif len(words) == 1 and words[0].isascii() and words[0].isdigit() and len(words[0]) < 19 and declared is None:
            declared = int(words[0])
        elif _names(words):
            names = _names(words)
        elif len(words) >= 3 and _are_coordinates(words, names):
            sample = [_words(later.strip(), delimiter) for later in lines[at : at + 200] if later.strip()]
            columns = _columns(names, sample, at + 1)
            # narrow tables without names are read whole, so that a broken line shows
            return _Layout(at, delimiter, declared, columns, len(words), pick=names is not None or len(words) > 7)
        elif delimiter == ";" and "," in bare:
            raise _LayoutError("decimal commas are not supported, write decimal points", at + 1)
        else:
            raise _LayoutError(f"'{line[:60]}' is neither a line of at least three numbers nor column names", at + 1)
    raise _LayoutError("no line of at least three numbers", len(lines))


def _delimiter(line: str) -> str | None:
    return next((mark for mark in ";," if mark in line), None)


def _words(line: str, delimiter: str | None) -> list[str]:
    return [word.strip() for word in line.split(delimiter)]


def _are_coordinates(words: list[str], names: list[str] | None) -> bool:
    places = [0, 1, 2] if names is None else [names.index(axis) for axis in "xyz"]
    return max(places) < len(words) and all(_is_number(words[place]) for place in places)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _names(words: list[str]) -> list[str] | None:
    """Take a line as column names if it names x, y and z."""
    roles = [ROLES.get(re.sub(r"[\"'\[(].*", "", word.strip("\"'").lower()).strip(), "") for word in words]
    return roles if {"x", "y", "z"} <= set(roles) else None


def _columns(names: list[str] | None, sample: list[list[str]], line: int) -> dict[str, int]:
    width = len(sample[0])
    if names is not None:
        if max(names.index(role) for role in set(names) - {""}) >= width:
            raise _LayoutError(f"{len(names)} column names over {width} columns", line)
        colored = COLOR if set(COLOR) <= set(names) else ()
        return {role: names.index(role) for role in ("x", "y", "z", "intensity", *colored) if role in names}
    columns = {"x": 0, "y": 1, "z": 2}
    intensity, red = None, None
    if width == 4:
        intensity = 3
    elif width == 6 and _look_like_color(sample, 3):
        red = 3
    elif width == 7 and _look_like_color(sample, 4):
        intensity, red = 3, 4
    elif width >= 7 and _look_like_color(sample, 3):
        red = 3
        intensity = 6 if width == 7 else None
    if intensity is not None:
        columns["intensity"] = intensity
    if red is not None:
        columns |= {role: red + i for i, role in enumerate(COLOR)}
    return columns


def _look_like_color(sample: list[list[str]], first: int) -> bool:
    words = [word for row in sample for word in row[first : first + 3]]
    return all(word.isascii() and word.isdigit() and int(word[:9]) <= 255 for word in words)
