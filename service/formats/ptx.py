"""Leica PTX: one or more structured scans in ascii, each with its pose."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from typing import BinaryIO, final

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Matrix4, Vector3
from service.formats.base import ReadLimits, ScanFile, ScanRecords
from service.formats.finishing import check_count, colors_8bit
from service.formats.number_table import read_table, refuse_long_lines

HEADER_LINES = 10
SHORTEST_LINE = len("0 0 0\n")
NOWHERE = RigidTransform.identity()
"""Pose of a scan without points, whose own does not matter."""
RIGID_TOLERANCE = 2e-3
"""Entries of the matrix are often printed with three or four digits."""


@final
@dataclass(frozen=True)
class PtxReader:
    """Read PTX. Points `0 0 0` are directions without a return."""

    name: str = "PTX"
    extensions: tuple[str, ...] = (".ptx",)
    signed: bool = False

    def sniff(self, head: bytes) -> bool:
        """Tell whether the file begins with two counts and a position."""
        lines = [line.split() for line in head[:4096].splitlines()[:3]]
        return len(lines) == 3 and [len(words) for words in lines] == [1, 1, 3] and _are_counts(lines[0] + lines[1])

    def scans(self, file: ScanFile, limits: ReadLimits, wanted: int | None = None) -> Iterator[ScanRecords]:
        """Yield the scans of a file in order, or only the one wanted."""
        line = 1
        refuse_long_lines(file)
        with file.path.open("rb") as stream:
            for index in range(limits.max_scans):
                place = f"scan {index}, line {line}"
                header, read = _read_header(file, stream, place)
                if header is None or (wanted is not None and index > wanted):
                    return
                line += read
                count = header.columns * header.rows
                check_count(file, count, SHORTEST_LINE, limits, place, spare=1)
                if count > 0 and wanted in {None, index}:
                    yield _read_points(file, stream, header, index, line)
                else:
                    skipped = sum(1 for _ in islice(stream, count))
                    if skipped < count:
                        raise file.unreadable(f"the scan ends after {skipped} of {count} lines", place)
                line += count
            if stream.read(1):
                raise file.unreadable(f"more than {limits.max_scans} scans", f"line {line}")


@dataclass(frozen=True, eq=False)
class _Header:
    columns: int
    rows: int
    world_from_scan: RigidTransform
    sensor_in_scan_m: Vector3


def _are_counts(words: list[bytes]) -> bool:
    return all(word.isdigit() and len(word) < 19 for word in words)


def _read_header(file: ScanFile, stream: BinaryIO, place: str) -> tuple[_Header | None, int]:
    """Read the ten lines before a scan; None at the end of the file. Also give the number of lines used."""
    blank = 0
    for first in stream:
        if first.strip():
            break
        blank += 1
    else:
        return None, blank
    lines = [first.split(), *(line.split() for line in islice(stream, HEADER_LINES - 1))]
    if [len(words) for words in lines] != [1, 1, 3, 3, 3, 3, 4, 4, 4, 4] or not _are_counts(lines[0] + lines[1]):
        raise file.unreadable("a PTX scan begins with two counts, four lines of three and four of four numbers", place)
    try:
        position_m = np.array([float(word) for word in lines[2]])
        matrix = np.array([[float(word) for word in words] for words in lines[6:10]])
    except ValueError as fault:
        raise file.unreadable(f"the header of the scan holds no number where one must stand: {fault}", place) from fault
    columns, rows = int(lines[0][0]), int(lines[1][0])
    if columns * rows == 0:
        return _Header(columns, rows, NOWHERE, np.zeros(3)), blank + HEADER_LINES
    pose = _pose(file, matrix, place)
    if not np.isfinite(position_m).all():
        raise file.unreadable("the scanner's position is not finite", place)
    return _Header(columns, rows, pose, pose.inv().apply(position_m)), blank + HEADER_LINES


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


def _read_points(file: ScanFile, stream: BinaryIO, header: _Header, index: int, line: int) -> ScanRecords:
    count = header.columns * header.rows
    table = read_table(file, islice(stream, count), line)
    if len(table) != count:
        raise file.unreadable(
            f"the scan ends after {len(table)} of {count} points", f"scan {index}, line {line + len(table)}"
        )
    if table.shape[1] not in {3, 4, 6, 7}:
        raise file.unreadable(
            f"lines of {table.shape[1]} numbers; PTX has x y z [intensity] [r g b]", f"scan {index}, line {line}"
        )
    points = np.ascontiguousarray(table[:, :3])
    number = np.arange(count, dtype=np.int32)
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
