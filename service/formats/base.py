"""What a reader of scan files is, and what it hands over."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Colors, Flags, Floats32, Matrix4, Points, Vector3
from algorithms.scans.content import ScanContent
from algorithms.scans.scan import ScalarField
from service.errors import UnreadableFileError
from service.formats.instruments import Instrument
from service.formats.point_selection import USUAL_POINTS, PointSelection
from service.formats.units import DeclaredUnit

RECORDS_AT_ONCE = 1 << 19
"""Records of a piece."""
RECORDS_IN_MEMORY = 30_000_000
"""Scans with more are inspected piece by piece, and their features come from a part of the points."""


@dataclass(frozen=True)
class ReadLimits:
    """How much one file may ask for."""

    max_points: int = 200_000_000
    """Records per scan."""
    max_scans: int = 10_000
    """Scans per file, and photos per file."""
    max_pixels: int = 100_000_000
    """Pixels per photo."""
    at_once: int = RECORDS_IN_MEMORY
    """Records of a scan up to which `ScanReader.scans` gives it whole."""


@dataclass(frozen=True)
class ScanFile:
    """A stored file and the name its owner gave it."""

    path: Path
    filename: str
    """The name for messages; the stored file is usually called otherwise."""
    columns: str = ""
    """What its owner says the columns of a text table are, checked (`schemas.values.text_columns`); empty: nothing."""
    unit: str = ""
    """In which unit its owner says that the coordinates are, by name; empty: nothing."""
    selection: PointSelection = USUAL_POINTS
    """Points that are used, of formats that tell flags, classes and returns."""
    attributes: bool = False
    """Whether attributes of points are read, which nothing is computed from."""

    def unreadable(self, reason: str, place: str = "") -> UnreadableFileError:
        """Build the error that names this file."""
        return UnreadableFileError(self.filename, reason, place)

    @property
    def size(self) -> int:
        """Length of the file in bytes."""
        return self.path.stat().st_size


@dataclass(frozen=True, eq=False)
class ScanRecords:
    """One scan as its file holds it: every record, also those without a return."""

    index: int
    """Number of the scan in its file, from 0."""
    points: Points
    """(n, 3) coordinates in the scan frame minus `base_m` [m]; may hold NaN or inf. The receiver may overwrite it."""
    base_m: Vector3 | None = None
    """What was already subtracted (formats that store integers and an offset); None is zero."""
    name: str = ""
    valid: Flags | None = None
    """(n,) False for records without a return, and for those that the file marks as not to be used; None: all are
    meant as returns."""
    left_out: Mapping[str, int] = field(default_factory=dict)
    """Records that are not `valid` because the file marks them, counted by reason."""
    attributes: Mapping[ScalarField, Array] = field(default_factory=dict)
    """(n,) further numbers of the records, where `ScanFile.attributes` asks for them."""
    crs_wkt: str | None = None
    """Coordinate reference system of the coordinates in metres, WKT 1; None: not told."""
    lost: tuple[str, ...] = ()
    """What the file has beside that and was not read, in words."""
    row: Array | None = None
    """(n,) integer row of each record; given together with `column`."""
    column: Array | None = None
    intensity: Floats32 | None = None
    intensity_scale: float | None = None
    """Largest intensity that the format has; None: it does not say."""
    color: Colors | None = None
    sensor_in_scan_m: Vector3 | None = None
    """Where the format says the instrument stood, full coordinates [m]; None when it does not say."""
    world_from_scan: RigidTransform | None = None
    unit: DeclaredUnit | None = None
    """In which unit the file says that coordinates are; None: it does not say. It holds for all lengths."""
    open_unit: str = ""
    """Why nobody can tell the unit unless the owner states it; empty: it can be told."""
    text_columns: str | None = None
    """What the columns of a text table were taken for."""
    warnings: tuple[str, ...] = ()
    """What looks wrong, for people."""
    instrument: Instrument | None = None
    """What the file says of instrument and time; None: nothing."""
    gps_time_s: tuple[float, float] | None = None
    """Least and largest time of a point; None: the file has no times."""
    point_sources: frozenset[int] | None = None
    """Flight lines that the points name as their source; None: the format has none."""
    times_s: Floats32 | None = None
    """(n,) when each record was measured, from some moment on [s], NaN where it does not tell; None: the file has no
    times, or all are the same, or the records come in pieces."""


@dataclass(frozen=True)
class RefusedScan:
    """A scan of a file that cannot be used, while others of it may be."""

    index: int
    name: str
    error: UnreadableFileError


@dataclass(frozen=True)
class LargeScan:
    """A scan with more records than may be in memory at once; `ScanReader.pieces` gives it."""

    index: int
    records: int


@dataclass(frozen=True, eq=False)
class ScanInfo:
    """What a file document tells about one scan. Every figure is counted from the records, not copied from a header."""

    index: int
    name: str
    points: int
    """Usable points: finite coordinates with a return."""
    dropped: int
    """Records without a return or without finite coordinates."""
    structured: bool
    rows: int | None
    columns: int | None
    bounds_m: Array | None
    """(2, 3) minimum and maximum in full coordinates [m]; None for a scan that cannot be used."""
    has_intensity: bool
    has_color: bool
    scan_pose: Matrix4 | None
    """4x4 world from scan as the file stores it, or None."""
    warnings: tuple[str, ...] = ()
    """What looks wrong with the scan, or was changed in reading it, for people."""
    content: ScanContent | None = None
    """Moments by which the same scan is known again; None: not computed."""
    usable: bool = True
    reason: str | None = None
    """Why the scan cannot be used; None: it can."""
    unit: str | None = None
    """In which unit the file says that its coordinates are; None: it does not say."""
    open_unit: str | None = None
    """Why the unit must be stated where the scan is used; None: it need not."""
    text_columns: str | None = None
    """What the columns of a text table were taken for."""
    instrument: Instrument | None = None
    """What the file says of instrument and time; None: nothing."""
    gps_time_s: tuple[float, float] | None = None
    """Least and largest time of a point; None: the file has no times."""
    point_sources: int | None = None
    """Number of flight lines that the points name as their source; None: the format has none."""
    geocentric: str | None = None
    """Why z is no height: the coordinates are geocentric; None: it may be one."""

    def to_json(self) -> dict[str, Any]:
        """Give the members as plain JSON values."""
        return {
            "index": self.index,
            "name": self.name,
            "points": self.points,
            "dropped": self.dropped,
            "structured": self.structured,
            "rows": self.rows,
            "columns": self.columns,
            "bounds_m": None if self.bounds_m is None else self.bounds_m.tolist(),
            "has_intensity": self.has_intensity,
            "has_color": self.has_color,
            "scan_pose": None if self.scan_pose is None else self.scan_pose.tolist(),
            "warnings": list(self.warnings),
            "content": None if self.content is None else self.content.to_json(),
            "usable": self.usable,
            "reason": self.reason,
            "unit": self.unit,
            "open_unit": self.open_unit,
            "text_columns": self.text_columns,
            "instrument": None if self.instrument is None else self.instrument.to_json(),
            "gps_time_s": None if self.gps_time_s is None else list(self.gps_time_s),
            "point_sources": self.point_sources,
            "geocentric": self.geocentric,
        }


class ScanReader(Protocol):
    """A file format that holds scans."""

    @property
    def name(self) -> str:
        """Name of the format as users know it."""
        ...

    @property
    def extensions(self) -> tuple[str, ...]:
        """Endings of file names, lower case, with the dot."""
        ...

    @property
    def signed(self) -> bool:
        """Whether `sniff` recognises a signature that proves the format whatever the file is called."""
        ...

    def sniff(self, head: bytes) -> bool:
        """Tell from the first bytes whether a file claims to be of this format."""
        ...

    def complaint(self, head: bytes) -> str:
        """Tell why a file that is called like this format, and begins with `head`, is none; empty: that is all."""
        ...

    def scans(
        self, file: ScanFile, limits: ReadLimits, wanted: int | None = None
    ) -> Iterator[ScanRecords | RefusedScan | LargeScan]:
        """Yield the scans of a file in order, or only the one wanted (nothing if there is no such scan).

        Of a format that holds several scans, one that is damaged or empty is yielded as refused, and others follow.
        Formats that large scans come in (E57, LAS) yield one with more records than `limits.at_once` as large.

        Raises
        ------
        UnreadableFileError
            The file breaks its own format, or declares more than its length can hold.
        FileTooLargeError
            A scan exceeds `limits`.
        """
        ...

    def pieces(self, file: ScanFile, limits: ReadLimits, index: int) -> Iterator[ScanRecords]:
        """Yield one scan piece by piece, so that it is never whole in memory; nothing if there is no such scan.

        Each piece has what `scans` would say of its records; an intensity or a colour that a piece lacks is zero.

        Raises
        ------
        UnreadableFileError, FileTooLargeError
            As `scans` does.
        """
        ...


def cut(records: ScanRecords | RefusedScan) -> Iterator[ScanRecords]:
    """Yield a scan that is in memory piece by piece.

    Raises
    ------
    UnreadableFileError
        It cannot be used.
    """
    if isinstance(records, RefusedScan):
        raise records.error
    for start in range(0, len(records.points), RECORDS_AT_ONCE):
        part = slice(start, start + RECORDS_AT_ONCE)
        yield replace(
            records,
            times_s=None,
            points=records.points[part].copy(),
            attributes={each: values[part] for each, values in records.attributes.items()},
            valid=None if records.valid is None else records.valid[part],
            row=None if records.row is None else records.row[part],
            column=None if records.column is None else records.column[part],
            intensity=None if records.intensity is None else records.intensity[part],
            color=None if records.color is None else records.color[part],
        )
