"""What a scan is."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Colors, Floats32, GridIndex, Points, Vector3
from algorithms.scans.point_blocks import over_blocks

SAMPLED_LINES = 8
"""Of so many rows and columns the order of the points is seen."""


@dataclass(frozen=True, eq=False)
class ScanGrid:
    """Which point was measured in which row and column."""

    index: GridIndex
    """(rows, columns) int32: number of the point, -1 where nothing came back."""

    @property
    def rows(self) -> int:
        """Number of rows (vertical circle)."""
        return int(self.index.shape[0])

    @property
    def columns(self) -> int:
        """Number of columns (horizontal circle)."""
        return int(self.index.shape[1])

    @property
    def is_recorded_by_columns(self) -> bool:
        """Whether points come in the order of the columns rather than of the rows, as far as a sample tells."""
        rows, columns = (max(1, length // SAMPLED_LINES) for length in self.index.shape)
        return _median_step(self.index[:, ::columns].T) < _median_step(self.index[::rows])

    def turned(self) -> "ScanGrid":
        """Give the grid with rows and columns exchanged."""
        index = np.empty((self.columns, self.rows), dtype=np.int32)
        over_blocks(lambda start, end: np.copyto(index[start:end], self.index[:, start:end].T), self.columns, least=128)
        return ScanGrid(index)


def _median_step(lines: GridIndex) -> float:
    """Give the median difference between the numbers of neighbours in a line; infinite where there are none."""
    both = (lines[:, 1:] >= 0) & (lines[:, :-1] >= 0)
    steps = np.abs(lines[:, 1:] - lines[:, :-1])[both]
    return float(np.median(steps)) if len(steps) else np.inf


@dataclass(frozen=True)
class ScalarField:
    """A further number of each point, such as its class, its standard deviation or its distance from a model."""

    name: str
    """Small letters, digits and `_`, at most 32: it names the column in every format."""
    description: str
    """What it is, with its unit; at most 32 characters of ASCII, which LAS keeps."""
    kind: str = "f4"
    """Type of numpy: f4, f8, u1, u2, u4, i1, i2 or i4."""
    absent: int = 0
    """Number of points that have none."""
    title: str = ""
    """Name in the file that it is from, where LAS keeps that; empty: `name`."""


@dataclass(frozen=True, eq=False)
class Scan:
    """One set-up's measurements."""

    points: Points
    """(n, 3) finite coordinates in the scan frame minus `origin_m` [m]."""
    origin_m: Vector3
    """Local origin: add it to `points` to get the file's coordinates [m]. Zero for near coordinates."""
    name: str = ""
    grid: ScanGrid | None = None
    """Row/column structure, when the file has it."""
    intensity: Floats32 | None = None
    """(n,) as in the file; a range of whole numbers that begins below zero, as of PTS, becomes shares 0 … 1."""
    intensity_scale: float | None = None
    """Largest intensity that the format has, 65535 of LAS; None: it does not say."""
    color: Colors | None = None
    """(n, 3) red, green, blue."""
    times_s: Floats32 | None = None
    """(n,) when each point was measured, from some moment on [s], NaN where its record does not tell; None: the file
    has no times that differ."""
    sensor_m: Vector3 | None = None
    """Where the instrument stood, in the coordinates of `points` [m]; None when the file does not tell."""
    world_from_scan: RigidTransform | None = None
    """Pose stored in the file (maps full coordinates, not reduced ones)."""
    attributes: Mapping[ScalarField, Array] = field(default_factory=dict)
    """(n,) further numbers of the points, which nothing is computed from; empty unless they were asked for."""
    crs_wkt: str | None = None
    """Coordinate reference system of the file's coordinates in metres, WKT 1; None: not told."""
    unit_before: str = ""
    """Unit of the file's coordinates, by name, where they were converted to metres; empty: they were metres."""
    notes: tuple[str, ...] = ()
    """Points and attributes of the file that are not in the scan, in words."""

    def __len__(self) -> int:
        return len(self.points)

    @property
    def bounds_m(self) -> Array:
        """Bounding box in full coordinates, (2, 3): minimum and maximum [m]."""
        return np.asarray(np.stack([self.points.min(axis=0), self.points.max(axis=0)]) + self.origin_m)
