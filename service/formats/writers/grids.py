"""The cells of a scanner's grid in the order of its columns, whatever the order of the points."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from algorithms.arrays import Array
from service.formats.writers.base import POINTS_AT_ONCE, PointPiece, StationCloud

CELL = [("points", "<f8", 3), ("intensity", "<f4"), ("color", "u1", 3), ("filled", "u1")]


@dataclass(frozen=True, eq=False)
class ColumnOrder:
    """A station's grid, spread over a file beside the output: no cloud is held in memory."""

    cloud: StationCloud
    cells: Array | None
    """(columns · rows,) records, column after column; None: the points have no grid."""
    left_out: int = 0
    """Points whose cell another one has."""

    @staticmethod
    @contextmanager
    def of(cloud: StationCloud, folder: Path) -> Iterator["ColumnOrder"]:
        """Sort the points of a cloud into their cells; of several in one cell the first stays."""
        if cloud.rows is None or cloud.columns is None:
            yield ColumnOrder(cloud, None)
            return
        with tempfile.TemporaryFile(dir=folder) as file:
            # with its blocks: a process that writes to a mapped file for which the disk has none is killed
            os.posix_fallocate(file.fileno(), 0, max(1, cloud.rows * cloud.columns * np.dtype(CELL).itemsize))
            cells = np.memmap(file, dtype=CELL, mode="r+", shape=(cloud.rows * cloud.columns,))
            left_out = sum(_sort_in(cells, piece, cloud.rows) for piece in cloud.pieces())
            yield ColumnOrder(cloud, cells, left_out)

    def pieces(self) -> Iterator[PointPiece]:
        """Give all cells column after column, NaN where nothing came back; without a grid the points as they come."""
        if self.cells is None:
            yield from self.cloud.pieces()
            return
        for start in range(0, len(self.cells), POINTS_AT_ONCE):
            part = np.array(self.cells[start : start + POINTS_AT_ONCE])
            points = part["points"].copy()
            points[part["filled"] == 0] = np.nan
            yield PointPiece(
                points,
                part["intensity"] if self.cloud.has_intensity else None,
                part["color"] if self.cloud.has_color else None,
            )


def _sort_in(cells: Array, piece: PointPiece, rows: int) -> int:
    """Put points into their cells; give the number of those that find another one there."""
    if piece.row is None or piece.column is None:
        raise ValueError("a station with a grid gave points without row and column")
    where = piece.column.astype(np.int64) * rows + piece.row
    _, first = np.unique(where, return_index=True)
    chosen = first[cells["filled"][where[first]] == 0]
    part = np.zeros(len(chosen), dtype=CELL)
    part["points"], part["filled"] = piece.points[chosen], 1
    if piece.intensity is not None:
        part["intensity"] = piece.intensity[chosen]
    if piece.color is not None:
        part["color"] = piece.color[chosen]
    cells[where[chosen]] = part
    return len(piece) - len(chosen)
