"""Inputs and result document of the process `orient`."""

from pydantic import Field

from schemas.requests.posed_stations import PosedInputs, PosedStations
from schemas.results.posed_result import PosedDocument
from schemas.results.registration_result import Artifact
from schemas.values.base import RequestModel
from schemas.values.poses import Document, Row4
from schemas.values.starts import MOST_PICKED, PickedPair
from schemas.values.station_names import StationName


class TiePoints(RequestModel):
    """Details that two stations both show, found in their photos or picked by hand."""

    first: StationName
    """One of the two stations."""
    second: StationName
    """The other one."""
    points: list[PickedPair] = Field(min_length=1, max_length=MOST_PICKED)
    """x, y, z in the coordinates of the first one's file, then in those of the second's [m]."""
    weight: float = Field(default=1.0, gt=0.0, le=1e6)
    """So many pairs of surface points count as much as one of these."""


class OrientInputs(PosedInputs):
    """Scans with approximate poses, to be laid on each other all at once."""

    stations: PosedStations = Field(title="Stations")
    """Scans with approximate poses, or the stations of a finished `register` job."""
    fixed: list[StationName] | None = Field(default=None, min_length=1, title="Fixed stations")
    """Which stations stay where they are; null: the first."""
    ties: list[TiePoints] = Field(default=[], max_length=10_000, title="Tie points")
    """Correspondences that stay, in all three directions, beside those of the surfaces, which are sought anew in each
    round; they hold what the surfaces leave free."""
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


class OrientedTies(Document):
    """Tie points of two stations when the clouds had come to rest."""

    first: str
    """One of the two stations."""
    second: str
    """The other one."""
    distances_m: list[float]
    """How far each point and its partner are apart; a large one was mixed up [m]."""


class OrientDocument(PosedDocument):
    """Answer of `orient`."""

    stations: list[OrientedStation]
    """Every station with its pose."""
    rounds: list[OrientRound]
    """What each round did."""
    neighbours: list[tuple[str, str]] = Field(description="Stations whose clouds lie on each other at last.")
    ties: list[OrientedTies] = Field(default=[], description="What became of the tie points, in their order.")
    converged: bool
    """Whether the clouds came to rest."""
    remarks: list[str] = Field(default=[])
    """Points that take no part, with their number and the reason."""
    artifacts: list[Artifact]
    """`poses.json` with all poses by name."""
