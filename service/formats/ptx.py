"""Leica PTX: one or more structured scans in ascii, each with its pose."""

import sys
from codecs import BOM_UTF8
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from typing import BinaryIO, final

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Matrix4, Vector3
from service.errors import UnreadableFileError
from service.formats.base import RECORDS_AT_ONCE, ReadLimits, RefusedScan, ScanFile, ScanRecords
from service.formats.finishing import check_count, colors_8bit
from service.formats.number_table import read_table, refuse_long_lines

HEADER_LINES = 10
WORDS = [1, 1, 3, 3, 3, 3, 4, 4, 4, 4]
HEADER_RULE = "a PTX scan begins with two counts, four lines of three and four of four numbers"
LONGEST_COUNT = 24
"""Bytes of a line that may be a number of columns, with the ends of lines."""
SHORTEST_LINE = len("0 0 0\n")
NOWHERE = RigidTransform.identity()
"""Pose of a scan without points, whose own does not matter."""
RIGID_TOLERANCE = 2e-3
"""Entries of the matrix are often printed with three or four digits."""


@final
@dataclass(frozen=True)
class PtxReader:
    """Read PTX. Points `0 0 0` are directions without a return; their lines may be shorter than the others."""

    name: str = "PTX"
    extensions: tuple[str, ...] = (".ptx",)
    signed: bool = False

    def sniff(self, head: bytes) -> bool:
        """Tell whether the file begins with two counts and a position."""
        lines = _first_lines(head, 3)
        return len(lines) == 3 and [len(words) for words in lines] == [1, 1, 3] and _are_counts(lines[0] + lines[1])

    def complaint(self, head: bytes) -> str:
        """Tell what of the header is not as it must be."""
        if b"\0" in head[:4096]:
            return "the file holds zero bytes: save it as plain text (UTF-8), not as UTF-16"
        lines = _first_lines(head, HEADER_LINES)
        found = ", ".join(str(len(words)) for words in lines)
        return f"{HEADER_RULE}, but its first lines have {found} words" if lines else ""

    def scans(
        self, file: ScanFile, limits: ReadLimits, wanted: int | None = None
    ) -> Iterator[ScanRecords | RefusedScan]:
        """Yield the scans of a file in order, or only the one wanted."""
        refuse_long_lines(file)
        with file.path.open("rb") as stream:
            lines = _Lines(stream)
            for index in range(limits.max_scans):
                place = f"scan {index}, line {lines.number + 1}"
                try:
                    header = _read_header(file, lines, place)
                except UnreadableFileError as fault:
                    lines.skip_points()
                    if wanted in {None, index}:
                        yield RefusedScan(index, "", fault)
                    continue
                if header is None or (wanted is not None and index > wanted):
                    return
                try:
                    # after a count that cannot be nobody knows what the lines are
                    check_count(file, header.columns * header.rows, SHORTEST_LINE, limits, place, spare=1)
                except UnreadableFileError as fault:
                    yield RefusedScan(index, "", fault)
                    return
                if wanted in {None, index}:
                    yield _scan_or_fault(file, lines, header, index)
                lines.skip_points()
            if stream.read(1):
                raise file.unreadable(f"more than {limits.max_scans} scans", f"line {lines.number}")

    def pieces(self, file: ScanFile, limits: ReadLimits, index: int) -> Iterator[ScanRecords]:
        """Yield one scan piece by piece."""
        refuse_long_lines(file)
        with file.path.open("rb") as stream:
            lines = _Lines(stream)
            for number in range(index + 1):
                place = f"scan {number}, line {lines.number + 1}"
                header = _read_header(file, lines, place)
                if header is None:
                    return
                check_count(file, header.columns * header.rows, SHORTEST_LINE, limits, place, spare=1)
                if number < index:
                    lines.skip_points()
                    continue
                for first in range(0, header.columns * header.rows, RECORDS_AT_ONCE):
                    yield _read_points(file, lines, header, index, first)


@dataclass(frozen=True, eq=False)
class _Header:
    columns: int
    rows: int
    world_from_scan: RigidTransform
    sensor_in_scan_m: Vector3


def _are_counts(words: list[bytes]) -> bool:
    return all(word.isdigit() and len(word) < 19 for word in words)


class _Lines:
    """The lines of a file that are not blank. Those with points end where a line is a single number."""

    def __init__(self, stream: BinaryIO) -> None:
        self.number = 0
        """Lines read."""
        self._stream = stream
        self._ahead: bytes | None = None

    def header(self) -> list[list[bytes]]:
        """Give the words of the next ten lines, or of as many as there are."""
        found = [] if self._ahead is None else [self._ahead.split()]
        self._ahead = None
        for line in self._stream:
            self.number += 1
            if line.strip():
                found.append(line.removeprefix(BOM_UTF8).split())
            if len(found) == HEADER_LINES:
                break
        return found

    def points(self, count: int) -> Iterator[bytes]:
        """Give at most so many lines with points."""
        stream = self._stream
        if self._ahead is not None:
            return
        for _ in range(count):
            line = stream.readline()
            while line and line.isspace():
                self.number += 1
                line = stream.readline()
            if not line:
                return
            self.number += 1
            if len(line) < LONGEST_COUNT and len(line.split()) == 1:
                self._ahead = line
                return
            yield line

    def skip_points(self) -> int:
        """Go to the next header or to the end of the file; give the number of lines in between."""
        return sum(1 for _ in self.points(sys.maxsize))

    def place(self) -> tuple[int, int, bytes | None]:
        """Give where reading goes on, to come back to it."""
        return self._stream.tell(), self.number, self._ahead

    def back_to(self, place: tuple[int, int, bytes | None]) -> None:
        """Go on where `place` was asked for."""
        position, self.number, self._ahead = place
        self._stream.seek(position)


