"""Run feature extraction and tell the time of its stages, and simulate scans of tens of millions of points."""

import time
from dataclasses import dataclass, field

import numpy as np

from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.scans.scan import Scan, ScanGrid

HALL_M = np.array([[-18.0, -11.0, -1.6], [22.0, 14.0, 6.4]])
"""Opposite corners of a hall around the instrument."""
COLUMNS_M = [(x, y, 0.4) for x in (-9.0, 2.0, 13.0) for y in (-6.0, 7.0)]
"""Round columns in it: x, y, radius."""


CORES = 2


@dataclass
class StageClock:
    """Note the time at every step that is reported."""

    marks: dict[str, tuple[float, float, float]] = field(default_factory=dict)

    def report(self, _fraction: float, message: str) -> None:
        """Take the time at which a stage begins: wall, processor time of all threads and of the main one."""
        self.marks.setdefault(message, (time.perf_counter(), time.process_time(), time.thread_time()))

    def until(self, stage: str) -> tuple[float, float, float]:
        """Give wall time, processor time and what the wall time would be on two idle cores [s].

        The last is the time of the main thread and, for what the other threads did together, half of theirs: it does
        not depend on what else the machine does.
        """
        start, end = next(iter(self.marks.values())), self.marks[stage]
        wall, processor, main = (after - before for before, after in zip(start, end, strict=True))
        return wall, processor, main + (processor - main) / CORES


def timed_features(scan):
    """Extract the features of a scan, with a clock whose last mark is `end`."""
    clock = StageClock()
    features = extract_features(scan, FeatureOptions(), progress=clock, rng=np.random.default_rng(0))
    clock.report(1.0, "end")
    return features, clock


def hall_scan(rows: int, columns: int, points=None) -> Scan:
    """Measure the hall on a full-circle grid from -60 to 66 degrees of elevation, with 2 mm of noise in range.

    The points go into `points` (rows * columns, 3) where given, so that they need not be held in memory.
    """
    points = np.empty((rows * columns, 3)) if points is None else points
    azimuth = np.arange(columns) * (2.0 * np.pi / columns)
    rng = np.random.default_rng(11)
    for row, elevation in enumerate(np.deg2rad(np.linspace(66.0, -60.0, rows))):
        flat, up = np.cos(elevation), np.sin(elevation)
        rays = np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.full(columns, up)])
        with np.errstate(divide="ignore"):
            ranges = np.min(
                np.where(rays > 0.0, HALL_M[1], HALL_M[0]) / rays, axis=1, where=rays != 0.0, initial=np.inf
            )
        for x, y, radius in COLUMNS_M:
            along = (rays[:, 0] * x + rays[:, 1] * y) / flat
            square = radius**2 - (x * x + y * y - along**2)
            hit = (square > 0.0) & (along > 0.0)
            ranges[hit] = np.minimum(ranges[hit], (along[hit] - np.sqrt(square[hit])) / flat)
        ranges += rng.normal(0.0, 0.002, columns)
        points[row * columns : (row + 1) * columns] = rays * ranges[:, None]
    grid = ScanGrid(np.arange(rows * columns, dtype=np.int32).reshape(rows, columns))
    return Scan(points=points, origin_m=np.zeros(3), name="hall", grid=grid, sensor_m=np.zeros(3))
