"""Jobs: their status in the words of OGC API - Processes 1.0, lists of them, their downloads."""

from datetime import datetime
from typing import Literal

from pydantic import Field

from schemas.results.registration_result import Artifact
from schemas.values.base import ResponseModel
from schemas.values.links import Link


class StatusInfo(ResponseModel):
    """Where a job stands."""

    process_id: str = Field(serialization_alias="processID")
    """Process that the job runs."""
    type: Literal["process"] = "process"
    """Jobs are runs of a process."""
    job_id: str = Field(serialization_alias="jobID")
    """Identifier of the job."""
    status: Literal["accepted", "running", "successful", "failed", "dismissed"]
    """Where it stands."""
    message: str
    """What is being done, or why it ended."""
    progress: int = Field(ge=0, le=100)
    """Percent done."""
    attempts: int
    """How often a worker has taken the job up."""
    created: datetime
    """When it was requested."""
    started: datetime | None = None
    """When the first step began."""
    finished: datetime | None = None
    """When it ended."""
    updated: datetime | None = None
    """When something changed last."""
    links: list[Link]
    """Where to go from here."""


class JobList(ResponseModel):
    """One page of jobs, newest first."""

    jobs: list[StatusInfo]
    """The jobs."""
    number_matched: int = Field(serialization_alias="numberMatched")
    """Jobs on all pages."""
    number_returned: int = Field(serialization_alias="numberReturned")
    """Jobs on this page."""
    links: list[Link]
    """Where to go from here."""


class ArtifactList(ResponseModel):
    """All downloads of a job."""

    artifacts: list[Artifact]
    """The downloads."""
    links: list[Link]
    """Where to go from here."""