def _first_lines(head: bytes, count: int) -> list[list[bytes]]:
    lines = head[:4096].removeprefix(BOM_UTF8).splitlines()
    return list(islice((words for line in lines if (words := line.split())), count))


def _read_header(file: ScanFile, stream: _Lines, place: str) -> _Header | None:
    """Read the ten lines before a scan; None at the end of the file."""
    lines = stream.header()
    if not lines:
        return None
    if [len(words) for words in lines] != WORDS or not _are_counts(lines[0] + lines[1]):
        raise file.unreadable(HEADER_RULE, place)
    try:
        position_m = np.array([float(word) for word in lines[2]])
        matrix = np.array([[float(word) for word in words] for words in lines[6:10]])
    except ValueError as fault:
        raise file.unreadable(f"the header of the scan holds no number where one must stand: {fault}", place) from fault
    columns, rows = int(lines[0][0]), int(lines[1][0])
    if columns * rows == 0:
        return _Header(columns, rows, NOWHERE, np.zeros(3))
    pose = _pose(file, matrix, place)
    if not np.isfinite(position_m).all():
        raise file.unreadable("the scanner's position is not finite", place)
    return _Header(columns, rows, pose, pose.inv().apply(position_m))


def _scan_or_fault(file: ScanFile, lines: _Lines, header: _Header, index: int) -> ScanRecords | RefusedScan:
    place = f"scan {index}, line {lines.number + 1}"
    count = header.columns * header.rows
    try:
        if count == 0:
            raise file.unreadable("the scan holds no points", place)
        records = _read_points(file, lines, header, index)
        if surplus := lines.skip_points():
            raise file.unreadable(f"the header declares {count} points, {count + surplus} follow", place)
    except UnreadableFileError as fault:
        return RefusedScan(index, "", fault)
    return records


def _pose(file: ScanFile, matrix: Matrix4, place: str) -> RigidTransform:
    """Take the pose from PTX's matrix, which multiplies row vectors: [x y z 1]_world = [x y z 1]_scan · matrix."""
    column_matrix = matrix.T
    rotation = column_matrix[:3, :3]
    rigid = (
        np.isfinite(matrix).all()
        and np.allclose(column_matrix[3], [0, 0, 0, 1], atol=RIGID_TOLERANCE)
        and np.allclose(rotation @ rotation.T, np.eye(3), atol=RIGID_TOLERANCE)
        and np.linalg.det(rotation) > 0
    )
    if not rigid:
        scales = ", ".join(f"{scale:.6g}" for scale in np.linalg.norm(rotation, axis=0))
        raise file.unreadable(
            f"the transformation of the scan is no rotation and translation (scales {scales}); "
            "scans must be in metres and unscaled",
            place,
        )
    return RigidTransform.from_components(column_matrix[:3, 3], Rotation.from_matrix(rotation))


def _read_points(file: ScanFile, lines: _Lines, header: _Header, index: int, first: int | None = None) -> ScanRecords:
    """Read all points of a scan, or a piece of them from number `first` on."""
    line, start = lines.number + 1, lines.place()
    total = header.columns * header.rows
    count = total if first is None else min(RECORDS_AT_ONCE, total - first)
    try:
        table = read_table(file, lines.points(count), line)
    except UnreadableFileError:
        lines.back_to(start)
        width = _width(lines.points(count))
        lines.back_to(start)
        table = read_table(file, _filled_up(lines.points(count), width), line)
    if len(table) != count:
        raise file.unreadable(
            f"the scan ends after {(first or 0) + len(table)} of {total} points",
            f"scan {index}, line {line + len(table)}",
        )
    if table.shape[1] not in {3, 4, 6, 7}:
        raise file.unreadable(
            f"lines of {table.shape[1]} numbers; PTX has x y z [intensity] [r g b]", f"scan {index}, line {line}"
        )
    points = np.ascontiguousarray(table[:, :3])
    number = np.arange(count, dtype=np.int32) + (first or 0)
    return ScanRecords(
        index=index,
        points=points,
        valid=np.asarray(points.any(axis=1)),
        # column after column
        row=number % header.rows,
        column=number // header.rows,
        intensity=table[:, 3].astype(np.float32) if table.shape[1] in {4, 7} else None,
        color=colors_8bit(table[:, -3:], 255.0) if table.shape[1] >= 6 else None,
        sensor_in_scan_m=header.sensor_in_scan_m,
        world_from_scan=header.world_from_scan,
    )


def _width(lines: Iterator[bytes]) -> int:
    """Give the number of words of the first line with a return; without any, of the longest line."""
    longest = 0
    for line in lines:
        words = line.split()
        if not _is_without_return(words):
            return len(words)
        longest = max(longest, len(words))
    return longest


def _filled_up(lines: Iterator[bytes], width: int) -> Iterator[bytes]:
    """Give lines without a return the length of the others."""
    for line in lines:
        words = line.split()
        missing = width - len(words)
        if missing and len(words) >= 3 and _is_without_return(words):
            words = [*words[:width], *[b"0"] * max(missing, 0)]
            yield b" ".join(words) + b"\n"
        else:
            yield line


def _is_without_return(words: list[bytes]) -> bool:
    """Tell whether a line begins with three zeros."""
    return all(not word.strip(b"+-0.").rstrip(b"eE") for word in words[:3])
