"""Inputs of the process `model-planes`."""

from typing import Annotated, TypeAlias

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from algorithms.cleaning.options import CleaningOptions
from algorithms.meshing.options import PlaneRelation
from schemas.requests.cleaning_steps import CleaningSteps
from schemas.requests.posed_stations import PosedInputs, PosedStations
from schemas.values.base import RequestModel
from schemas.values.station_names import StationName

Coordinate: TypeAlias = Annotated[float, Field(ge=-1e9, le=1e9)]


class SeededPlane(RequestModel):
    """A plane of the object, shown by a place on it."""

    name: StationName
    """What it is called, unique in the job."""
    seed_m: tuple[Coordinate, Coordinate, Coordinate]
    """A place on it, away from its borders, world [m]."""
    reach_m: float = Field(default=10.0, gt=0.0, le=1000.0)
    """Points farther from the seed do not belong to it [m]."""


class RelationOfPlanes(RequestModel):
    """What planes must keep."""

    relation: PlaneRelation
    """`vertical`, of one plane; `parallel` or `orthogonal`, of two."""
    planes: list[StationName] = Field(min_length=1, max_length=2)
    """Names of the planes."""

    @model_validator(mode="after")
    def _has_its_planes(self) -> "RelationOfPlanes":
        wanted = 1 if self.relation is PlaneRelation.VERTICAL else 2
        if len(set(self.planes)) != wanted:
            raise PydanticCustomError("relation_planes", f"{self.relation.value} is said of {wanted} plane(s)")
        return self


class ModelPlanesInputs(PosedInputs):
    """Registered scans, the planes of an object in them, and what they must keep."""

    stations: PosedStations
    """Scans with poses, or the stations of a finished `register` job."""
    cleaning: CleaningSteps = Field(default=CleaningOptions())
    """Steps taken before; null leaves one out."""
    planes: list[SeededPlane] = Field(min_length=1, max_length=200)
    """The planes."""
    constraints: list[RelationOfPlanes] = Field(default=[], max_length=10_000)
    """What they must keep; those that follow from others do no harm."""
    corners: list[tuple[StationName, StationName, StationName]] = Field(default=[], max_length=10_000)
    """Each three planes that meet in a corner."""
    tolerance_m: float = Field(default=0.02, gt=0.0, le=10.0)
    """Points farther from a plane do not belong to it: about three standard deviations [m]."""
