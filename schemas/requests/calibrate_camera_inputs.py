"""Inputs of the process `calibrate-camera`."""

from typing import Annotated, Literal, TypeAlias

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from schemas.values.base import RequestModel
from schemas.values.photos import PhotoReference
from schemas.values.rigid_matrix import RigidMatrix

CalibrationName: TypeAlias = Annotated[str, Field(min_length=1, max_length=200)]
LensName: TypeAlias = Literal["opencv", "brown", "brown-affinity-after"]
LensParameter: TypeAlias = Annotated[str, Field(min_length=1, max_length=2)]
Value: TypeAlias = Annotated[float, Field(ge=-1e9, le=1e9)]
Std: TypeAlias = Annotated[float, Field(gt=0.0, le=1e9)]
Row3: TypeAlias = tuple[float, float, float]
MOST_IMAGE_POINTS = 200_000


class LensRequest(RequestModel):
    """The camera: its format, its model, and what of it is unknown."""

    width: int = Field(ge=16, le=65_536)
    """Columns of the photos [px]."""
    height: int = Field(ge=16, le=65_536)
    """Rows of the photos [px]."""
    model: LensName = "opencv"
    """`opencv`: distortion displaces the ideal point, fx = f (1 + b), fy = f. `brown`: it corrects the measured point
    (x right, y up from x0, y0; px⁻², px⁻⁴, …), the affinity b stretches x before it, or after it."""
    unknown: list[LensParameter] | None = Field(default=None, max_length=12)
    """Parameters that are estimated; null: principal distance and point, k1, k2, p1, p2 or K1, K2, P1, P2."""
    values: dict[LensParameter, Value] = Field(default_factory=dict)
    """Values of an earlier calibration or of the maker: start values, and what constant ones have; missing ones are
    found, or zero."""
    std: dict[LensParameter, Std] = Field(default_factory=dict)
    """Unknown parameters whose given value is an observation with this standard deviation."""
    pixel_um: Annotated[float, Field(gt=0.0, le=1000.0)] | None = None
    """Height of a pixel, for exports in millimetres [µm]."""


class CalibrationTarget(RequestModel):
    """A target; without coordinates it is a free point that the photos determine."""

    name: CalibrationName
    """What image points call it."""
    xyz_m: tuple[Value, Value, Value] | None = None
    """Coordinates [m]; with a mount in the frame of the scanner."""
    std_m: Std | None = None
    """Standard deviation of each coordinate [m]; with neither this nor a covariance they are exact."""
    covariance_m2: tuple[Row3, Row3, Row3] | None = None
    """3x3 [m²], as `find-targets` gives it."""


class CalibrationPhoto(RequestModel):
    """A photo of the field."""

    name: CalibrationName
    """What image points call it."""
    cop_gon: Annotated[float, Field(ge=-800.0, le=800.0)] | None = None
    """Of a camera on a scanner: angle of the head, counter-clockwise seen from above [gon]."""


class CalibrationImagePoint(RequestModel):
    """A target in a photo."""

    photo: CalibrationName
    """Which photo."""
    target: CalibrationName
    """Which target."""
    x: Value
    """Column, 0 at the centre of the leftmost pixel [px]."""
    y: Value
    """Row, 0 at the centre of the topmost pixel [px]."""
    std_px: Annotated[float, Field(gt=0.0, le=1e3)] = 0.1
    """Standard deviation of each [px]."""


class MountRequest(RequestModel):
    """A camera on the head of a scanner, whose angles are known."""

    cop_std_gon: Annotated[float, Field(ge=0.0, le=10.0)] = 0.001
    """Standard deviation of the head angles [gon]; 0: they are exact."""
    mount: RigidMatrix | None = None
    """M_mount of an earlier calibration: camera (right, down, forward) from scan at head angle 0; null: it is found."""
    rotation: Literal["unknown", "observed", "constant"] = "unknown"
    """Its rotation: estimated, estimated with the given one as observation, or held."""
    rotation_std_gon: Std = 0.02
    """Of an observed rotation about each axis of the camera [gon]."""
    translation: Literal["unknown", "observed", "constant"] = "unknown"
    """The same of the projection centre: after re-mounting it may be known."""
    translation_std_m: Std = 0.003
    """Of each observed coordinate [m]."""

    @model_validator(mode="after")
    def _given_where_needed(self) -> "MountRequest":
        if self.mount is None and (self.rotation != "unknown" or self.translation != "unknown"):
            raise PydanticCustomError("mount_missing", "an observed or constant mount needs `mount`")
        return self


