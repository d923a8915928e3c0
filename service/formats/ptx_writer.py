"""Write scans as PTX."""

from collections.abc import Sequence
from pathlib import Path
from typing import TextIO

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array
from algorithms.scans.scan import Scan

LINES_AT_ONCE = 100_000


def write_ptx(path: Path, scans: Sequence[Scan]) -> None:
    """Write scans one after the other as PTX, coordinates to the micrometre.

    A scan with a grid is written column after column with `0 0 0` where nothing came back, one without as a single
    row. PTX always names the scanner's position: where the scan does not know it, the origin of its frame is written.
    """
    with path.open("w", encoding="ascii", newline="\n") as stream:
        for scan in scans:
            _write_header(stream, scan)
            _write_points(stream, scan)


def _write_header(stream: TextIO, scan: Scan) -> None:
    columns, rows = (len(scan), 1) if scan.grid is None else (scan.grid.columns, scan.grid.rows)
    pose = RigidTransform.identity() if scan.world_from_scan is None else scan.world_from_scan
    sensor_in_scan_m = np.zeros(3) if scan.sensor_m is None else scan.sensor_m + scan.origin_m
    row_vector_matrix = pose.as_matrix().T
    stream.write(f"{columns}\n{rows}\n")
    lines = (pose.apply(sensor_in_scan_m), *row_vector_matrix[:3, :3], *row_vector_matrix)
    stream.writelines(" ".join(f"{number:.12g}" for number in numbers) + "\n" for numbers in lines)


def _write_points(stream: TextIO, scan: Scan) -> None:
    order = np.arange(len(scan)) if scan.grid is None else scan.grid.index.T.ravel()
    for start in range(0, len(order), LINES_AT_ONCE):
        number = order[start : start + LINES_AT_ONCE]
        empty = number < 0
        columns: list[Array] = list((scan.points[number] + scan.origin_m).T)
        columns.append(np.zeros(len(number)) if scan.intensity is None else scan.intensity[number])
        line = "%.6f %.6f %.6f %.9g"
        if scan.color is not None:
            columns += list(scan.color[number].T)
            line += " %d %d %d"
        block = np.column_stack(columns)
        block[empty] = 0.0
        stream.write((line + "\n") * len(block) % tuple(block.ravel().tolist()))
