"""Result document of the process `calibrate-mount`."""

from typing import Any, Literal, TypeAlias

from schemas.results.registration_result import Artifact
from schemas.values.poses import Document

Vector: TypeAlias = tuple[float, float, float]
Row4: TypeAlias = tuple[float, float, float, float]
Matrix4: TypeAlias = tuple[Row4, Row4, Row4, Row4]


class MountParameter(Document):
    """A rotation or a coordinate of a mount, in the axes of the camera: x right, y down, z forward."""

    name: str
    """Which."""
    unit: Literal["gon", "mm"]
    """Of the figures."""
    value: float | None
    """Correction of the stated value; null: not determined."""
    std: float | None
    """Its standard deviation; null: not determined."""
    detectable: float | None
    """An error of it alone is found from this size on with a probability of 80 %; null: never."""


class OpenMount(Document):
    """A combination of parameters that the edges do not tell."""

    parameters: dict[str, float]
    """Names and shares, the largest first; shifts in millimetres and rotations in milligon."""
    advice: str
    """What to add."""


class MountChange(Document):
    """What the correction does to a point on the axis of the camera, and how sure it is."""

    distance_m: float
    """From the camera [m]."""
    change_mm: float
    """By how much the point moves [mm]."""
    std_mm: float
    """Standard deviation of the corrected point in the worst direction [mm]."""


class FoundMountDocument(Document):
    """What the edges tell of a mount."""

    name: str
    """`camera 1`, `camera 2` in the order of the photos, or the photo."""
    photos: list[str]
    """Whose mount it is: station and number of the photo there, from 1."""
    status: Literal["confirmed", "wrong", "ambiguous", "undetermined"]
    """`confirmed`: the edges do not contradict the stated mount; `wrong`: they do, and the correction is given;
    `ambiguous`: another place explains them nearly as well; `undetermined`: too few edges or of too few directions."""
    text: str
    """The same in words."""
    parameters: list[MountParameter]
    """Three rotations and three shifts."""
    covariance: list[list[float]]
    """6x6 of the correction (rotation vector [rad], shift [m]) in the axes of the camera."""
    correction: Matrix4
    """4x4: the true pose scan_from_camera is the stated one times this."""
    mount: Matrix4 | None
    """Corrected M_mount (camera, right-down-forward, from scan at head angle 0) where photos state one; null else."""
    open: list[OpenMount]
    """What is not determined."""
    statistic: float | None
    """T of the stated mount; null: nothing is determined."""
    degrees_of_freedom: int
    """Of T."""
    critical: float | None
    """Limit of T."""
    allowed_by_std: bool | None
    """Whether the stated `mount_std` allows for the error; null: nothing is determined."""
    edges: int
    """Edges of the photos that show lines of the scans."""
    candidates: int
    """Edges that could have."""
    rivalry: float
    """How well the best other rotation explains the edges: 0 as by chance, 1 as well as this one."""
    median_before_px: float | None
    """Median gap between these edges and lines with the stated mount [px]."""
    median_after_px: float | None
    """The same with the corrected one [px]."""
    changes: list[MountChange]
    """At the distances that were asked for."""


class MountPhoto(Document):
    """What a photo gave."""

    station: str
    """Where it was taken."""
    photo: int
    """Its number there, from 1."""
    file: str
    """Name of its file."""
    edges: int
    """Edges that show lines of the scan."""
    rms_px: float | None
    """Of their gaps after the correction [px]."""
    scan_from_camera: Matrix4
    """Corrected pose in the frame of the file, axes right-down-forward; the stated one where its mount stays."""


class MountsProvenance(Document):
    """Where the result comes from."""

    software: str
    """Name and version."""
    options: dict[str, Any]
    """What was asked for."""
    sha256: list[str]
    """Of the scans' files."""
    timings_s: dict[str, float]
    """Of the steps [s]."""


class MountsDocument(Document):
    """Answer of `calibrate-mount`."""

    mounts: list[FoundMountDocument]
    """One for each camera, or photo."""
    photos: list[MountPhoto]
    """All photos."""
    lines: list[int]
    """Lines of the scan of each station where two planes meet."""
    variance_factor: float
    """How much larger squared gaps are than stated, at least 1; standard deviations contain it."""
    redundancy: int
    """Of the adjustment."""
    artifacts: list[Artifact]
    """Downloads: `photos.json`, the photo list with corrected poses."""
    remarks: list[str]
    """What to know besides."""
    provenance: MountsProvenance
    """Where it comes from."""
