"""Jobs: their status in the words of OGC API - Processes 1.0, lists of them, their downloads."""

from datetime import datetime
from typing import Literal

from pydantic import Field

from schemas.base import ResponseModel
from schemas.links import Link


class StatusInfo(ResponseModel):
    """Where a job stands."""

    process_id: str = Field(serialization_alias="processID")
    """Process that the job runs."""
    type: Literal["process"] = "process"
    job_id: str = Field(serialization_alias="jobID")
    """Identifier of the job."""
    status: Literal["accepted", "running", "successful", "failed", "dismissed"]
    message: str
    """What is being done, or why it ended."""
    progress: int = Field(ge=0, le=100)
    """Percent done."""
    attempts: int
    """How often a worker has taken the job up."""
    created: datetime
    started: datetime | None = None
    finished: datetime | None = None
    updated: datetime | None = None
    links: list[Link]


class JobList(ResponseModel):
    """One page of jobs, newest first."""

    jobs: list[StatusInfo]
    number_matched: int = Field(serialization_alias="numberMatched")
    """Jobs on all pages."""
    number_returned: int = Field(serialization_alias="numberReturned")
    """Jobs on this page."""
    links: list[Link]


class Artifact(ResponseModel):
    """One download of a finished job."""

    name: str
    type: str
    """Media type."""
    bytes: int
    href: str


class ArtifactList(ResponseModel):
    """All downloads of a job."""

    artifacts: list[Artifact]
    links: list[Link]
