"""The body of an execution request, whatever the process."""

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, Generic, Literal, TypeVar

from pydantic import ConfigDict, Field, create_model

from schemas.requests.subscriber import Subscriber
from schemas.values.base import RequestModel

InputsT = TypeVar("InputsT", bound=RequestModel)


class OutputFormat(RequestModel):
    """Format of one output."""

    media_type: Literal["application/json"] = Field(default="application/json", alias="mediaType")
    """Outputs are JSON."""
    encoding: Literal["utf-8", "UTF-8"] | None = None
    """Of the text."""
    json_schema: Any = Field(default=None, alias="schema")
    """Schema that the client expects; only noted."""


class OutputRequest(RequestModel):
    """How one output is wanted."""

    transmission_mode: Literal["value"] = Field(default="value", alias="transmissionMode")
    """Only by value."""
    format: OutputFormat | None = None
    """Null: JSON."""


class FileOutputRequest(RequestModel):
    """How an output of files is wanted. Each such output adds its `format`, a choice of names, and its options."""

    transmission_mode: Literal["reference"] = Field(default="reference", alias="transmissionMode")
    """Only by reference: the result has links to the files."""


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

    def wanted(self) -> tuple[str, ...]:
        """Name the outputs that are wanted; none: all, but for files."""
        return tuple(self.outputs or ())

    def wanted_files(self) -> dict[str, FileOutputRequest]:
        """Give how those outputs are wanted that are files."""
        return {}


class WantedOutputs(RequestModel):
    """Wanted outputs by name: of files as each allows, all others as JSON."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, OutputRequest]


class ExecuteForFiles(ExecuteRequest[InputsT], Generic[InputsT]):
    """Inputs of a process that can make files, and how its outputs are wanted."""

    outputs: WantedOutputs | None = None  # type: ignore[assignment]
    """Wanted outputs; left out: all but files."""

    def wanted(self) -> tuple[str, ...]:
        """Name the outputs that are wanted; none: all, but for files."""
        return () if self.outputs is None else (*self.wanted_files(), *(self.outputs.__pydantic_extra__ or ()))

    def wanted_files(self) -> dict[str, FileOutputRequest]:
        """Give how those outputs are wanted that are files."""
        if self.outputs is None:
            return {}
        named = {name: getattr(self.outputs, name) for name in type(self.outputs).model_fields}
        return {name: wanted for name, wanted in named.items() if wanted is not None}


def request_model(
    inputs: type[RequestModel], file_outputs: Mapping[str, type[FileOutputRequest]]
) -> type[ExecuteRequest[Any]]:
    """Give the model of execution requests of a process.

    Parameters
    ----------
    inputs
        Its inputs.
    file_outputs
        How those of its outputs are asked for that are files.
    """
    return _request_model(inputs, tuple(file_outputs.items()))


@lru_cache(maxsize=100)
def _request_model(
    inputs: type[RequestModel], file_outputs: tuple[tuple[str, type[FileOutputRequest]], ...]
) -> type[ExecuteRequest[Any]]:
    """Make the model, which is called after the inputs."""
    stem = inputs.__name__.removesuffix("Inputs")
    doc = ExecuteRequest.__doc__
    if not file_outputs:
        base: type[ExecuteRequest[Any]] = ExecuteRequest.__class_getitem__(inputs)  # type: ignore[assignment]
        return create_model(f"Execute{stem}", __base__=base, __doc__=doc)
    fields: dict[str, Any] = {
        name: (wanted | None, Field(default=None, description=wanted.__doc__)) for name, wanted in file_outputs
    }
    outputs = create_model(f"{stem}Outputs", __base__=WantedOutputs, __doc__=WantedOutputs.__doc__, **fields)
    base = ExecuteForFiles.__class_getitem__(inputs)  # type: ignore[assignment]
    text = ExecuteForFiles.model_fields["outputs"].description
    wanted: Any = (outputs | None, Field(default=None, description=text))
    return create_model(f"Execute{stem}", __base__=base, __doc__=doc, outputs=wanted)
