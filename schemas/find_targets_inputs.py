"""Inputs of the process `find-targets`."""

from pydantic import Field

from schemas.base import RequestModel
from schemas.register_inputs import Station
from schemas.target_kinds import KindRequest


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


class FindTargetsInputs(RequestModel):
    """Which scan to look for targets in, and what they are."""

    station: Station = Field(title="Station")
    """The station and its scan."""
    kinds: list[KindRequest] = Field(min_length=1, max_length=10, title="Kinds")
    """What is looked for, one entry for each kind and size."""
    names: list[NamedPoint] = Field(default_factory=list, max_length=500, title="Names")
    """Known targets; the found ones are recognised by their distances and named, or said not to be determined."""
