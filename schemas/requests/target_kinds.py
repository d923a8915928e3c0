"""Kinds of survey targets that are looked for in scans."""

from typing import Annotated, Literal

from pydantic import Field

from schemas.values.base import RequestModel


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


class TargetSearch(RequestModel):
    """Which targets are looked for in every scan of a registration."""

    kinds: list[KindRequest] = Field(min_length=1, max_length=10)
    """One entry for each kind and size."""
