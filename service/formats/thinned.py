"""A scan of a file with so many points that not all of them are kept: every second, third … row and column of its grid.

Where a scan stands in the world rests on surfaces metres wide; of hundreds of millions of points a part tells as much.
"""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from algorithms.arrays import Array, Flags
from algorithms.scans.scan import Scan
from service.formats import NO_LIMITS, reader_of
from service.formats.base import RECORDS_AT_ONCE, ReadLimits, ScanFile, ScanRecords
from service.formats.finishing import finish


def read_thinned_scan(
    path: Path,
    filename: str,
    index: int,
    records: int,
    most: int,
    limits: ReadLimits = NO_LIMITS,
    *,
    columns: str = "",
    unit: str = "",
) -> tuple[Scan, str]:
    """Read about `most` points of a scan, piece by piece, as `read_scan` reads all; O(records) time, O(most) memory.

    Parameters
    ----------
    path, filename, index, limits, columns, unit
        As of `read_scan`.
    records
        How many the scan has, with those without a return.
    most
        How many points are kept, about.

    Returns
    -------
    The scan, and in words which points it has.

    Raises
    ------
    UnreadableFileError
        The file cannot be used, or holds no usable scan under that index.
    FileTooLargeError
        The scan has more points than `limits` allow.
    """
    file = ScanFile(path, filename, columns, unit)
    kept: Thinned | None = None
    with np.errstate(all="ignore"):
        for piece in reader_of(file).pieces(file, limits, index):
            kept = Thinned(file, piece, records, most) if kept is None else kept
            kept.take(piece)
        if kept is None:
            raise file.unreadable("the file holds no points under this index", f"scan {index}")
        return finish(file, kept.joined()), kept.words


class Thinned:
    """Arrays of a scan that are filled piece by piece with the points that are kept."""

    def __init__(self, file: ScanFile, first: ScanRecords, records: int, most: int) -> None:
        """Make room for about `most` of `records`; the first piece tells what there is of each."""
        self._file, self._first = file, first
        self._grid = first.row is not None and first.column is not None
        share = max(records / most, 1.0)
        self._step = math.ceil(math.sqrt(share) if self._grid else share)
        self._cells = _numbering(first.row), _numbering(first.column)
        self._seen, self._filled = 0, 0
        # what is never written to takes no memory
        room = records // self._step + RECORDS_AT_ONCE
        self._points = np.empty((room, 3))
        self._others = {
            name: np.empty((room, *value.shape[1:]), dtype=value.dtype)
            for name in ("valid", "row", "column", "intensity", "color")
            if (value := getattr(first, name)) is not None
        }
        self.words = (
            f"of {records} points those of every {_ordinal(self._step)} row and column were used"
            if self._grid
            else f"of {records} points every {_ordinal(self._step)} one was used"
        )

    def take(self, piece: ScanRecords) -> None:
        """Keep some points of the next piece."""
        chosen = self._chosen(piece)
        points = piece.points[chosen]
        if self._filled + len(points) > len(self._points):
            why = "rows and columns are numbered so that leaving some of them out leaves too many points"
            raise self._file.unreadable(why, f"scan {self._first.index}")
        if piece.base_m is not None and self._first.base_m is not None:
            points += piece.base_m - self._first.base_m
        part = slice(self._filled, self._filled + len(points))
        self._points[part] = points
        for name, target in self._others.items():
            value: Array | None = getattr(piece, name)
            target[part] = _absent(name) if value is None else value[chosen]
        self._filled = part.stop
        self._seen += len(piece.points)

    def joined(self) -> ScanRecords:
        """Give what was kept as one scan, its grid renumbered."""
        whole: dict[str, Any] = {name: value[: self._filled] for name, value in self._others.items()}
        if self._grid:
            whole |= {
                name: (whole[name] - lowest) // (stride * self._step)
                for name, (lowest, stride) in zip(("row", "column"), self._cells, strict=True)
            }
        return replace(self._first, points=self._points[: self._filled], times_s=None, **whole)

    def _chosen(self, piece: ScanRecords) -> Flags:
        if self._grid and piece.row is not None and piece.column is not None:
            whole = zip((piece.row, piece.column), self._cells, strict=True)
            rows, columns = ((numbers - lowest) % (stride * self._step) == 0 for numbers, (lowest, stride) in whole)
            return np.asarray(rows & columns)
        return np.asarray((self._seen + np.arange(len(piece.points))) % self._step == 0)


def _numbering(numbers: Array | None) -> tuple[int, int]:
    """Tell the lowest number of rows or columns, and how far apart they are: one that was thinned may count by more."""
    if numbers is None or len(numbers) == 0:
        return 0, 1
    lowest = int(numbers.min())
    return lowest, max(int(np.gcd.reduce(np.unique(numbers) - lowest)), 1)


def _absent(name: str) -> bool:
    """Give what an attribute is that a piece lacks: a return, and nothing else."""
    return name == "valid"


def _ordinal(number: int) -> str:
    return {1: "single", 2: "second", 3: "third"}.get(number, f"{number}th")
