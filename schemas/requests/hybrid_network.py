"""A hybrid network of scans, photos, control and fictitious observations, layout `hybrid-network/1`."""

from typing import Annotated, Any, Literal, TypeAlias

from pydantic import AliasChoices, BeforeValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from schemas.requests.point_tables import PointTable, as_tuples, point_dictionaries
from schemas.values.base import RequestModel


def _as_text(value: Any) -> Any:
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


NetworkName: TypeAlias = Annotated[str, BeforeValidator(_as_text), Field(min_length=1, max_length=200)]
Number: TypeAlias = Annotated[float, Field(ge=-1e9, le=1e9)]
Std: TypeAlias = Annotated[float, Field(gt=0.0, le=1e9)]
Place: TypeAlias = Annotated[tuple[Number, Number, Number], BeforeValidator(as_tuples)]
"""Arrays of a network come through a validator, and are no longer those of JSON, which strict eyes take for tuples."""
Row3: TypeAlias = tuple[float, float, float]
CameraParameter: TypeAlias = Literal["c", "x0", "y0", "A1", "A2", "A3", "B1", "B2", "C1", "C2"]
ScannerParameter: TypeAlias = Literal["distance_offset", "collimation", "trunnion", "zenith_index"]

LENGTHS = {"m": 1.0, "mm": 1e-3}


class NetworkUnits(RequestModel):
    """Units of the numbers."""

    length: Literal["m"] = "m"
    """Coordinates and distances."""
    angle: Literal["gon", "deg", "rad"] = "gon"
    """All angles and their standard deviations; the result speaks gon."""
    image: Literal["px"] = "px"
    """Image coordinates."""


class NetworkPose(RequestModel):
    """Approximate position and attitude: ω, φ, κ with R = Rx(ω) Ry(φ) Rz(κ), or α, ζ, κ with R = Rz(α) Ry(ζ) Rz(κ)."""

    X: Number
    """Position [m]."""
    Y: Number
    """Position [m]."""
    Z: Number
    """Position [m]."""
    omega: Number | None = None
    """About X."""
    phi: Number | None = None
    """About the turned Y."""
    alpha: Number | None = None
    """About Z."""
    zeta: Number | None = None
    """About the turned Y: nadir angle of a camera that looks along -z."""
    kappa: Number
    """About the turned z."""

    @model_validator(mode="after")
    def _one_kind_of_angles(self) -> "NetworkPose":
        by_omega = self.omega is not None and self.phi is not None
        by_alpha = self.alpha is not None and self.zeta is not None
        if by_omega == by_alpha:
            raise PydanticCustomError("network_angles", "give omega, phi and kappa, or alpha, zeta and kappa")
        return self


class NetworkDistortion(RequestModel):
    """Distortion at x, y from the principal point, r their distance: dx = x (A1 r² + A2 r⁴ + A3 r⁶)
    + B1 (r² + 2x²) + 2 B2 x y + C1 x + C2 y, and dy accordingly; pixels.
    """

    A1: float = 0.0
    """Radial [px⁻²]."""
    A2: float = 0.0
    """Radial [px⁻⁴]."""
    A3: float = 0.0
    """Radial [px⁻⁶]."""
    B1: float = 0.0
    """Tangential [px⁻¹]."""
    B2: float = 0.0
    """Tangential [px⁻¹]."""
    C1: float = 0.0
    """Affinity."""
    C2: float = 0.0
    """Shear."""
    model: Literal["forward", "backward"] = "forward"
    """`forward`: it displaces the ideal point; `backward`: it corrects the measured one."""


class NetworkCamera(RequestModel):
    """Interior orientation of a camera; all of it is constant unless it is named in `unknown` or `std`."""

    id: NetworkName
    """What photos call it."""
    principal_distance_px: Annotated[float, Field(gt=0.0, le=1e9)]
    """c [px]."""
    x0_px: Number = 0.0
    """Principal point [px], in the system of the image coordinates."""
    y0_px: Number = 0.0
    """Principal point [px]."""
    distortion: NetworkDistortion | None = None
    """Null: none."""
    unknown: Annotated[list[CameraParameter], Field(max_length=10)] = Field(default_factory=list)
    """Parameters that are estimated freely."""
    std: dict[CameraParameter, Std] = Field(default_factory=dict)
    """Parameters that are estimated from the given value as an observation with this standard deviation."""
    width_px: Number | None = None
    """For information."""
    height_px: Number | None = None
    """For information."""
    pixel_um: Number | None = None
    """For information."""
    focal_mm: Number | None = None
    """For information."""