class CalibrationField(RequestModel):
    """Targets and where photos show them, layout `calibration-field/1`."""

    format: Literal["calibration-field/1"] = "calibration-field/1"
    """Version of this layout."""
    targets: list[CalibrationTarget] = Field(min_length=1, max_length=100_000)
    """The targets."""
    photos: list[CalibrationPhoto] = Field(min_length=1, max_length=10_000)
    """The photos, all of one camera."""
    image_points: list[CalibrationImagePoint] = Field(min_length=4, max_length=MOST_IMAGE_POINTS)
    """What was measured."""


class CalibrationBoard(RequestModel):
    """A flat board of squares that OpenCV finds in photos."""

    kind: Literal["chessboard", "charuco"] = "chessboard"
    """Plain, or with markers in the white squares, so that parts of it do."""
    columns: int = Field(ge=3, le=100)
    """Inner corners along a row of a chessboard; squares of a ChArUco board."""
    rows: int = Field(ge=3, le=100)
    """Inner corners along a column of a chessboard; squares of a ChArUco board."""
    square_m: Annotated[float, Field(gt=0.0, le=10.0)]
    """Side of a square [m]."""
    marker_m: Annotated[float, Field(gt=0.0, le=10.0)] | None = None
    """Side of a marker [m]."""
    dictionary: Literal["4X4_50", "4X4_250", "5X5_100", "5X5_250", "6X6_250", "7X7_250"] = "5X5_250"
    """Markers."""
    std_px: Annotated[float, Field(gt=0.0, le=1e3)] = 0.1
    """Standard deviation of a corner [px]."""
    bent: bool = False
    """Whether the board may be bent: a parabola across and one along it are estimated too."""

    @model_validator(mode="after")
    def _markers(self) -> "CalibrationBoard":
        if self.kind == "charuco" and (self.marker_m is None or self.marker_m >= self.square_m):
            raise PydanticCustomError("marker_size", "a ChArUco board needs `marker_m`, below `square_m`")
        return self


class EarlierCamera(RequestModel):
    """A camera of the same model to compare with."""

    values: dict[LensParameter, Value]
    """All its parameters; missing ones are zero."""
    std: dict[LensParameter, Std] = Field(default_factory=dict)
    """Their standard deviations; missing ones are exact."""


class CalibrateCameraInputs(RequestModel):
    """Image points of a target field, or photos of a board, and what is known of the camera."""

    field: CalibrationField | None = Field(default=None, title="Target field")
    """Targets, photos and image points; or `photos` and `board` instead."""
    photos: list[PhotoReference] = Field(default_factory=list, max_length=1000, title="Photos of a board")
    """Photos in which the board is looked for."""
    board: CalibrationBoard | None = Field(default=None, title="Board")
    """The board in `photos`."""
    camera: LensRequest = Field(title="Camera")
    """The camera, and what of it is unknown."""
    mount: MountRequest | None = Field(default=None, title="Mount")
    """Of a camera on a scanner whose photos were taken at head angles; null: every photo has a pose of its own."""
    earlier: EarlierCamera | None = Field(default=None, title="Earlier calibration")
    """What the result is tested against; it takes no part in the calibration."""
    scaled_stds: bool = Field(default=True, title="Scaled standard deviations")
    """Whether standard deviations of image points are multiplied by what their residuals say of them."""
    gross_errors: bool = Field(default=True, title="Gross errors")
    """Whether image points that fail their test are left out."""
    alpha: Annotated[float, Field(gt=0.0, lt=0.5)] = Field(default=0.001, title="Level of tests")
    """Probability that a good image point, or a parameter that is zero, fails its test."""
    distances_m: list[Annotated[float, Field(gt=0.0, le=1e6)]] = Field(
        default_factory=lambda: [10.0, 50.0], min_length=1, max_length=10, title="Distances"
    )
    """At which the uncertainty of the projection is told [m]."""

    @model_validator(mode="after")
    def _one_kind(self) -> "CalibrateCameraInputs":
        if (self.field is None) == (self.board is None):
            raise PydanticCustomError("field_or_board", "give either `field`, or `board` and `photos`")
        if (self.board is None) != (not self.photos):
            raise PydanticCustomError("board_photos", "`board` and `photos` belong together")
        if self.board is not None and self.mount is not None:
            raise PydanticCustomError("board_mount", "a board says nothing of the mount: give a `field`")
        return self
