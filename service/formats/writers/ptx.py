"""PTX: the scanner's grid column after column, the pose in the header of each scan."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO, final

import numpy as np

from algorithms.arrays import Array
from algorithms.progress import Progress
from service.formats.intensities import is_rescaled, unit_intensities
from service.formats.writers.base import PointPiece, StationCloud, Written
from service.formats.writers.grids import ColumnOrder
from service.formats.writers.placed import placed
from service.formats.writers.text import no_columns, text_lines
from service.formats.writers.whole_files import whole_file

LINE = "%.6f %.6f %.6f %.9g"
"""Coordinates to the micrometre."""
RESCALED = "intensities were brought to 0 … 1, as PTX has them"


@final
@dataclass(frozen=True)
class PtxWriter:
    """Write PTX: points in the scan frame, the pose in the header.

    A scan with a grid is written column after column with `0 0 0` where nothing came back, one without as a single
    row. PTX always names the scanner's position: where the scan does not know it, the origin of its frame is written.
    """

    name: str = "ptx"
    ending: str = ".ptx"
    media_type: str = "text/plain"

    def write(self, path: Path, clouds: Sequence[StationCloud], progress: Progress) -> Written:
        """Write stations into one file, one after the other."""
        everything = placed(clouds)
        total, done, left_out = max(1, everything.points), 0, 0
        with whole_file(path) as partial, partial.open("w", encoding="ascii", newline="\n") as stream:
            for cloud in everything.clouds:
                assert cloud.facts is not None  # noqa: S101 - `placed` surveys
                _write_header(stream, cloud, cloud.facts.points)
                with ColumnOrder.of(cloud, partial.parent) as order:
                    left_out += order.left_out
                    for piece in order.pieces():
                        progress.report(min(1.0, done / total), f"writing {cloud.name}")
                        _write_points(stream, cloud, piece)
                        done += len(piece)
        shared = f"{left_out} points are left out: PTX has room for one in a cell of the scanner's grid"
        notes = [*no_columns("PTX", everything), *([shared] if left_out else [])]
        if any(
            is_rescaled(cloud.facts.intensity_limits, cloud.intensity_scale, 1.0)
            for cloud in everything.clouds
            if cloud.facts
        ):
            notes.append(RESCALED)
        return Written(everything.points - left_out, tuple(notes))


def _write_header(stream: TextIO, cloud: StationCloud, points: int) -> None:
    columns, rows = (cloud.columns, cloud.rows) if cloud.rows is not None and cloud.columns is not None else (points, 1)
    sensor_in_scan_m = np.zeros(3) if cloud.sensor_in_scan_m is None else cloud.sensor_in_scan_m
    row_vector_matrix = cloud.pose.as_matrix().T
    stream.write(f"{columns}\n{rows}\n")
    lines = (cloud.pose.apply(sensor_in_scan_m), *row_vector_matrix[:3, :3], *row_vector_matrix)
    stream.writelines(" ".join(f"{number:.15g}" for number in numbers) + "\n" for numbers in lines)


def _write_points(stream: TextIO, cloud: StationCloud, piece: PointPiece) -> None:
    missing = np.isnan(piece.points[:, 0])
    columns: list[Array] = list((piece.points + cloud.origin_m).T)
    limits = None if cloud.facts is None else cloud.facts.intensity_limits
    columns.append(
        unit_intensities(piece.intensity, limits, cloud.intensity_scale)
        if piece.intensity is not None and limits is not None
        else np.zeros(len(piece))
    )
    line = LINE
    if cloud.has_color:
        columns += list(np.zeros((3, len(piece))) if piece.color is None else piece.color.T)
        line += " %d %d %d"
    if missing.any():
        columns = [np.where(missing, 0.0, column) for column in columns]
    stream.writelines(text_lines(columns, line))
