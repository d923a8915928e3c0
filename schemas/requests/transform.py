"""Inputs and result document of the process `transform`."""

from pydantic import Field

from schemas.requests.posed_stations import PosedInputs, PosedStations
from schemas.requests.registered_output import RegisteredOptions
from schemas.results.posed_result import PoseSource
from schemas.results.registration_result import Artifact, InputFile, RegisteredFile
from schemas.values.poses import Document


class TransformInputs(PosedInputs, RegisteredOptions):
    """Scans with their poses, and which files they become."""

    stations: PosedStations = Field(title="Stations")
    """Scans with their poses, or the stations of a finished `register` job."""


class LeftOutStation(Document):
    """A station that is in no file."""

    name: str
    """Name of the station."""
    reason: str
    """Why it is left out."""


class TransformProvenance(Document):
    """What was done with what."""

    software: str
    """Name and version."""
    inputs: list[InputFile]
    """The scans that went in."""


class TransformDocument(Document):
    """Answer of `transform`."""

    files: list[RegisteredFile]
    """The files that were written."""
    left_out: list[LeftOutStation]
    """Stations without a pose."""
    poses_from: dict[str, PoseSource] = Field(default={})
    """Where the pose of each station is from, by name: the `request`, a `job`, the `file`; `none`: the coordinates of
    the file are those of the world."""
    artifacts: list[Artifact]
    """Files that can be downloaded."""
    provenance: TransformProvenance
    """What was done with what."""
