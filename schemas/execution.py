"""The body of an execution request, whatever the process."""

from typing import Any, Generic, Literal, TypeVar

from pydantic import Field

from schemas.base import RequestModel
from schemas.subscriber import Subscriber

InputsT = TypeVar("InputsT", bound=RequestModel)


class OutputFormat(RequestModel):
    """Format of one output."""

    media_type: Literal["application/json"] = Field(default="application/json", alias="mediaType")
    """Outputs are JSON."""
    encoding: Literal["utf-8", "UTF-8"] | None = None
    json_schema: Any = Field(default=None, alias="schema")
    """Schema that the client expects; only noted."""


class OutputRequest(RequestModel):
    """How one output is wanted."""

    transmission_mode: Literal["value"] = Field(default="value", alias="transmissionMode")
    """Only by value."""
    format: OutputFormat | None = None


class ExecuteRequest(RequestModel, Generic[InputsT]):
    """Inputs of a process and how its outputs are wanted."""

    inputs: InputsT
    """Inputs by name."""
    outputs: dict[str, OutputRequest] | None = None
    """Wanted outputs; left out: all."""
    response: Literal["document", "raw"] = "document"
    """`raw`: a single wanted output comes without the enclosing document, several as parts of `multipart/related`."""
    subscriber: Subscriber | None = None
    """Who is told how a run in the background goes; a synchronous run tells nobody."""
