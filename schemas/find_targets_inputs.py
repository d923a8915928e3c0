"""Inputs of the process `find-targets`."""

from typing import Annotated, Literal

from pydantic import Field

from schemas.base import RequestModel
from schemas.register_inputs import Station

Row3 = tuple[float, float, float]


class SphereRequest(RequestModel):
    """Spheres of one radius."""

    kind: Literal["sphere"]
    """Sphere."""
    radius_m: float = Field(gt=0.005, le=2.0)
    """Radius [m]."""


class BoardRequest(RequestModel):
    """Square boards of four squares, black and white in turns, that meet in the centre."""

    kind: Literal["board"]
    """Black-and-white board; the scan must have intensities."""
    size_m: float = Field(gt=0.01, le=5.0)
    """Side of the whole board [m]."""


class RetroRequest(RequestModel):
    """Retro-reflective targets; the scan must be structured and have intensities."""

    kind: Literal["retro-square", "retro-cylinder"]
    """A square, or an upright cylinder as wide as it is high."""
    size_m: float = Field(gt=0.002, le=1.0)
    """Side of the square, or diameter and height of the cylinder [m]."""


KindRequest = Annotated[SphereRequest | BoardRequest | RetroRequest, Field(discriminator="kind")]


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
