"""Where a person says that two stations lie to each other, for the search to start from, and what is said of it."""

from typing import Annotated, TypeAlias

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from schemas.values.base import RequestModel
from schemas.values.poses import Document, Row4
from schemas.values.rigid_matrix import MAX_TRANSLATION_M, RigidMatrix
from schemas.values.station_names import StationName

Coordinate: TypeAlias = Annotated[float, Field(ge=-MAX_TRANSLATION_M, le=MAX_TRANSLATION_M)]
PickedPair: TypeAlias = tuple[Coordinate, Coordinate, Coordinate, Coordinate, Coordinate, Coordinate]
MOST_PICKED = 1000
A_PERSON = "a person"


class ChosenStart(RequestModel):
    """Where two stations lie to each other: by points that both scans show, or by a pose."""

    target: StationName
    """Station that gives the frame."""
    source: StationName
    """Station that is moved."""
    picked_points: list[PickedPair] | None = Field(default=None, min_length=3, max_length=MOST_PICKED)
    """Three points or more that both scans show, far apart and not on one line: x, y, z in the coordinates of the
    target's file, then in those of the source's [m]."""
    std_m: float = Field(default=0.05, ge=1e-4, le=10.0)
    """Standard deviation of each coordinate of a picked point in either scan [m]."""
    target_from_source: RigidMatrix | None = None
    """A pose instead, such as one of the alternatives of an ambiguous pair: 4×4, row by row, x_target = M x_source."""
    std_rotation_gon: float = Field(default=1.0, ge=1e-3, le=100.0)
    """Standard deviation of that pose about each axis [gon]."""
    std_translation_m: float = Field(default=0.1, ge=1e-4, le=100.0)
    """Standard deviation of that pose along each axis, where the source's points lie [m]."""
    chosen_by: str = Field(default=A_PERSON, min_length=1, max_length=64, pattern=r"^\w[\w .()+-]*$")
    """Who chose it, for the result document."""

    @model_validator(mode="after")
    def _one_of_both(self) -> "ChosenStart":
        if (self.picked_points is None) == (self.target_from_source is None):
            raise PydanticCustomError("start", "give either `picked_points` or `target_from_source`")
        return self


class StartDocument(Document):
    """The start that somebody chose, and what became of it."""

    chosen_by: str
    """Who chose it."""
    how: str = Field(description="picked-points or pose")
    target_from_source: tuple[Row4, Row4, Row4, Row4]
    """The pose that was chosen, or in which the picked points lie on each other best; 4×4, row by row."""
    residuals_m: list[tuple[float, float, float]] = Field(
        default=[], description="Target point less moved source point of each pick, target axes; empty for a pose."
    )
    statistic: float | None = Field(
        default=None, description="Sum of squared residuals of the picks over their variance; null for a pose."
    )
    critical: float | None = Field(default=None, description="Limit of that statistic; null for a pose.")
    turn_gon: float | None = Field(
        default=None, description="By how much the pose of the pair is turned from it; null: there is no pose."
    )
    shift_m: float | None = Field(
        default=None,
        description="By how much it lies elsewhere, in the middle of the source's surfaces; null: no pose.",
    )
