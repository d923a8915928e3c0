"""Where patches of splines are fitted to the points of a mesh."""

import math
from typing import Annotated, Literal, TypeAlias

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from schemas.requests.execution import FileOutputRequest
from schemas.values.base import RequestModel

Coordinate: TypeAlias = Annotated[float, Field(ge=-1e9, le=1e9)]
Position: TypeAlias = tuple[Coordinate, Coordinate, Coordinate]
Length: TypeAlias = Annotated[float, Field(gt=0.0, le=1e6)]
LEAST_LENGTH = 1e-6
"""Shorter directions are none."""
SKEWEST = 0.01
"""Cosine up to which two sides make a rectangle."""


def _length(way: Position) -> float:
    return math.hypot(*way)


class PatchRequest(RequestModel):
    """How a patch is fitted."""

    name: str = Field(min_length=1, max_length=100)
    """What it is called in the result and in the file."""
    degree: int = Field(default=3, ge=1, le=5)
    """Of the splines along both sides."""
    tolerance_m: float = Field(default=0.0, ge=0.0, le=1000.0)
    """Mean misfits below this ask for no more knots [m]; 0: only the noise of the points decides."""
    most_spans: int = Field(default=64, ge=4, le=256)
    """Largest number of intervals between knots along a side."""


class HeightFieldRequest(PatchRequest):
    """A rectangle over which the surface is a field of heights."""

    kind: Literal["height-field"] = "height-field"
    """The kind."""
    corner_m: Position
    """A corner, world [m]."""
    side_u_m: Position
    """From there along the first side [m]."""
    side_v_m: Position
    """And along the second one, at a right angle to the first [m]; heights count along their cross product."""
    reach_m: Length
    """Points farther from the rectangle than this take no part [m]."""

    @model_validator(mode="after")
    def _is_rectangle(self) -> "HeightFieldRequest":
        lengths = _length(self.side_u_m), _length(self.side_v_m)
        along = abs(sum(u * v for u, v in zip(self.side_u_m, self.side_v_m, strict=True)))
        if min(lengths) < LEAST_LENGTH or along > SKEWEST * lengths[0] * lengths[1]:
            raise PydanticCustomError("patch_sides", "the sides of a patch have lengths and a right angle between them")
        return self


class CylinderRequest(PatchRequest):
    """A part of a cylinder about whose axis the surface is a field of distances."""

    kind: Literal["cylinder"]
    """The kind."""
    start_m: Position
    """Where the axis begins, world [m]."""
    end_m: Position
    """Where it ends [m]."""
    towards: Position
    """Direction from the axis in which angle 0 lies, across the axis or inclined to it."""
    from_deg: float = Field(default=0.0, ge=-360.0, le=360.0)
    """Angle about the axis at which the patch begins, right-handed from its start to its end [degrees]."""
    to_deg: float = Field(default=360.0, ge=-360.0, le=720.0)
    """Angle at which it ends, up to 360 more; then it closes [degrees]."""
    least_radius_m: float = Field(default=0.0, ge=0.0, le=1e6)
    """Points nearer to the axis take no part [m]."""
    largest_radius_m: Length
    """Points farther from the axis take no part [m]."""

    @model_validator(mode="after")
    def _has_extent(self) -> "CylinderRequest":
        axis: Position = tuple(b - a for a, b in zip(self.start_m, self.end_m, strict=True))  # type: ignore[assignment]
        if _length(axis) < LEAST_LENGTH or _length(self.towards) < LEAST_LENGTH:
            raise PydanticCustomError("patch_axis", "the axis of a patch and its direction `towards` have lengths")
        if not 0.0 < self.to_deg - self.from_deg <= 360.0:
            raise PydanticCustomError("patch_angles", "`to_deg` is larger than `from_deg`, by 360 at most")
        if self.least_radius_m >= self.largest_radius_m:
            raise PydanticCustomError("patch_radii", "`largest_radius_m` is larger than `least_radius_m`")
        return self


MeshPatch: TypeAlias = Annotated[HeightFieldRequest | CylinderRequest, Field(discriminator="kind")]


class PatchesOutput(FileOutputRequest):
    """The patches as a file, in the coordinates of the world."""

    format: Literal["json", "igs", "ply", "obj", "glb"] = "json"
    """`json`: degrees, knots and control points; `igs`: IGES 5.3, entity 128, for CAD; else triangles over them."""
