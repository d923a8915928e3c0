"""Result document of the process `calibrate-camera`."""

from typing import Any, TypeAlias

from schemas.results.registration_result import Artifact
from schemas.values.poses import Document

Pixel: TypeAlias = tuple[float, float]
Vector: TypeAlias = tuple[float, float, float]
Row4: TypeAlias = tuple[float, float, float, float]


class CalibratedParameter(Document):
    """A parameter of the camera."""

    name: str
    """Which; `bend across` and `bend along` are of the board [m]."""
    value: float
    """Its value."""
    std: float | None
    """Standard deviation; null: constant."""
    significant: bool | None
    """Whether it differs from zero at the level of the tests; null: constant."""
    p_value: float | None
    """Probability of a value so far from zero when it is zero."""


class CorrelatedParameters(Document):
    """Two parameters that can hardly be told apart."""

    first: str
    """Parameter of camera or mount."""
    second: str
    """Parameter of camera or mount."""
    correlation: float
    """Coefficient, beyond ±0.9."""


class CalibratedCamera(Document):
    """Interior orientation as requests have it."""

    model: str
    """`brown`."""
    width: int
    """Columns [px]."""
    height: int
    """Rows [px]."""
    fx: float
    """[px]."""
    fy: float
    """[px]."""
    cx: float
    """[px]."""
    cy: float
    """[px]."""
    k1: float
    """Radial."""
    k2: float
    """Radial."""
    k3: float
    """Radial."""
    p1: float
    """Tangential."""
    p2: float
    """Tangential."""


class CameraExport(Document):
    """The camera in another model, fitted over the whole format."""

    model: str
    """Which."""
    parameters: dict[str, float]
    """Of that model."""
    largest_difference_px: float
    """By how much it misses the calibrated one somewhere in the format [px]."""


class MountEffect(Document):
    """What the errors of the mount do to a point on the axis of the camera."""

    distance_m: float
    """From the camera [m]."""
    std_mm: float
    """Standard deviation in the worst direction [mm]."""


class CalibratedMount(Document):
    """Where the camera sits on the head."""

    mount: tuple[Row4, Row4, Row4, Row4]
    """M_mount: camera (right, down, forward) from scan at head angle 0, 4x4."""
    head_from_camera: tuple[Row4, Row4, Row4, Row4]
    """Its inverse: the camera in the frame of the scanner at head angle 0."""
    std_gon: Vector | None
    """Of the rotation about the axes of the camera [gon]; null: constant."""
    std_m: Vector | None
    """Of the projection centre in the frame of the head [m]; null: constant."""
    covariance: list[list[float]]
    """6x6 of (rotation vector about the axes of the camera [rad], projection centre [m])."""
    effects: list[MountEffect]
    """At the distances that were asked for."""


class ProjectionUncertainty(Document):
    """How sure the camera projects points that are fixed to the targets, over its format."""

    distance_m: float
    """Of the points from the camera [m]."""
    image: list[Pixel]
    """Columns and rows [px]."""
    std_px: list[float]
    """Standard deviation in the worst direction [px]."""
    std_mm: list[float]
    """The same across the ray at that distance [mm]."""


class HalvesDocument(Document):
    """Two calibrations, each from every other photo, against each other."""

    done: bool
    """Whether both halves determine the camera."""
    reason: str | None
    """Why not."""
    ratio: float | None
    """Root mean square of the differences of rays over what the covariances let expect; 1 is usual."""
    verdict: str | None
    """`agree`, or `differ`: above 2 the model or the standard deviations miss something."""
    image: list[Pixel]
    """Columns and rows [px]."""
    differences_px: list[Pixel]
    """Second minus first, after the turn that brings both nearest [px]."""
    expected_px: list[float]
    """What is expected of their lengths [px]."""


class FormatCell(Document):
    """A part of the format."""

    centre: Pixel
    """Column and row [px]."""
    points: int
    """Used image points in it."""
    mean_residual_px: Pixel | None
    """Mean residual, computed minus measured [px]; null: no points."""
    rms_px: float | None
    """Root mean square of both components [px]."""
    systematic: bool
    """Whether the mean differs from zero at the level of the tests, shared among all cells."""


class CoverageDocument(Document):
    """Where in the format targets were seen."""

    share: float
    """Share of the cells with at least one point."""
    empty: list[str]
    """Corners and borders without any."""
    cells: list[FormatCell]
    """All parts, row by row."""


class PhotoResiduals(Document):
    """A photo."""

    name: str
    """Which."""
    points: int
    """Used image points."""
    rms_px: float
    """Root mean square length of their residuals [px]."""


class WorstPoint(Document):
    """An image point that fits badly, or was left out."""

    photo: str
    """Which photo."""
    target: str
    """Which target."""
    residual_px: Pixel
    """Computed minus measured [px]."""
    statistic: float
    """T with 2 degrees of freedom."""
    p_value: float
    """Probability of a larger one."""
    used: bool
    """Whether it took part."""


class ChangedParameter(Document):
    """A parameter before and after."""

    name: str
    """Which."""
    before: float
    """Of the earlier calibration."""
    after: float
    """Now."""
    std: float
    """Of the difference."""


class BeforeAfterDocument(Document):
    """Test of this calibration against an earlier one."""

    parameters: list[ChangedParameter]
    """All estimated ones."""
    statistic: float
    """T of all differences together."""
    degrees_of_freedom: int
    """Of T."""
    p_value: float
    """Probability of a larger T when nothing changed."""
    changed: bool
    """Whether the camera changed, at the level of the tests."""
    largest_difference_px: float
    """Of rays, after the turn that brings both cameras nearest [px]."""


class CalibrationProvenance(Document):
    """What was done with what."""

    software: str
    """Program and version."""
    options: dict[str, Any]
    """All options as used, without the image points."""
    timings_s: dict[str, float]
    """What took how long."""


class CalibrationDocument(Document):
    """A calibrated camera with what is sure about it."""

    model: str
    """Lens model."""
    observations: int
    """Used numbers."""
    unknowns: int
    """Of camera, mount, photos and targets."""
    redundancy: int
    """Degrees of freedom."""
    sigma0: float | None
    """A posteriori, with the standard deviations used; null: no redundancy."""
    rms_px: float
    """Root mean square length of the residuals of used image points, as OpenCV tells it [px]."""
    image_std_px: float
    """Median standard deviation of image coordinates as used [px]."""
    std_factor: float
    """By what those given were multiplied."""
    parameters: list[CalibratedParameter]
    """The camera's, in the order of its model, then bends of the board."""
    covariance: list[list[float]]
    """Of the estimated parameters of camera and mount, in the order of `covariance_of`."""
    covariance_of: list[str]
    """Its rows."""
    correlations: list[CorrelatedParameters]
    """Beyond ±0.9, the most first."""
    camera: CalibratedCamera
    """As `camera` of a photo in other requests, fitted where the model is another."""
    exports: list[CameraExport]
    """In other models."""
    mount: CalibratedMount | None
    """Of a camera on a scanner."""
    projection: list[ProjectionUncertainty]
    """At the distances that were asked for."""
    halves: HalvesDocument
    """Cross-validation."""
    coverage: CoverageDocument
    """Format and residuals."""
    photos: list[PhotoResiduals]
    """All photos."""
    worst: list[WorstPoint]
    """Left out ones first, then those that fit worst."""
    before_after: BeforeAfterDocument | None
    """Test against `earlier`."""
    artifacts: list[Artifact]
    """Downloads."""
    remarks: list[str]
    """What else to know."""
    provenance: CalibrationProvenance
    """What was done with what."""
