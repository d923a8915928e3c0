"""Inputs of the process `find-targets`."""

from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from schemas.requests.point_tables import PointTable, point_dictionaries
from schemas.requests.register_inputs import Station
from schemas.requests.target_kinds import KindRequest
from schemas.values.base import RequestModel


class NamedPoint(RequestModel):
    """A target of the list, in any frame that the whole list shares."""

    name: str = Field(min_length=1, max_length=100)
    """What it is called."""
    x: float = Field(ge=-1e9, le=1e9)
    """Coordinate [m]."""
    y: float = Field(ge=-1e9, le=1e9)
    """Coordinate [m]."""
    z: float = Field(ge=-1e9, le=1e9)
    """Coordinate [m]."""
    std_m: float = Field(default=0.002, gt=0.0, le=1.0)
    """Standard deviation of each coordinate [m]."""


def _names_of_table(given: Any) -> Any:
    """Give the points of a table: of three standard deviations the largest, and nothing of their use."""
    points = point_dictionaries(given)
    if points is given:
        return given
    return [
        {key: max(value) if key == "std_m" else value for key, value in point.items() if key != "use"}
        for point in points
    ]


class FindTargetsInputs(RequestModel):
    """Which scan to look for targets in, and what they are."""

    station: Station = Field(title="Station")
    """The station and its scan; in its photos boards and retro-reflective squares are measured too, each in the window
    that the scan, `mount_std` and the covariance of its centre give."""
    kinds: list[KindRequest] = Field(min_length=1, max_length=10, title="Kinds")
    """What is looked for, one entry for each kind and size."""
    names: Annotated[
        list[NamedPoint], BeforeValidator(_names_of_table, json_schema_input_type=list[NamedPoint] | PointTable)
    ] = Field(default_factory=list, max_length=500, title="Names")
    """Known targets; the found ones are recognised by their distances and named, or said not to be determined. A list,
    or the text of a table: `{"csv": "…"}`."""
