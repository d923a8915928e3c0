"""Inputs of the process `mesh`."""

from typing import TYPE_CHECKING, Literal

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from algorithms.cleaning.options import CleaningOptions
from algorithms.colouring.options import ColouringOptions
from algorithms.meshing.options import MeshOptions
from schemas.requests.cleaning_steps import CleaningSteps
from schemas.requests.execution import FileOutputRequest
from schemas.requests.mesh_patches import Coordinate, MeshPatch, Position
from schemas.requests.method_options import options_model
from schemas.requests.posed_stations import PosedInputs, PosedStations
from schemas.values.base import RequestModel

if TYPE_CHECKING:
    MeshRequest = RequestModel
else:
    MeshRequest = options_model(MeshOptions)

LEAST_LENGTH = 1e-6
"""Shorter directions are none."""


class MeshCut(RequestModel):
    """A plane that cuts the mesh, as between a plinth and what stands on it."""

    point_m: Position
    """A point of the plane, world [m]."""
    normal: Position
    """Direction across it, to the side that is kept; of any length."""

    @model_validator(mode="after")
    def _has_direction(self) -> "MeshCut":
        if sum(part * part for part in self.normal) < LEAST_LENGTH**2:
            raise PydanticCustomError("cut_normal", "the normal of a cut has a length")
        return self


class MeshEdge(RequestModel):
    """A straight edge of the surface, as `extract-lines` or photos give it."""

    start_m: Position
    """One end, world [m]."""
    end_m: Position
    """The other end, world [m]."""

    @model_validator(mode="after")
    def _has_length(self) -> "MeshEdge":
        if sum((one - other) ** 2 for one, other in zip(self.start_m, self.end_m, strict=True)) < LEAST_LENGTH**2:
            raise PydanticCustomError("edge_length", "the ends of an edge differ")
        return self


class PlinthPlane(MeshCut):
    """A face of a plinth, as `model-planes` gives it; the normal looks outward."""


class MeshPlinth(RequestModel):
    """A convex body of planes on which the surface stands; both become one body."""

    planes: list[PlinthPlane] = Field(min_length=4, max_length=60)
    """Its faces, closed on all sides; also the one on the ground."""
    top: int = Field(ge=0)
    """Which of them, counted from 0, carries the surface."""
    above_m: float | None = Field(default=None, gt=0.0, le=1000.0)
    """Height above the top at which the surface is cut; from there walls go straight down to it [m]. Null: twice the
    resolution, as far as the mesh rounds the corner between the two."""

    @model_validator(mode="after")
    def _has_top(self) -> "MeshPlinth":
        if self.top >= len(self.planes):
            raise PydanticCustomError("plinth_top", "there is no such plane among `planes`")
        return self


class MeshTexture(RequestModel):
    """How photos are laid on the mesh."""

    size_px: int = Field(default=4096, ge=64, le=8192)
    """Largest side of the image that holds them all."""
    blending: ColouringOptions = Field(default=ColouringOptions())
    """How photos are chosen, by angle and distance, and balanced. Each triangle takes one; what hides it is the mesh
    itself, so that `margin_m` has no meaning here."""


class MeshContour(RequestModel):
    """The outline of something before what is behind it, measured in one photo of a station."""

    station: str = Field(min_length=1, max_length=200)
    """Name of the station."""
    photo: int = Field(default=0, ge=0)
    """Which of its photos, counted from 0."""
    pixels: list[tuple[Coordinate, Coordinate]] = Field(min_length=1, max_length=100_000)
    """Columns and rows of its points, 0, 0 the middle of the first pixel."""
    largest_gap_px: float = Field(default=20.0, gt=0.0, le=1000.0)
    """Points farther from the outline of the mesh in the photo are not laid on it [px]."""


class MeshInputs(PosedInputs):
    """Registered scans, and the mesh that is laid through them."""

    stations: PosedStations
    """Scans with poses, or the stations of a finished `register` job."""
    cleaning: CleaningSteps = Field(default=CleaningOptions())
    """Steps taken before, in the order of this list; null leaves one out. Crop to the object: what is beside it becomes
    part of the mesh."""
    surface: MeshRequest = Field(default_factory=MeshRequest, title="Surface")
    """How triangles are laid through the points, repaired and lightened."""
    lines: list[MeshEdge] = Field(default=[], max_length=10_000)
    """Edges that the mesh keeps sharp: vertices next to them are laid onto them. They must be edges of the surface,
    accurate to a fraction of the resolution."""
    cuts: list[MeshCut] = Field(default=[], max_length=100)
    """Planes that cut the mesh, one after the other; each cut is closed by triangles in its plane."""
    plinth: MeshPlinth | None = None
    """What the surface stands on: mesh and planes become one watertight body without faces between them."""
    patches: list[MeshPatch] = Field(default=[], max_length=1000)
    """Rectangles and parts of cylinders in which B-spline surfaces (NURBS of weights 1) are fitted to the cleaned
    points; there is no automatic layout. Their names differ."""
    texture: MeshTexture | None = None
    """Lay the stations' photos, listed or of their files (E57), with camera and pose on the mesh; for `obj` (with its
    material and image) and `glb`."""
    contours: list[MeshContour] = Field(default=[], max_length=1000)
    """Contours in photos; the cone of each is intersected with the mesh, which gives edges that scans miss."""
    tolerance_m: float = Field(default=0.01, gt=0.0, le=1000.0)
    """For the share of points that lie within it of the mesh [m]."""


class MeshOutput(FileOutputRequest):
    """The mesh as a file, in the coordinates of the world."""

    format: Literal["ply", "obj", "glb"] = "ply"
    """`ply` in float64, `obj`, or binary glTF, whose vertices are float32 about the origin of their node."""
