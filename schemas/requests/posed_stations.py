"""Scans with poses as inputs: one by one, or all stations of a job that has registered them."""

from typing import Annotated, Literal, TypeAlias

from pydantic import Discriminator, Field, Tag

from schemas.requests.register_inputs import MAX_PHOTOS, ScanReference
from schemas.values.base import RequestModel
from schemas.values.photos import StationPhoto
from schemas.values.reference_poses import ReferencePose
from schemas.values.rigid_matrix import RigidMatrix
from schemas.values.station_names import StationName

JobId: TypeAlias = Annotated[str, Field(min_length=1, max_length=64)]


class PoseOfJob(RequestModel):
    """The pose that a finished `register` job gave a station."""

    job_id: JobId = Field(alias="jobID")
    """The job."""
    station: StationName | None = None
    """What the station is called there; null: as here."""


def _kind_of_pose(value: object) -> str:
    if isinstance(value, list):
        return "matrix"
    given = value if isinstance(value, dict) else {"jobID": None} if isinstance(value, PoseOfJob) else {}
    return "job" if "jobID" in given else "pose"


GivenPose: TypeAlias = Annotated[
    Annotated[RigidMatrix, Tag("matrix")] | Annotated[ReferencePose, Tag("pose")] | Annotated[PoseOfJob, Tag("job")],
    Discriminator(_kind_of_pose),
]
"""world_from_scan: the 4×4 matrix, row by row, an object with `matrix` and its accuracy, or that of a job."""


class PosedStation(RequestModel):
    """A scan and where it was measured."""

    name: StationName
    """Name of the station, unique in the job."""
    scan: ScanReference
    """What was measured there."""
    photos: list[StationPhoto] = Field(default=[], max_length=MAX_PHOTOS)
    """Photos taken from the same set-up, with the camera on the scanner."""
    world_from_scan: GivenPose | None = None
    """Its pose; null: the pose that the file states, or none: the coordinates of the file are those of the world."""


class StationsOfJob(RequestModel):
    """The stations of a finished `register` job, with the poses that it found. Those without a pose are left out."""

    job_id: JobId = Field(alias="jobID")
    """The job."""
    names: list[StationName] | None = Field(default=None, min_length=1)
    """Which stations; null: all that it registered."""


PosedStations: TypeAlias = Annotated[
    Annotated[list[PosedStation], Field(min_length=1), Tag("stations")] | Annotated[StationsOfJob, Tag("job")],
    Discriminator(lambda value: "stations" if isinstance(value, list) else "job"),
]
"""Stations one by one, or those of a job."""


class SelectedPoints(RequestModel):
    """Points of LAS, LAZ and COPC files that are used."""

    classes: list[Annotated[int, Field(ge=0, le=255)]] | None = Field(default=None, min_length=1, max_length=256)
    """Classes of LAS that are used, such as `[2]` for the ground; null: all but noise (7 and 18)."""
    returns: Literal["all", "first", "last"] = "all"
    """Returns of each pulse that are used."""
    withheld: bool = False
    """Use points that the file marks as withheld too."""
    overlap: bool = True
    """Use points that the file marks as overlap of strips (in old point formats class 12)."""


class PosedInputs(RequestModel):
    """What all processes ask of scans with poses."""

    poses: Literal["file", "ignore"] = Field(default="file", title="Poses of files")
    """For stations whose pose the request does not state: `file` takes the pose that an E57 or PTX file states for the
    set-up; `ignore` takes the coordinates of the file for those of the world."""
