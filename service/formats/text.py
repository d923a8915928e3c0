"""Tables of points in text: XYZ, PTS and CSV, with or without column names, any usual delimiter."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain, count, islice
from typing import TextIO, final

import numpy as np

from algorithms.arrays import Array
from schemas.values.text_columns import HOW, PASSED_OVER, TEXT_ENDINGS, roles_of
from service.errors import FileTooLargeError, UnreadableFileError
from service.formats.base import RECORDS_AT_ONCE, ReadLimits, RefusedScan, ScanFile, ScanRecords, cut
from service.formats.column_evidence import UnclearColumnsError, column_evidence, coordinate_column
from service.formats.finishing import check_count, colors_8bit
from service.formats.number_table import read_table, refuse_long_lines
from service.formats.text_layout import (
    HEAD_BYTES,
    Layout,
    LayoutError,
    encoding_of,
    filled_lines,
    has_commas_for_both,
    is_count,
    layout_of,
    sampled,
)
from service.formats.text_units import unit_of_text

SHORTEST_LINE = len("0 0 0\n")
MOST_COLUMNS = 1000
"""Each is looked at for what it may hold, and every word of the first lines is kept for that."""
SAMPLED_LINES = 2000
SAMPLED_PLACES = 8
SAMPLE_BYTES = 1 << 14
MOST_BYTES_OF_A_CHARACTER = 2
COLORS = ("r", "g", "b")


@final
@dataclass(frozen=True)
class TextReader:
    """Read text tables. They know no scanner frame, so a scan has neither sensor nor pose.

    Several clouds may follow each other, each after the number of its points, as in PTS.
    """

    name: str = "XYZ text"
    extensions: tuple[str, ...] = TEXT_ENDINGS
    signed: bool = False

    def sniff(self, head: bytes) -> bool:
        """Tell whether the first line after comments, names and count is one of at least three numbers."""
        try:
            return layout_of(head).width >= 3
        except LayoutError:
            return False

    def complaint(self, head: bytes) -> str:
        """Tell why the first lines are no table of points."""
        try:
            layout_of(head)
        except LayoutError as fault:
            return f"{fault} (at line {fault.line})"
        return ""

    def scans(
        self, file: ScanFile, limits: ReadLimits, wanted: int | None = None
    ) -> Iterator[ScanRecords | RefusedScan]:
        """Yield the clouds of a file in order, or only the one wanted."""
        with _opened(file, limits) as (table, stream, head):
            if table.layout.declared_points is None:
                if wanted in {None, 0}:
                    yield table.single(stream, head)
            else:
                yield from table.several(stream, table.layout.declared_points, wanted)

    def pieces(self, file: ScanFile, limits: ReadLimits, index: int) -> Iterator[ScanRecords]:
        """Yield one cloud piece by piece; one of several that follow their number is read as a whole."""
        with _opened(file, limits) as (table, stream, head):
            if table.layout.declared_points is not None:
                for records in table.several(stream, table.layout.declared_points, index):
                    yield from cut(records)
            elif index == 0:
                yield from table.single_in_pieces(stream, head)


@contextmanager
def _opened(file: ScanFile, limits: ReadLimits) -> Iterator[tuple["_Table", TextIO, bytes]]:
    """Find out how a file is written; give its first bytes and a stream from the first line of numbers on."""
    with file.path.open("rb") as binary:
        head = binary.read(HEAD_BYTES)
    stated = roles_of(file.columns.split(",")) if file.columns else []
    try:
        layout = layout_of(head, stated)
    except LayoutError as fault:
        raise file.unreadable(str(fault), f"line {fault.line}") from fault
    refuse_long_lines(file)
    if layout.width > MOST_COLUMNS:
        reason = f"the first line has {layout.width} columns, at most {MOST_COLUMNS} are read"
        raise file.unreadable(reason, f"line {layout.skipped_lines + 1}")
    with file.path.open(encoding=layout.encoding) as stream:
        for _ in range(layout.skipped_lines):
            stream.readline()
        yield _Table(file, limits, layout, stated), stream, head


@dataclass(frozen=True)
class _Table:
    file: ScanFile
    limits: ReadLimits
    layout: Layout
    stated: Sequence[str]

    def single(self, stream: TextIO, head: bytes) -> ScanRecords:
        """Read all that is left of the file."""
        ahead, roles = self._sampled_roles(stream, head)
        first_line, most = self.layout.skipped_lines + 1, self.limits.max_points
        numbers = self._numbers(islice(chain(ahead, stream), most + 1), first_line, roles)
        if len(numbers) > most:
            raise FileTooLargeError(f"{self.file.filename}, line {most},", len(numbers), most, "points")
        return self._records(0, numbers, roles, _color_scale(numbers, roles))

    def single_in_pieces(self, stream: TextIO, head: bytes) -> Iterator[ScanRecords]:
        """Read all that is left of the file, some lines at a time."""
        ahead, roles = self._sampled_roles(stream, head)
        lines, line, scale = chain(ahead, stream), self.layout.skipped_lines + 1, 0.0
        while piece := list(islice(lines, RECORDS_AT_ONCE)):
            numbers = self._numbers(iter(piece), line, roles)
            line += len(piece)
            if line > self.limits.max_points + self.layout.skipped_lines + 1:
                raise FileTooLargeError(self.file.filename, line, self.limits.max_points, "points")
            scale = scale or _color_scale(numbers, roles)
            yield self._records(0, numbers, roles, scale)

    def _sampled_roles(self, stream: TextIO, head: bytes) -> tuple[list[str], list[str]]:
        """Give the first lines, which are read then, and what the columns are."""
        ahead = list(islice(stream, SAMPLED_LINES))
        after = max(len(head), MOST_BYTES_OF_A_CHARACTER * sum(map(len, ahead)))
        return ahead, self._roles([ahead, *_places(self.file, self.layout, after)], self.layout.skipped_lines + 1)

    def several(self, stream: TextIO, declared: int, wanted: int | None) -> Iterator[ScanRecords | RefusedScan]:
        """Read clouds, each after its number of points; what is wrong with one does no harm to the others."""
        line, next_count = self.layout.skipped_lines + 1, str(declared)
        for index in count():
            if index >= self.limits.max_scans:
                raise self.file.unreadable(f"more than {self.limits.max_scans} scans", f"line {line}")
            block = _Block(stream, int(next_count))
            if wanted in {None, index}:
                try:
                    yield self._of_block(block, index, line)
                except UnreadableFileError as fault:
                    yield RefusedScan(index, "", fault)
            block.skip()
            line += block.read_lines
            if block.next_count is None or (wanted is not None and index >= wanted):
                return
            next_count = block.next_count

    def _of_block(self, block: "_Block", index: int, line: int) -> ScanRecords:
        place = f"scan {index}, line {line}" if index else f"line {line}"
        check_count(self.file, block.declared, SHORTEST_LINE, self.limits, f"{place}, count line", spare=1)
        if block.declared == 0:
            raise self.file.unreadable("the scan holds no points", place)
        lines = filled_lines(block.lines())
        ahead = list(islice(lines, SAMPLED_LINES))
        if not ahead:
            raise self.file.unreadable(f"the count line declares {block.declared} points, but none follow", place)
        roles = self._roles([ahead], line)
        numbers = self._numbers(chain(ahead, lines), line, roles)
        found = len(numbers) + block.surplus()
        if found != block.declared:
            first = "the first line" if index == 0 else "its count line"
            end = f"line {line + len(numbers) - 1}"
            raise self.file.unreadable(f"{first} declares {block.declared} points, the file has {found}", end)
        return self._records(index, numbers, roles, _color_scale(numbers, roles))

    def _roles(self, samples: Sequence[Sequence[str]], line: int) -> list[str]:
        """Tell what the columns are: as stated, as named, or as their numbers show."""
        separators, width = self.layout.separators, self._width(samples[0])
        if has_commas_for_both(samples[0], separators, width):
            reason = "commas stand both between numbers and before their decimals; separate the numbers with semicolons"
            raise self.file.unreadable(f"{reason} or tabs, or write decimal points", f"line {line}")
        if self.stated:
            self._check_stated(sampled(samples[0], separators, width), width, line)
            return list(self.stated)
        if self.layout.names:
            return self._named_roles(width, line)
        blocks = [numbers for lines in samples if len(numbers := sampled(lines, separators, width)) > 0]
        evidence = column_evidence(blocks)
        try:
            first = coordinate_column(evidence, sum(map(len, blocks)))
        except UnclearColumnsError as fault:
            seen = "; ".join(f"column {at + 1}: {column.in_words()}" for at, column in enumerate(evidence[:12]))
            reason = f"it is not clear which columns are coordinates: {fault}. Seen: {seen}. To read it, {HOW}"
            raise self.file.unreadable(reason, f"line {line}") from fault
        rest = np.vstack(blocks)[:, first + 3 :]
        return [PASSED_OVER] * first + ["x", "y", "z"] + _roles_after(rest)

    def _width(self, lines: Sequence[str]) -> int:
        words = self.layout.separators.words
        return next((len(words(line.strip())) for line in lines if not line.isspace()), self.layout.width)

    def _named_roles(self, width: int, line: int) -> list[str]:
        roles = roles_of(self.layout.names)
        seen: set[str] = set()
        for at, role in enumerate(roles):
            if role in seen:
                roles[at] = PASSED_OVER
            seen.add(role)
        last = max(at for at, role in enumerate(roles) if role != PASSED_OVER)
        if last >= width:
            raise self.file.unreadable(f"{len(roles)} column names over {width} columns", f"line {line}")
        roles = [role if set(COLORS) <= seen or role not in COLORS else PASSED_OVER for role in roles]
        return [*roles, *[PASSED_OVER] * width][:width]

    def _check_stated(self, numbers: Array, width: int, line: int) -> None:
        """See that the columns can be what they are said to be."""
        if len(self.stated) != width:
            raise self.file.unreadable(
                f"`columns` names {len(self.stated)} columns ({self.file.columns}), the lines have {width}",
                f"line {line}",
            )
        for at, (role, name) in enumerate(zip(self.stated, self.file.columns.split(","), strict=True)):
            column, place = numbers[:, at], f"column {at + 1}"
            if role != PASSED_OVER and np.isinf(column).any():
                raise self.file.unreadable(f"`columns` says that {place} is {name}, but it holds words", f"line {line}")
            if name in {"row", "col", "ring"} and (column[np.isfinite(column)] % 1.0 != 0.0).any():
                other = column[column % 1.0 != 0.0][0]
                raise self.file.unreadable(
                    f"`columns` says that {place} is {name}, but it holds {other:.10g}, no whole number", f"line {line}"
                )
            if role in COLORS and ((column < 0.0) | (column > 65535.0)).any():
                other = column[(column < 0.0) | (column > 65535.0)][0]
                raise self.file.unreadable(
                    f"`columns` says that {place} is the colour {name}, but it holds {other:.10g}", f"line {line}"
                )

    def _numbers(self, lines: Iterator[str], first_line: int, roles: Sequence[str]) -> Array:
        """Read the columns that have a role; narrow tables as a whole, so that a broken line shows."""
        chosen = [at for at, role in enumerate(roles) if role != PASSED_OVER]
        pick = bool(self.layout.names) or len(roles) > 7 or PASSED_OVER in roles
        if self.layout.separators.decimal_comma:
            lines = (line.replace(",", ".") for line in lines)
        delimiter = self.layout.separators.delimiter
        table = read_table(
            self.file, lines, first_line, delimiter=delimiter, columns=chosen if pick else None, comment="#"
        )
        return table if pick else table[:, chosen]

    def _records(self, index: int, numbers: Array, roles: Sequence[str], color_scale: float) -> ScanRecords:
        chosen = [role for role in roles if role != PASSED_OVER]
        column = {role: numbers[:, at] for at, role in enumerate(chosen)}
        color = None
        if set(COLORS) <= column.keys():
            color = colors_8bit(np.column_stack([column[role] for role in COLORS]), color_scale or 255.0)
        unit, open_unit = unit_of_text(self.file, self.layout)
        return ScanRecords(
            index=index,
            points=np.column_stack([column[axis] for axis in "xyz"]),
            intensity=column["i"].astype(np.float32) if "i" in column else None,
            color=color,
            unit=unit,
            text_columns=self.file.columns or ",".join(roles),
            open_unit=open_unit,
        )


def _color_scale(numbers: Array, roles: Sequence[str]) -> float:
    """Tell from the colours what their largest number means; 0 where there are none, or all is black."""
    chosen = [role for role in roles if role != PASSED_OVER]
    if not set(COLORS) <= set(chosen):
        return 0.0
    largest = max(float(np.nan_to_num(numbers[:, chosen.index(role)]).max(initial=0.0)) for role in COLORS)
    return 0.0 if largest <= 0.0 else 1.0 if largest <= 1.0 else 255.0 if largest <= 255.0 else 65535.0


class _Block:
    """The lines of one cloud, which end where the next number of points stands."""

    def __init__(self, stream: TextIO, declared: int) -> None:
        self.declared = declared
        self.next_count: str | None = None
        """The next number of points; None: the file ends."""
        self.read_lines = 0
        self._stream = stream
        self._ended = False

    def lines(self) -> Iterator[str]:
        """Give lines up to and with the last one that was declared."""
        given = 0
        while given < self.declared and (line := self._next()) is not None:
            given += not (line.isspace() or line.lstrip().startswith("#"))
            yield line

    def surplus(self) -> int:
        """Count the points that follow beyond what was declared."""
        return sum(1 for line in iter(self._next, None) if not (line.isspace() or line.lstrip().startswith("#")))

    def skip(self) -> None:
        """Go to the end."""
        while self._next() is not None:
            pass

    def _next(self) -> str | None:
        if self._ended:
            return None
        line = self._stream.readline()
        self.read_lines += 1
        if not line or is_count(line.strip()):
            self._ended, self.next_count = True, line.strip() or None
            return None
        return line


def _places(file: ScanFile, layout: Layout, after: int) -> Iterator[list[str]]:
    """Give whole lines of some places of a file, in their order."""
    number = min(SAMPLED_PLACES, (file.size - after) // SAMPLE_BYTES)  # so that they do not overlap
    if number < 1:
        return
    encoding = encoding_of(b"") if layout.encoding == "utf-8-sig" else layout.encoding
    with file.path.open("rb") as stream:
        if encoding == "utf-16":
            encoding = "utf-16-le" if stream.read(2) == b"\xff\xfe" else "utf-16-be"
        for place in np.linspace(after, file.size - SAMPLE_BYTES, number).astype(int):
            stream.seek(int(place) // 2 * 2)
            lines = stream.read(SAMPLE_BYTES).decode(encoding, "replace").split("\n")
            yield lines[1:-1]


def _roles_after(rest: Array) -> list[str]:
    """Tell what stands behind the coordinates, as far as that is usual."""
    roles = [PASSED_OVER] * rest.shape[1]
    words = np.flatnonzero(np.isinf(rest).any(axis=0))
    width = int(words[0]) if len(words) else rest.shape[1]
    rest = rest[:, :width]
    if width == 1:
        roles[0] = "i"
    elif width == 3 and _look_like_color(rest):
        roles[:3] = COLORS
    elif width == 4 and _look_like_color(rest[:, 1:]):
        roles[:4] = ["i", *COLORS]
    elif width >= 4 and _look_like_color(rest[:, :3]):
        roles[:3] = COLORS
        if width == 4:
            roles[3] = "i"
    return roles


def _look_like_color(channels: Array) -> bool:
    return bool(((channels >= 0) & (channels <= 255) & (channels == np.round(channels))).all())