class NetworkScanner(RequestModel):
    """Errors of an instrument that several stations share; all are zero unless named."""

    id: NetworkName
    """What stations call it."""
    distance_offset: Number = 0.0
    """Addition constant [m]."""
    collimation: Number = 0.0
    """Adds c / sin(zenith) to horizontal angles."""
    trunnion: Number = 0.0
    """Adds i / tan(zenith) to horizontal angles."""
    zenith_index: Number = 0.0
    """Added to zenith angles."""
    unknown: Annotated[list[ScannerParameter], Field(max_length=4)] = Field(default_factory=list)
    """Errors that are estimated freely."""
    std: dict[ScannerParameter, Std] = Field(default_factory=dict)
    """Errors that are estimated from the given value as an observation with this standard deviation."""


class NetworkMount(RequestModel):
    """Pose of a camera in the frame of the scanner that carries it."""

    id: NetworkName
    """What photos call it."""
    approx: NetworkPose | None = None
    """Station from camera; it must be given unless the mount is unknown."""
    state: Literal["constant", "observed", "unknown"] = "unknown"
    """Whether it is estimated, and whether from the given values as observations."""
    rotation_std: Std | None = None
    """Of an observed mount: each angle, about the camera's axes."""
    translation_std_m: Std | None = None
    """Of an observed mount: each coordinate [m]."""


class NetworkStation(RequestModel):
    """A set-up of a scanner or total station, whose scans share its pose, or a photo."""

    id: NetworkName
    """Its name, unique among stations."""
    type: Literal["scanner", "photo"] = "scanner"
    """What it is."""
    approx: NetworkPose | None = None
    """Approximate pose; null: it is found from common points."""
    camera: NetworkName | None = None
    """Of a photo; null: the only camera."""
    carrier: NetworkName | None = None
    """Of a photo: the scanner station that carried the camera; null: the photo is free."""
    mount: NetworkName | None = None
    """Of a carried photo."""
    scanner: NetworkName | None = None
    """Of a scanner station: its instrument in `scanners`; null: one without errors."""
    point: NetworkName | None = None
    """Of a scanner station: the point above which it is centred."""
    height_m: Number = 0.0
    """Height of the instrument above that point [m]."""
    levelled: bool = False
    """Whether ω = φ = 0 exactly; an inclinometer's readings are observations `tilts` instead."""
    held: bool = False
    """Whether its approximate pose is exact."""


class _Grouped(RequestModel):
    group: NetworkName | None = None
    """Group of equal precision for the table of groups and variance components; null: type and standard deviation."""


class PolarObservation(_Grouped):
    """Direction and distance of a point from a station; each part may be missing."""

    station: NetworkName
    """Where it was measured."""
    scan: NetworkName | None = None
    """Which scan of the station."""
    point: NetworkName
    """What was measured."""
    horizontal: Number | None = None
    """From x towards y, mathematically positive."""
    sigma_horizontal: Std | None = None
    """Its standard deviation."""
    zenith: Number | None = None
    """From z."""
    sigma_zenith: Std | None = None
    """Its standard deviation."""
    distance: Annotated[float, Field(gt=0.0, le=1e9)] | None = None
    """Slope distance [m]."""
    sigma_distance: Std | None = None
    """Its standard deviation [m]."""
    height_m: Number = 0.0
    """Height of the target above its point [m]."""

    @model_validator(mode="after")
    def _with_stds(self) -> "PolarObservation":
        _require_std("horizontal", self.horizontal, self.sigma_horizontal)
        _require_std("zenith", self.zenith, self.sigma_zenith)
        _require_std("distance", self.distance, self.sigma_distance)
        return self


class ImageObservation(_Grouped):
    """A point in a photo, x to the right and y up; each part may be missing."""

    photo: NetworkName
    """The photo."""
    point: NetworkName
    """What was measured."""
    x: Number | None = None
    """[px]."""
    sigma_x: Std | None = None
    """Its standard deviation [px]."""
    y: Number | None = None
    """[px]."""
    sigma_y: Std | None = None
    """Its standard deviation [px]."""

    @model_validator(mode="after")
    def _with_stds(self) -> "ImageObservation":
        _require_std("x", self.x, self.sigma_x)
        _require_std("y", self.y, self.sigma_y)
        return self


