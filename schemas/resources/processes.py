"""Descriptions of processes in the words of OGC API - Processes 1.0."""

from typing import Any, Literal

from pydantic import Field

from schemas.values.base import ResponseModel
from schemas.values.links import Link

JobControlOption = Literal["sync-execute", "async-execute", "dismiss"]


class ProcessSummary(ResponseModel):
    """What a process is."""

    id: str
    """As in addresses."""
    title: str
    """What a person calls it."""
    description: str
    """What it does."""
    version: str
    """Changes with what goes in and comes out."""
    job_control_options: list[JobControlOption] = Field(serialization_alias="jobControlOptions")
    """How it may be run."""
    output_transmission: list[Literal["value", "reference"]] = Field(
        default=["value"], serialization_alias="outputTransmission"
    )
    """How outputs are handed over; by reference: those that are files."""
    links: list[Link]
    """Where to go from here."""


class ProcessList(ResponseModel):
    """Every process of this service."""

    processes: list[ProcessSummary]
    """The processes."""
    links: list[Link]
    """Where to go from here."""


class InputDescription(ResponseModel):
    """One input of a process."""

    title: str
    """What a person calls it."""
    description: str
    """What it is, in words."""
    min_occurs: int = Field(default=1, serialization_alias="minOccurs")
    """0 when it may be left out."""
    max_occurs: int = Field(default=1, serialization_alias="maxOccurs")
    """How many values it may have."""
    json_schema: dict[str, Any] = Field(serialization_alias="schema")
    """JSON Schema of its value."""


class OutputDescription(ResponseModel):
    """One output of a process."""

    title: str
    """What a person calls it."""
    description: str
    """What it is, in words."""
    json_schema: dict[str, Any] = Field(serialization_alias="schema")
    """JSON Schema of its value."""


class ProcessDescription(ProcessSummary):
    """A process with its inputs and outputs."""

    inputs: dict[str, InputDescription]
    """What goes in, by name."""
    outputs: dict[str, OutputDescription]
    """What comes out, by name."""
