"""What a process is: what goes in, the plan by which it is computed, what comes out."""

from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

from pydantic import BaseModel

from schemas.requests.execution import ExecuteRequest, FileOutputRequest, request_model
from schemas.resources.processes import JobControlOption
from schemas.values.base import RequestModel
from service.ports.documents import Json
from service.ports.files import FileStore
from service.ports.jobs import JobStore
from service.ports.steps import Plan
from service.settings import Settings

InputsT = TypeVar("InputsT", bound=RequestModel)


@dataclass(frozen=True)
class Stored:
    """What a request may refer to: all there is for its project."""

    files: FileStore
    jobs: JobStore
    settings: Settings


def _accept(_inputs: RequestModel, _stored: Stored) -> None:
    """Find nothing wrong: the schema says all."""


def _accept_files(_inputs: RequestModel, _wanted: Mapping[str, FileOutputRequest]) -> None:
    """Find nothing wrong likewise."""


def _without_open3d(_inputs: RequestModel, _wanted: Mapping[str, FileOutputRequest]) -> bool:
    """Compute everything without open3d."""
    return False


@dataclass(frozen=True)
class Process(Generic[InputsT]):
    """One process. All that the service does with processes follows from it; `service.processes` lists them."""

    id: str
    """As in addresses: a verb and its object, such as ``detect-edges``."""
    title: str
    description: str
    inputs: type[InputsT]
    """The schema of a request's `inputs`."""
    outputs: type[BaseModel]
    """The schema of the result document, of which every member is an output of its own."""
    plan: Plan
    """What is computed. Its last stage writes ``jobs/<id>/result.json``."""
    steps: Mapping[str, str] = field(default_factory=dict)
    """Its own steps: ``module:function`` by name. It is loaded where the step runs, so that the web process knows
    nothing of what computes. Steps that all may use stand in `service.use_cases.steps`."""
    check: Callable[[InputsT, Stored], None] = _accept
    """Raises InvalidRequestError, with a pointer to every bad field, for what no schema can know."""
    file_outputs: Mapping[str, type[FileOutputRequest]] = field(default_factory=dict)
    """Outputs that are files, made only where a request wants them: how each is asked for. Of the same name there is a
    member of the result document, a list of downloads, which is missing when it was not wanted."""
    document_inputs: tuple[str, ...] = ()
    """Inputs that are documents of their own: on the command line they are JSON files, the first as the argument."""
    check_files: Callable[[InputsT, Mapping[str, FileOutputRequest]], None] = _accept_files
    """Raises InvalidRequestError likewise, for files that are wanted by name and do not go with the inputs."""
    needs_open3d: Callable[[InputsT, Mapping[str, FileOutputRequest]], bool] = _without_open3d
    """Tells whether a request, with the files that it wants, needs open3d, and so libraries of the system."""
    answer: Callable[[Json], Awaitable[Json]] | None = None
    """Gives all outputs at once, from the inputs; None: it is computed by a worker."""
    version: str = "1.0.0"

    @property
    def job_control(self) -> tuple[JobControlOption, ...]:
        """Tell how it may be run."""
        in_background: tuple[JobControlOption, ...] = ("async-execute", "dismiss")
        return ("sync-execute", *in_background) if self.synchronous else in_background

    @property
    def synchronous(self) -> bool:
        """Tell whether it may answer at once."""
        return self.answer is not None

    @property
    def request_model(self) -> type[ExecuteRequest[Any]]:
        """Give the model of an execution request."""
        return request_model(self.inputs, self.file_outputs)

    @property
    def output_names(self) -> set[str]:
        """Give the names of all outputs."""
        return {member.serialization_alias or name for name, member in self.outputs.model_fields.items()}