def _require_std(name: str, value: float | None, std: float | None) -> None:
    if value is not None and std is None:
        raise PydanticCustomError("missing_std", "{name} needs its standard deviation sigma_{name}", {"name": name})


class _Spatial(_Grouped):
    """Three numbers with their precision."""

    std: Std | tuple[Std, Std, Std] | None = Field(default=None, validation_alias=AliasChoices("std", "sigma"))
    """Standard deviation of all three, or of each [m]."""
    covariance: tuple[Row3, Row3, Row3] | None = None
    """3x3 [m²], instead of `std`."""

    @model_validator(mode="before")
    @classmethod
    def _gathered(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        for names, whole in (
            (("x", "y", "z"), "xyz"), (("X", "Y", "Z"), "xyz"), (("dx", "dy", "dz"), "xyz"),
            (("sigma_x", "sigma_y", "sigma_z"), "std"),
        ):  # fmt: skip
            if all(name in data for name in names):
                data = {key: value for key, value in data.items() if key not in names} | {
                    whole: [data[n] for n in names]
                }
        # what a validator gives on is no longer JSON, whose arrays are tuples to strict eyes
        return {key: as_tuples(value) for key, value in data.items()}


class StationCoordinatesObservation(_Spatial):
    """A point in the frame of a station, as tie points with covariance are."""

    station: NetworkName
    """In whose frame."""
    scan: NetworkName | None = None
    """Which scan of the station."""
    point: NetworkName
    """What was measured."""
    xyz: Place = Field(validation_alias=AliasChoices("xyz", "xyz_m"))
    """Coordinates [m]; also as x, y, z."""

    @model_validator(mode="after")
    def _precise(self) -> "StationCoordinatesObservation":
        _require_one_precision(self)
        return self


class ControlObservation(_Spatial):
    """A known point."""

    point: NetworkName = Field(validation_alias=AliasChoices("point", "name", "id"))
    """Which point."""
    xyz: Place = Field(validation_alias=AliasChoices("xyz", "xyz_m"))
    """Coordinates in the world [m]; also as x, y, z."""
    held: bool = False
    """Whether they are exact; otherwise `std` or `covariance`."""
    use: Literal["control", "check"] = "control"
    """`check`: it takes no part, and the result tells by how much it is missed."""

    @model_validator(mode="after")
    def _precise(self) -> "ControlObservation":
        if self.held or self.use == "check":
            if self.held and (self.std is not None or self.covariance is not None):
                raise PydanticCustomError("held_control", "a held point has no std or covariance")
            return self
        _require_one_precision(self)
        return self


class VectorObservation(_Spatial):
    """Coordinate differences between two points in the world, as satellite baselines are."""

    start: NetworkName = Field(validation_alias=AliasChoices("from", "start"))
    """Point."""
    end: NetworkName = Field(validation_alias=AliasChoices("to", "end"))
    """Point."""
    xyz: Place
    """End minus start [m]; also as dx, dy, dz."""

    @model_validator(mode="after")
    def _precise(self) -> "VectorObservation":
        _require_one_precision(self)
        return self


def _require_one_precision(observation: _Spatial) -> None:
    if (observation.std is None) == (observation.covariance is None):
        raise PydanticCustomError("precision", "give either std or covariance")


class DistanceObservation(_Grouped):
    """Distance between two points."""

    start: NetworkName = Field(validation_alias=AliasChoices("from", "start"))
    """Point."""
    end: NetworkName = Field(validation_alias=AliasChoices("to", "end"))
    """Point."""
    distance: Annotated[float, Field(gt=0.0, le=1e9)] = Field(validation_alias=AliasChoices("distance", "value"))
    """[m]."""
    sigma: Std = Field(validation_alias=AliasChoices("sigma", "std", "sigma_distance"))
    """Its standard deviation [m]."""
    horizontal: bool = False
    """Whether it was reduced to the horizontal."""


class HeightObservation(_Grouped):
    """Difference of height, Z of the end minus Z of the start."""

    start: NetworkName = Field(validation_alias=AliasChoices("from", "start"))
    """Point."""
    end: NetworkName = Field(validation_alias=AliasChoices("to", "end"))
    """Point."""
    difference: Number = Field(validation_alias=AliasChoices("difference", "dh", "height", "value"))
    """[m]."""
    sigma: Std = Field(validation_alias=AliasChoices("sigma", "std", "sigma_height", "sigma_difference"))
    """Its standard deviation [m]."""


class TiltObservation(_Grouped):
    """Inclinometer of a scanner station: ω and φ of its pose; each part may be missing."""

    station: NetworkName
    """Which station."""
    omega: Number | None = None
    """About X."""
    sigma_omega: Std | None = None
    """Its standard deviation."""
    phi: Number | None = None
    """About the turned Y."""
    sigma_phi: Std | None = None
    """Its standard deviation."""

    @model_validator(mode="after")
    def _with_stds(self) -> "TiltObservation":
        _require_std("omega", self.omega, self.sigma_omega)
        _require_std("phi", self.phi, self.sigma_phi)
        return self


class FictitiousObservation(_Grouped):
    """Points of one plane or of one straight line."""

    id: NetworkName
    """Name of the plane or line."""
    points: Annotated[list[NetworkName], Field(min_length=2, max_length=100_000)]
    """Points that lie in it."""
    sigma: Std = Field(default=0.001, validation_alias=AliasChoices("sigma", "std", "sigma_m"))
    """How well they do [m]."""


class UnknownObservation(_Grouped):
    """An expected value of a single unknown (zero-observation)."""

    unknown: Annotated[str, Field(min_length=3, max_length=300)]
    """`NAME.PARAMETER`: of a station or mount X, Y, Z, omega, phi, kappa, alpha, zeta, of a point X, Y, Z, or any of a
    camera or scanner."""
    value: Number = 0.0
    """What is expected, in the units of the network."""
    sigma: Std = Field(validation_alias=AliasChoices("sigma", "std"))
    """How well it is expected."""


def _control_of_table(given: Any) -> Any:
    points = point_dictionaries(given)
    if points is given:
        return given
    return [{key.removesuffix("_m"): as_tuples(value) for key, value in point.items()} for point in points]


class NetworkObservations(RequestModel):
    """What was observed; a missing key is a type that was not."""

    polar: list[PolarObservation] = Field(default_factory=list)
    """Horizontal angles, zenith angles and distances from stations."""
    image: list[ImageObservation] = Field(default_factory=list)
    """Points in photos."""
    coordinates: list[StationCoordinatesObservation] = Field(default_factory=list)
    """Points in the frames of stations."""
    control: Annotated[
        list[ControlObservation],
        BeforeValidator(_control_of_table, json_schema_input_type=list[ControlObservation] | PointTable),
    ] = Field(default_factory=list)
    """Known points; or the text of a table of them: `{"csv": "…"}`, with standard deviations in its columns."""
    distances: list[DistanceObservation] = Field(default_factory=list)
    """Between points."""
    heights: list[HeightObservation] = Field(default_factory=list)
    """Height differences between points."""
    vectors: list[VectorObservation] = Field(default_factory=list)
    """Coordinate differences between points."""
    tilts: list[TiltObservation] = Field(default_factory=list)
    """Inclinometers."""
    planes: list[FictitiousObservation] = Field(default_factory=list)
    """Points of one plane (fictitious)."""
    lines: list[FictitiousObservation] = Field(default_factory=list)
    """Points of one straight line (fictitious)."""
    unknowns: list[UnknownObservation] = Field(default_factory=list)
    """Expected values of unknowns (fictitious)."""


class HybridNetwork(RequestModel):
    """Stations, points and observations of one adjustment."""

    format: Literal["hybrid-network/1"]
    """Version of this layout."""
    units: NetworkUnits = Field(default_factory=NetworkUnits)
    """Units of the numbers."""
    stations: Annotated[list[NetworkStation], Field(max_length=100_000)] = Field(default_factory=list)
    """Set-ups and photos."""
    camera: NetworkCamera | None = None
    """The only camera."""
    cameras: Annotated[list[NetworkCamera], Field(max_length=10_000)] = Field(default_factory=list)
    """Cameras, where there are several."""
    mounts: Annotated[list[NetworkMount], Field(max_length=10_000)] = Field(default_factory=list)
    """Mounts of cameras on scanners."""
    scanners: Annotated[list[NetworkScanner], Field(max_length=10_000)] = Field(default_factory=list)
    """Instruments with errors."""
    points_approx: dict[NetworkName, Place] = Field(default_factory=dict)
    """Approximate coordinates of points [m], by name; missing ones are found."""
    observations: NetworkObservations
    """What was observed."""
    conventions: dict[str, str] | None = None
    """For information: rotations, angles and image axes are those of this description."""
    n_observations: int | None = None
    """For information."""
    note: str | None = None
    """For information."""
