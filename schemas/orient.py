"""Inputs and result document of the process `orient`."""

from pydantic import Field

from schemas.base import RequestModel
from schemas.posed_stations import PosedStations
from schemas.poses import Document, Row4
from schemas.registration_result import Artifact
from schemas.station_names import StationName


class OrientInputs(RequestModel):
    """Scans with approximate poses, to be laid on each other all at once."""

    stations: PosedStations = Field(title="Stations")
    """Scans with approximate poses, or the stations of a finished `register` job."""
    fixed: list[StationName] | None = Field(default=None, min_length=1, title="Fixed stations")
    """Which stations stay where they are; null: the first."""
    max_distance_m: float = Field(default=0.5, gt=0.0, le=100.0, title="Largest distance")
    """Points farther from another cloud lie outside the overlap and take no part [m]."""
    max_angle_gon: float = Field(default=50.0, gt=0.0, le=100.0, title="Largest angle")
    """Nor do those whose normals differ by more [gon]."""
    voxel_m: float = Field(default=0.1, gt=0.0, le=10.0, title="Voxel")
    """One point of each voxel of this edge takes part [m]."""
    max_rounds: int = Field(default=60, ge=1, le=1000, title="Rounds")
    """Limit of rounds."""
    least_step_m: float = Field(default=1e-5, gt=0.0, le=1.0, title="Least step")
    """Rounds that move no cloud by more end the iteration (rms) [m]."""


class OrientedStation(Document):
    """A station and where it came to."""

    name: str
    """Name of the station."""
    fixed: bool
    """Whether it had to stay."""
    points: int
    """Points that took part."""
    world_from_scan: tuple[Row4, Row4, Row4, Row4]
    """Its pose, 4×4 row by row. It has no standard deviations: `register` gives poses to rely on."""
    rotation_gon: float
    """Angle by which it was turned [gon]."""
    shift_m: float
    """By how much the middle of its points was shifted [m]."""


class OrientRound(Document):
    """One round: all clouds are paired anew and moved together."""

    misfit_m: float
    """Weighted rms distance along the normals before it [m]."""
    step_m: float
    """Largest rms displacement of a cloud by it [m]."""
    pairs: int
    """Pairs of points."""


class OrientDocument(Document):
    """Answer of `orient`."""

    stations: list[OrientedStation]
    """Every station with its pose."""
    rounds: list[OrientRound]
    """What each round did."""
    neighbours: list[tuple[str, str]] = Field(description="Stations whose clouds lie on each other at last.")
    converged: bool
    """Whether the clouds came to rest."""
    left_out: dict[str, str] = Field(description="Stations without a pose, with the reason.")
    artifacts: list[Artifact]
    """`poses.json` with all poses by name."""
