"""A scan of a file as a cloud that is read piece by piece, each time it is needed."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from algorithms.arrays import Array, Vector3
from algorithms.progress import NoProgress, Progress
from algorithms.scans.scan import ScalarField
from service.formats import NO_LIMITS, reader_of
from service.formats.base import ReadLimits, ScanFile, ScanReader, ScanRecords
from service.formats.finishing import (
    LARGEST_COORDINATE_M,
    SPARSEST_GRID,
    finite,
    in_metres,
    local_origin,
    none_left,
    reading_notes,
)
from service.formats.intensities import (
    SignedRange,
    in_unsigned_range,
    limits_of,
    range_in_words,
    signed_range,
)
from service.formats.writers.base import CloudFacts, PointPiece, StationCloud


def stream_scan(
    file: ScanFile, index: int = 0, limits: ReadLimits = NO_LIMITS, progress: Progress | None = None
) -> StationCloud:
    """Read a scan once to learn its extent; give a cloud that reads it again whenever its points are needed.

    Coordinates are converted to metres, records without a return or with a coordinate that is not finite are left out,
    as `read_scan` does. The cloud keeps the pose of the file; `dataclasses.replace` gives it another one.

    Parameters
    ----------
    file
        The file with what its owner says of its columns and its unit.
    index
        Number of the scan in the file.
    limits
        How much it may ask for.
    progress
        Told how far the first reading is.

    Raises
    ------
    UnreadableFileError
        The file cannot be used, or holds no usable points under that index.
    FileTooLargeError
        The scan has more points than `limits` allow.
    """
    reader = reader_of(file)
    survey = Survey()
    with np.errstate(all="ignore"):  # absurd numbers are found by looking at them, not by a warning
        for records in reader.pieces(file, limits, index):
            survey.see(usable(in_metres(file, records, f"scan {index}")))
            (progress or NoProgress()).report(0.5, f"reading {file.filename}")
    first = survey.first
    if first is None or survey.points == 0:
        none = none_left(survey.left_out) if survey.left_out else "the file holds no points under this index"
        raise file.unreadable(none, f"scan {index}")
    survey.refuse_absurd(file, f"scan {index}")
    grid = survey.grid
    origin_m = local_origin(survey.low_m, survey.high_m)
    seen = survey.intensity_limits
    below_zero = signed_range(seen)
    stream = _Stream(reader, file, limits, index, origin_m, grid, tuple(survey.fields), below_zero)
    return StationCloud(
        name=first.name,
        pieces=stream.pieces,
        origin_m=origin_m,
        world_from_scan=first.world_from_scan,
        has_intensity=survey.has_intensity,
        intensity_scale=first.intensity_scale,
        has_color=survey.has_color,
        scalars=stream.fields,
        rows=None if grid is None else grid.rows,
        columns=None if grid is None else grid.columns,
        sensor_in_scan_m=first.sensor_in_scan_m,
        facts=CloudFacts(survey.points, survey.low_m, survey.high_m, _shared(seen, below_zero)),
        crs_wkt=first.crs_wkt,
        notes=(*reading_notes(file, replace(first, left_out=survey.left_out)), *range_in_words(seen)),
    )


def _shared(limits: tuple[float, float] | None, below_zero: SignedRange | None) -> tuple[float, float] | None:
    """Return least and largest of what the stream gives."""
    if limits is None or below_zero is None:
        return limits
    return limits_of(below_zero.shares(np.array(limits, dtype=np.float32)))


@dataclass(frozen=True)
class _Grid:
    first_row: int
    first_column: int
    rows: int
    columns: int


@dataclass
class Survey:
    """What is learnt of a scan in one reading."""

    first: ScanRecords | None = None
    points: int = 0
    low_m: Vector3 = field(default_factory=lambda: np.full(3, np.inf))
    """Full coordinates [m]."""
    high_m: Vector3 = field(default_factory=lambda: np.full(3, -np.inf))
    has_intensity: bool = False
    has_color: bool = False
    fields: dict[ScalarField, None] = field(default_factory=dict)
    """Attributes that any piece has, in order."""
    left_out: Counter[str] = field(default_factory=Counter)
    """Records that the file marks as not to be used, by reason."""
    point_sources: frozenset[int] | None = None
    """Of all pieces; None: the format has none."""
    gps_time_s: tuple[float, float] | None = None
    """Least and largest; None: the file has no times, or not of all pieces."""
    _least: float = np.inf
    _largest: float = -np.inf
    _low_cell: Array = field(default_factory=lambda: np.full(2, np.iinfo(np.int64).max))
    _high_cell: Array = field(default_factory=lambda: np.full(2, np.iinfo(np.int64).min))

    def see(self, records: ScanRecords) -> None:
        """Take a piece into account."""
        if self.first is None:
            self.first = replace(records, points=records.points[:0], attributes={})
            self.gps_time_s = records.gps_time_s
        self.gps_time_s = _both(self.gps_time_s, records.gps_time_s)
        self.left_out.update(records.left_out)
        if records.point_sources is not None:
            self.point_sources = (self.point_sources or frozenset()) | records.point_sources
        self.fields.update(dict.fromkeys(records.attributes))
        self.has_intensity |= records.intensity is not None
        self.has_color |= records.color is not None
        if len(records.points) == 0:
            return
        self.points += len(records.points)
        base_m = np.zeros(3) if records.base_m is None else records.base_m
        for axis in range(3):
            self.low_m[axis] = min(self.low_m[axis], records.points[:, axis].min() + base_m[axis])
            self.high_m[axis] = max(self.high_m[axis], records.points[:, axis].max() + base_m[axis])
        if records.intensity is not None:
            least, largest = limits_of(records.intensity) or (np.inf, -np.inf)
            self._least, self._largest = min(self._least, least), max(self._largest, largest)
        if records.row is not None and records.column is not None:
            cells = (records.row, records.column)
            self._low_cell = np.minimum(self._low_cell, [int(each.min()) for each in cells])
            self._high_cell = np.maximum(self._high_cell, [int(each.max()) for each in cells])

    def refuse_absurd(self, file: ScanFile, place: str) -> None:
        """Refuse coordinates that are no lengths.

        Raises
        ------
        UnreadableFileError
            One lies beyond `LARGEST_COORDINATE_M`.
        """
        largest_m = float(np.abs([self.low_m, self.high_m]).max())
        if largest_m > LARGEST_COORDINATE_M:
            raise file.unreadable(f"a coordinate of {largest_m:.6g} m is beyond {LARGEST_COORDINATE_M:.0e} m", place)

    @property
    def intensity_limits(self) -> tuple[float, float] | None:
        """Least and largest intensity."""
        return (self._least, self._largest) if np.isfinite([self._least, self._largest]).all() else None

    @property
    def grid(self) -> _Grid | None:
        """The grid, if there is one with enough points in it."""
        if (self._low_cell > self._high_cell).any():
            return None
        rows, columns = (self._high_cell - self._low_cell + 1).tolist()
        if rows < 2 or columns < 2 or self.points < SPARSEST_GRID * rows * columns:
            return None
        return _Grid(int(self._low_cell[0]), int(self._low_cell[1]), rows, columns)


def _both(first: tuple[float, float] | None, second: tuple[float, float] | None) -> tuple[float, float] | None:
    return None if first is None or second is None else (min(first[0], second[0]), max(first[1], second[1]))


@dataclass(frozen=True, eq=False)
class _Stream:
    reader: ScanReader
    file: ScanFile
    limits: ReadLimits
    index: int
    origin_m: Vector3
    grid: _Grid | None
    fields: tuple[ScalarField, ...]
    below_zero: SignedRange | None

    def pieces(self) -> Iterator[PointPiece]:
        """Read the scan from its first record on."""
        for records in self.reader.pieces(self.file, self.limits, self.index):
            found = usable(in_metres(self.file, records, f"scan {self.index}"))
            base_m = np.zeros(3) if found.base_m is None else found.base_m
            row = column = None
            if self.grid is not None and found.row is not None and found.column is not None:
                row, column = found.row - self.grid.first_row, found.column - self.grid.first_column
            own = {each.name: values for each, values in found.attributes.items()}
            intensity = in_unsigned_range(found.intensity, self.below_zero)
            yield PointPiece(found.points + (base_m - self.origin_m), intensity, found.color, row, column, own)


def usable(records: ScanRecords) -> ScanRecords:
    """Leave out what is no measured point."""
    keep = finite(records.points)
    if records.valid is not None:
        keep &= records.valid
    if keep.all():
        return records
    return replace(
        records,
        points=records.points[keep],
        valid=None,
        row=None if records.row is None else records.row[keep],
        column=None if records.column is None else records.column[keep],
        intensity=None if records.intensity is None else records.intensity[keep],
        color=None if records.color is None else records.color[keep],
        attributes={each: values[keep] for each, values in records.attributes.items()},
    )
