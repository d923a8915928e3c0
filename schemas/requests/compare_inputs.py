"""Inputs of the process `compare`."""

from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from algorithms.deviations.options import M3C2Options, RasterOptions
from schemas.requests.execution import FileOutputRequest
from schemas.requests.method_options import options_model
from schemas.requests.posed_stations import PosedInputs, PosedStations, SelectedPoints
from schemas.values.base import RequestModel
from schemas.values.file_references import FileReference
from schemas.values.station_names import StationName
from schemas.values.units import StatedUnit

if TYPE_CHECKING:
    M3C2Request = RequestModel
    RasterRequest = RequestModel
else:
    M3C2Request = options_model(M3C2Options)
    RasterRequest = options_model(RasterOptions)

Coordinate: TypeAlias = Annotated[float, Field(ge=-1e9, le=1e9)]
Place: TypeAlias = tuple[Coordinate, Coordinate, Coordinate]
Row12: TypeAlias = Annotated[list[float], Field(min_length=12, max_length=12)]
LEAST_LENGTH = 1e-6
"""Shorter directions are none."""


class MeshReference(FileReference):
    """A triangle mesh in a PLY, OBJ or STL file, in the frame of the world."""

    unit: StatedUnit | None = None
    """In which unit its coordinates are: `mm`, `m`, `ft` or `us-ft`; null: metres, for mesh formats state none."""


class PlaneInput(RequestModel):
    """A plane that a surface should be."""

    name: StationName
    """What it is called in the result, unique in the job."""
    point_m: Place
    """A point of it, world [m]."""
    normal: Place
    """Direction across it, to the side that counts as positive; of any length."""
    outline_m: Annotated[list[Place], Field(min_length=3, max_length=10_000)] | None = None
    """Corners of its outline in order, world [m]; null: it has no end."""

    @model_validator(mode="after")
    def _has_direction(self) -> "PlaneInput":
        if sum(part * part for part in self.normal) < LEAST_LENGTH**2:
            raise PydanticCustomError("plane_normal", "the normal of a plane has a length")
        return self


class PositiveSide(RequestModel):
    """To which side of the reference cloud deviations are positive: one of both."""

    point_m: Place | None = None
    """The side from which this place is seen, such as where the instrument stood; world [m]."""
    direction: Place | None = None
    """The side to which this direction points, of any length, world."""

    @model_validator(mode="after")
    def _one(self) -> "PositiveSide":
        if (self.point_m is None) == (self.direction is None):
            raise PydanticCustomError("positive_side", "give one of point_m and direction")
        if self.direction is not None and sum(part * part for part in self.direction) < LEAST_LENGTH**2:
            raise PydanticCustomError("positive_side", "the direction has a length")
        return self


class CompareInputs(SelectedPoints, PosedInputs):
    """What is compared with what: a cloud with another cloud, with a mesh or with planes."""

    cloud: PosedStations = Field(title="Cloud")
    """The cloud whose deviations are wanted, or the later one."""
    reference: PosedStations | None = Field(default=None, title="Reference cloud")
    """The cloud that it is compared with, or the earlier one."""
    mesh: MeshReference | None = Field(default=None, title="Reference mesh")
    """The mesh that it is compared with."""
    planes: Annotated[list[PlaneInput], Field(min_length=1, max_length=1000)] | None = Field(
        default=None, title="Reference planes"
    )
    """The planes that it is compared with."""
    method: Literal["m3c2", "nearest"] = "m3c2"
    """Between clouds: `m3c2`, distances along local normals with a level of detection, or `nearest`, the distance of
    each point from the tangent plane of the nearest reference point. Meshes and planes: always the nearest place."""
    m3c2: M3C2Request = Field(default_factory=M3C2Request, title="M3C2")
    """Sizes and levels of `m3c2`."""
    core_spacing_m: float = Field(default=0.1, gt=0.0, le=1000.0)
    """Edge of the voxels of which one reference point each becomes a core point of `m3c2` [m]."""
    max_distance_m: float = Field(default=0.5, gt=0.0, le=1000.0)
    """Points farther from the reference have no deviation (not of `m3c2`, which has its own) [m]."""
    towards: PositiveSide | None = Field(default=None, title="Positive side")
    """Which side of the reference cloud is positive. Null: that of the instruments, where they are known; above, where
    it is a terrain; else the sign is arbitrary, and the mean null. Meshes and planes have sides of their own."""
    tolerance_m: float = Field(default=0.01, gt=0.0, le=1000.0)
    """For the share of deviations within it [m]."""
    joint_covariance: Annotated[list[Row12], Field(min_length=12, max_length=12)] | None = None
    """12×12 covariance of (rotation vector [rad], translation [m]) of the reference's station, then of the cloud's, in
    the convention of the service's own poses; only where either has one station. Null: from the stations' poses."""
    raster: RasterRequest | None = Field(default=None, title="Raster")
    """Compare both as surfaces on a grid as well, test their difference for patterns, and make maps of density,
    distance and residuals."""
    view: Place = (0.0, 0.0, 1.0)
    """Direction towards the observer of pictures and rasters: 0, 0, 1 is the view from above."""

    @model_validator(mode="after")
    def _one_reference(self) -> "CompareInputs":
        if sum(each is not None for each in (self.reference, self.mesh, self.planes)) != 1:
            raise PydanticCustomError("one_reference", "give one of reference, mesh and planes")
        if sum(part * part for part in self.view) < LEAST_LENGTH**2:
            raise PydanticCustomError("view", "the direction of view has a length")
        return self


class DeviationsOutput(FileOutputRequest):
    """The points with their deviations, in the colours of the deviations."""

    format: Literal["ply", "laz"] = "ply"
    """Of the file; deviations are a further number of each point."""
