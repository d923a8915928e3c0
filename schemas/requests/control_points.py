"""Targets that stations state, and points with known coordinates."""

from typing import Annotated, Any, Literal, Self, TypeAlias

from pydantic import AfterValidator, AliasChoices, BeforeValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from schemas.requests.point_tables import PointTable, as_tuples, point_dictionaries
from schemas.values.base import RequestModel

PointName: TypeAlias = Annotated[str, Field(min_length=1, max_length=100)]
Coordinate: TypeAlias = Annotated[float, Field(ge=-1e9, le=1e9)]
Std: TypeAlias = Annotated[float, Field(ge=1e-6, le=100.0)]
Row3: TypeAlias = tuple[float, float, float]
FixedFrame: TypeAlias = Annotated[
    str, Field(min_length=1, max_length=64), AfterValidator(lambda name: "first-station" if name == "first" else name)
]
"""`first-station` or `first`, `control`, `free`, or the name of a station."""
Axes: TypeAlias = Literal["east-north-height", "north-east-height"]
MAX_TARGETS, MAX_CONTROL = 500, 2000


class MeasuredPoint(RequestModel):
    """Three coordinates with their precision."""

    x: Coordinate
    """[m]."""
    y: Coordinate
    """[m]."""
    z: Coordinate
    """[m]."""
    std: Std | tuple[Std, Std, Std] | None = Field(default=None, validation_alias=AliasChoices("std", "std_m"))
    """Standard deviation of all three coordinates, or of each [m]."""
    covariance: tuple[Row3, Row3, Row3] | None = Field(
        default=None, validation_alias=AliasChoices("covariance", "covariance_m2")
    )
    """3x3 [m²], instead of `std`."""

    @model_validator(mode="after")
    def _one_precision(self) -> Self:
        if self.std is not None and self.covariance is not None:
            raise PydanticCustomError("two_precisions", "give `std` or `covariance`, not both")
        if self.covariance is not None and not _is_covariance(self.covariance):
            raise PydanticCustomError("covariance", "`covariance` must be symmetric and positive definite")
        return self


class StationTarget(MeasuredPoint):
    """A survey target, in the coordinates of the station's file."""

    name: PointName | None = None
    """What it is called at all stations, and among the control points; null: nobody said, it is recognised by its
    distances from the others."""

    @model_validator(mode="after")
    def _precise(self) -> Self:
        if self.std is None and self.covariance is None:
            raise PydanticCustomError("no_precision", "a target needs `std` or `covariance`")
        return self


class ControlPoint(MeasuredPoint):
    """A point with known coordinates that is a target of one station at least."""

    name: PointName
    """Its name; a target of that name is this point, those without a name are recognised by their distances."""
    use: Literal["control", "check"] = "control"
    """`control`: it takes part; `check`: it does not, and the result says by how much it is missed."""

    @model_validator(mode="after")
    def _precise(self) -> Self:
        if self.use == "control" and self.std is None and self.covariance is None:
            raise PydanticCustomError("no_precision", "a control point needs `std` or `covariance`")
        return self


def _points_of_table(given: Any) -> Any:
    """Give the points of a table, and lists of points with what strict tuples take."""
    points = point_dictionaries(given)
    if not isinstance(points, list):
        return points
    return [
        {name: as_tuples(value) for name, value in point.items()} if isinstance(point, dict) else point
        for point in points
    ]


ControlPoints: TypeAlias = Annotated[
    list[ControlPoint], BeforeValidator(_points_of_table, json_schema_input_type=list[ControlPoint] | PointTable)
]
"""A list, or the text of a table: ``{"csv": "…"}``."""


def _is_covariance(rows: tuple[Row3, Row3, Row3]) -> bool:
    """Say whether a matrix is symmetric with positive leading minors."""
    (a, b, c), (b2, d, e), (c2, e2, f) = rows
    size = max(abs(value) for row in rows for value in row)
    if max(abs(b - b2), abs(c - c2), abs(e - e2)) > 1e-9 * size:
        return False
    second = a * d - b * b
    return a > 0.0 and second > 0.0 and f * second - a * e * e + 2.0 * b * c * e - d * c * c > 0.0
