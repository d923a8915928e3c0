"""Uploaded files and what was found in them."""

from datetime import datetime
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from schemas.values.base import ResponseModel
from schemas.values.instruments import InstrumentDocument
from schemas.values.links import Link


class ScanContentDocument(BaseModel):
    """Moments of the points of a scan."""

    model_config = ConfigDict(extra="allow", frozen=True, use_attribute_docstrings=True)

    points: int
    """Number of points."""
    mean_m: list[float]
    """Mean of the coordinates [m]."""
    scatter_m2: list[list[float]]
    """3×3 covariance of the coordinates [m²]."""


class ScanDocument(BaseModel):
    """One scan of a file."""

    model_config = ConfigDict(extra="allow", frozen=True, use_attribute_docstrings=True)

    index: int
    """Number of the scan in its file, from 0."""
    name: str
    """What the file calls it."""
    points: int
    """Usable points."""
    structured: bool
    """Whether the points are ordered in rows and columns."""
    rows: int | None = None
    """Rows of the raster; null: there is none."""
    columns: int | None = None
    """Columns of the raster; null: there is none."""
    bounds_m: list[list[float]] | None = None
    """Minimum and maximum of the coordinates in the scan frame [m]; null for a scan that cannot be used."""
    has_intensity: bool
    """Whether points have an intensity."""
    has_color: bool
    """Whether points have colours."""
    scan_pose: list[list[float]] | None = None
    """world_from_scan as stored in the file, 4×4 row-major; null when the file has none."""
    warnings: list[str] = []
    """What looks wrong with the scan, or was changed in reading it, such as coordinates that can hardly be metres."""
    content: ScanContentDocument | None = None
    """Moments of all points, by which the same scan is known again in another order or format."""
    usable: bool = True
    """Whether a job may use it."""
    reason: str | None = None
    """Why it cannot be used; null: it can."""
    unit: str | None = None
    """In which unit the file declares its coordinates, such as `us-ft`, from which they are converted to metres; null:
    it declares none, and they are taken for metres unless the request states `unit` with the scan."""
    open_unit: str | None = None
    """Why a request must state `unit` with the scan; null: it need not."""
    text_columns: str | None = None
    """What the columns of a text table were taken for, such as `-,-,x,y,z,i`: as stated, as named in the file, or as
    their numbers show."""
    instrument: InstrumentDocument | None = None
    """What the file says of instrument, serial number and time of measurement; null: nothing."""
    gps_time_s: tuple[float, float] | None = None
    """First and last GPS time of a point, as the file counts it [s]; null: the file has no times."""
    geocentric: str | None = None
    """Why z is no height: the coordinates are geocentric; null: it may be one."""
    point_sources: int | None = None
    """Number of flight lines (point sources) that the points name; null: the format has none."""


class PhotoDocument(BaseModel):
    """One photo of a file."""

    model_config = ConfigDict(extra="allow", frozen=True, use_attribute_docstrings=True)

    index: int
    """Number of the photo in its file, from 0."""
    name: str
    """What the file calls it."""
    width: int
    """Columns [px]."""
    height: int
    """Rows [px]."""
    camera: dict[str, Any] | None = None
    """Interior orientation as a request may repeat it; null: the file does not tell it."""
    scan_from_camera: list[list[float]] | None = None
    """Pose of the camera (x right, y down, z forward) in the frame of the scan `scan`, 4×4 row-major; null: the file
    does not tell it."""
    scan: int | None = None
    """Number of the scan of the same file to whose frame that pose leads."""
    refused: str | None = None
    """Why the photo cannot be used; null: it can."""
    remarks: list[str] = []
    """What the file does not tell of it."""


class FileDocument(ResponseModel):
    """One uploaded file."""

    id: str
    """Identifier, by which requests name it."""
    name: str
    """As its owner called it."""
    bytes: int
    """Size [bytes]."""
    sha256: str
    """Hash of the file's content."""
    format: str
    """Format that was recognised."""
    kind: Literal["scan", "photo", "mesh", "project", "other"]
    """What it holds."""
    scans: list[ScanDocument]
    """The scans in it."""
    photos: list[PhotoDocument]
    """The photos in it."""
    warnings: list[str] = Field(default=[])
    """What looks wrong with its scans, or was changed in reading them, and which of them cannot be used."""
    created: datetime
    """When it was stored."""
    expires: datetime | None
    """When the service may remove it; null: never by itself."""
    links: list[Link]
    """Where to go from here."""


class FileDocuments(ResponseModel):
    """The files of one request."""

    files: list[FileDocument]
    """The files."""


class FileList(ResponseModel):
    """One page of files, newest first."""

    files: list[FileDocument]
    """The files."""
    number_matched: int = Field(serialization_alias="numberMatched")
    """Files on all pages."""
    number_returned: int = Field(serialization_alias="numberReturned")
    """Files on this page."""
    links: list[Link]
    """Where to go from here."""
