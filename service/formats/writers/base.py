"""What a writer of clouds is, and what it is given: stations whose points come piece by piece."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Colors, Floats32, Points, Vector3
from algorithms.geometry.cameras import Camera
from algorithms.progress import Progress
from algorithms.scans.scan import ScalarField, Scan
from service.formats.intensities import limits_of

POINTS_AT_ONCE = 1 << 19
"""Points of a piece."""
STANDARD_DEVIATION = "std_mm"
"""Name of the field with the standard deviation of each point's position [mm]."""
STATION = "station"
"""Name of the field with the number of each point's station, where stations share a file."""


@dataclass(frozen=True, eq=False)
class PointPiece:
    """Some points of a station, in the order in which they were measured or chosen."""

    points: Points
    """(n, 3) finite coordinates in the scan frame minus the `origin_m` of their station [m]."""
    intensity: Floats32 | None = None
    color: Colors | None = None
    row: Array | None = None
    """(n,) integer row of each point in the scanner's grid, from 0; given together with `column`."""
    column: Array | None = None
    scalars: Mapping[str, Array] = field(default_factory=dict)
    """(n,) further numbers by the name of their field."""

    def __len__(self) -> int:
        return len(self.points)


@dataclass(frozen=True, eq=False)
class StationImage:
    """A photo that belongs to a station."""

    name: str
    media_type: str
    """image/jpeg or image/png."""
    width: int
    height: int
    content: Callable[[], bytes]
    """Gives the encoded image."""
    camera: Camera | None = None
    """Interior orientation; None: unknown."""
    scan_from_camera: RigidTransform | None = None


@dataclass(frozen=True, eq=False)
class CloudFacts:
    """What must be known of a cloud before the first point is written."""

    points: int
    low_m: Vector3
    """Least coordinates, scan frame, full [m]."""
    high_m: Vector3
    intensity_limits: tuple[float, float] | None = None
    """Least and largest intensity; None without intensities."""


@dataclass(frozen=True, eq=False)
class StationCloud:
    """The points of one station, never all in memory."""

    name: str
    pieces: Callable[[], Iterator[PointPiece]]
    """Gives the points from the first on, each time it is called."""
    origin_m: Vector3
    """What was subtracted from the coordinates of the pieces [m]."""
    world_from_scan: RigidTransform | None = None
    """Maps full coordinates of the scan frame; None: the points stay where they are."""
    has_intensity: bool = False
    intensity_scale: float | None = None
    """Largest intensity that its format has; None: it does not say."""
    has_color: bool = False
    scalars: tuple[ScalarField, ...] = ()
    """The further numbers that every piece has."""
    rows: int | None = None
    """Of the scanner's grid; None: the pieces have neither row nor column."""
    columns: int | None = None
    sensor_in_scan_m: Vector3 | None = None
    """Where the instrument stood, full coordinates [m]; None: unknown."""
    images: tuple[StationImage, ...] = ()
    facts: CloudFacts | None = None
    """Known beforehand; None: `surveyed` finds out by reading the points once."""
    crs_wkt: str | None = None
    """Coordinate reference system of the world frame as WKT 1; None: unknown."""
    notes: tuple[str, ...] = ()
    """Points and attributes of its file that are not among the pieces, in words."""

    @property
    def pose(self) -> RigidTransform:
        """World from scan; identity where the points stay where they are."""
        return RigidTransform.identity() if self.world_from_scan is None else self.world_from_scan


@dataclass(frozen=True)
class Written:
    """What became of the points."""

    points: int
    notes: tuple[str, ...] = ()
    """What the format could not keep, or was changed for it, for people."""


class ScanWriter(Protocol):
    """A file format to which clouds are written."""

    @property
    def name(self) -> str:
        """Name of the format in requests, small letters."""
        ...

    @property
    def ending(self) -> str:
        """Ending of file names, with the dot."""
        ...

    @property
    def media_type(self) -> str:
        """Media type of the files."""
        ...

    def write(self, path: Path, clouds: Sequence[StationCloud], progress: Progress) -> Written:
        """Write stations into one file, piece by piece.

        Formats with a place for poses keep the points in the scan frame and write the pose; others get the points in
        the world frame.

        Raises
        ------
        UnwritableError
            The format cannot hold these clouds.
        InsufficientStorageError
            The disk is full; nothing remains.
        """
        ...


def surveyed(cloud: StationCloud) -> StationCloud:
    """Give a cloud with its facts, for which its points are read once unless they are known."""
    if cloud.facts is not None:
        return cloud
    points, low_m, high_m = 0, np.full(3, np.inf), np.full(3, -np.inf)
    least, largest = np.inf, -np.inf
    for piece in cloud.pieces():
        if len(piece) == 0:
            continue
        points += len(piece)
        for axis in range(3):  # column by column: reductions over the long axis of a narrow array are slow
            low_m[axis] = min(low_m[axis], piece.points[:, axis].min())
            high_m[axis] = max(high_m[axis], piece.points[:, axis].max())
        if piece.intensity is not None:
            own = limits_of(piece.intensity) or (np.inf, -np.inf)
            least, largest = min(least, own[0]), max(largest, own[1])
    limits = (least, largest) if np.isfinite([least, largest]).all() else None
    if points == 0:
        low_m, high_m = np.zeros(3), np.zeros(3)
    return replace(cloud, facts=CloudFacts(points, low_m + cloud.origin_m, high_m + cloud.origin_m, limits))


def cloud_of(scan: Scan, *, name: str = "") -> StationCloud:
    """Give a scan that is in memory as a cloud."""
    row = column = None
    if scan.grid is not None:
        at_row, at_column = np.nonzero(scan.grid.index >= 0)
        number = scan.grid.index[at_row, at_column]
        if len(number) == len(scan):  # a point outside the grid has no cell
            row, column = np.empty(len(scan), dtype=np.int32), np.empty(len(scan), dtype=np.int32)
            row[number], column[number] = at_row, at_column

    def pieces() -> Iterator[PointPiece]:
        for start in range(0, len(scan), POINTS_AT_ONCE):
            part = slice(start, start + POINTS_AT_ONCE)
            yield PointPiece(
                scan.points[part],
                None if scan.intensity is None else scan.intensity[part],
                None if scan.color is None else scan.color[part],
                None if row is None else row[part],
                None if column is None else column[part],
                {each.name: values[part] for each, values in scan.attributes.items()},
            )

    return StationCloud(
        name=name or scan.name,
        pieces=pieces,
        origin_m=scan.origin_m,
        world_from_scan=scan.world_from_scan,
        has_intensity=scan.intensity is not None,
        intensity_scale=scan.intensity_scale,
        has_color=scan.color is not None,
        scalars=tuple(scan.attributes),
        rows=None if row is None or scan.grid is None else scan.grid.rows,
        columns=None if row is None or scan.grid is None else scan.grid.columns,
        sensor_in_scan_m=None if scan.sensor_m is None else scan.sensor_m + scan.origin_m,
    )
