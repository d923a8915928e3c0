"""One command for each process whose inputs are files and options, made from the schema of its inputs."""

import inspect
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeAlias, Union, get_args, get_origin

import typer
from pydantic import BaseModel
from rich.console import Console
from rich.markup import escape

from schemas.requests.posed_stations import PosedInputs, PosedStation, StationsOfJob
from schemas.requests.register_inputs import ScanReference, Station
from schemas.values.file_references import FileReference
from service.client import ServiceClient
from service.errors import FieldFault, InvalidRequestError
from service.ports import Process
from service.register_command import (
    chosen_service,
    default_output,
    keep_results,
    start_job,
    stations_of,
    upload_files,
    wait_for_job,
)
from service.register_request import document_in, object_in, table_in
from service.use_cases.inputs.validate_request import parse_json

Document: TypeAlias = dict[str, Any]
Way: TypeAlias = tuple[str, ...]
PLAIN = (bool, int, float, str)
POSES_OF_FILES = ("file", "ignore")
"""What `--poses` may say in place of a file."""


@dataclass(frozen=True)
class _Files:
    """An input that is a file, or a list of files."""

    name: str
    kind: type[Any]
    many: bool
    of_job: bool
    """Whether the stations of a finished job may stand there instead."""
    needed: bool
    """Whether there must be any."""
    help: str


@dataclass(frozen=True)
class _Option:
    """An option and where its value goes in the request."""

    way: Way
    kind: Any
    help: str
    read: Callable[[str], Any] | None = None
    """Turns text into the value; None: it is the value."""

    @property
    def parameter(self) -> str:
        """Name the parameter of the function."""
        return "_".join(self.way)

    @property
    def flag(self) -> str:
        """Name the option on the command line."""
        return "--" + "-".join(self.way[1:]).replace("_", "-").lower()


def takes_files(process: Process[Any]) -> bool:
    """Tell whether a process can be run from the command line: what it computes with are files or a document."""
    return bool(process.document_inputs) or any(isinstance(each, _Files) for each in _inputs(process.inputs))


def process_command(process: Process[Any], finish: Callable[[Callable[[], bool]], None]) -> Callable[..., None]:
    """Make the function behind a command: its signature has an argument or option for everything that a request has.

    Parameters
    ----------
    process
        Which is run.
    finish
        Runs the work and ends the program.
    """
    inputs = list(_inputs(process.inputs, without=process.document_inputs))
    files = [each for each in inputs if isinstance(each, _Files)]
    options = [each for each in inputs if isinstance(each, _Option)]
    for name, wanted in process.file_outputs.items():
        options += _of_model(wanted, ("outputs", name))

    def run(**given: Any) -> None:
        finish(lambda: _run(process, files, options, given))

    named = [*_document_parameters(process), *_file_parameters(files)]
    parameters = [*named, *map(_option_parameter, options), *_common_parameters(files)]
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {each.name: each.annotation for each in parameters}
    run.__doc__ = process.description
    return run


def _run(process: Process[Any], files: Sequence[_Files], options: Sequence[_Option], given: Document) -> bool:
    """Upload, run, keep what comes out."""
    console = Console()
    request: Document = {"inputs": {} if given["options"] is None else object_in(given["options"])}
    for name in process.document_inputs:
        if given[name] is not None:
            request["inputs"][name] = document_in(given[name])
    for option in options:
        if given[option.parameter] is not None:
            _put(request, option.way, _read(option, given[option.parameter]))
    folder = given["output"] or default_output(datetime.now())  # noqa: DTZ005 - the user's own clock
    with chosen_service(given["url"], console) as address, ServiceClient(address, key=given["key"]) as client:
        for each in files:
            _put_files(request["inputs"], each, given, client, console)
        if "outputs" in request:  # who names one output gets it alone
            others = process.output_names - process.file_outputs.keys()
            request["outputs"] = {**{name: {} for name in sorted(others)}, **request["outputs"]}
        job_id = start_job(client, process.id, request["inputs"], console, request.get("outputs"))
        keep_results(client, job_id, wait_for_job(client, job_id, console), folder)
    console.print(f"results: {folder}")
    return True


def _put_files(inputs: Document, files: _Files, given: Document, client: ServiceClient, console: Console) -> None:
    """Upload the files of an input, and put what the service calls them, or the job that has them, in their place."""
    name, said = files.name, inputs.get(files.name)
    job_id = given.get(_job_parameter(name)) if files.of_job else None
    if job_id is not None:
        inputs[name] = {"jobID": job_id}
    paths = [path for path in _as_list(given[name]) if path is not None]
    if not paths:
        return
    uploaded = upload_files(client, paths, console, given.get("columns"))
    scan = {} if given.get("unit") is None else {"unit": given["unit"]}
    if issubclass(files.kind, FileReference):
        made = [{**(scan if issubclass(files.kind, ScanReference) else {}), "file": each["id"]} for each in uploaded]
    else:
        made = [{**station, "scan": {**station["scan"], **scan}} for station in stations_of(uploaded)]
        said_poses = given.get("poses")
        if said_poses in POSES_OF_FILES:
            inputs["poses"] = said_poses
        poses = {} if said_poses is None or said_poses in POSES_OF_FILES else object_in(Path(said_poses))
        for station in made:
            if station["name"] in poses:
                station["world_from_scan"] = poses[station["name"]]
    if not files.many:
        inputs[name] = {**(said if isinstance(said, dict) else {}), **made[0]}
        return
    known = {each.get("name"): each for each in said or () if isinstance(each, dict)}
    inputs[name] = [{**known.get(each.get("name"), {}), **each} for each in made]


def _inputs(model: type[BaseModel], *, without: Sequence[str] = ()) -> Iterator[_Files | _Option]:
    """Find what can be said on the command line of the inputs of a process, all but some."""
    for name, field in model.model_fields.items():
        if name in without or (name == "poses" and issubclass(model, PosedInputs)):  # has an option of its own
            continue
        members, text = list(_members(field.annotation)), field.description or ""
        lists = [(get_args(each) or (None,))[0] for each in members if get_origin(each) is list]
        for kind, many in [*((each, False) for each in members), *((each, True) for each in lists)]:
            if inspect.isclass(kind) and issubclass(kind, FileReference | Station | PosedStation):
                yield _Files(name, kind, many, StationsOfJob in members, field.is_required(), text)
                break
        else:
            yield from _of_field(members, ("inputs", field.alias or name), text)


def _of_model(model: type[BaseModel], way: Way) -> Iterator[_Option]:
    for name, field in model.model_fields.items():
        if name == "transmission_mode":
            continue
        yield from _of_field(list(_members(field.annotation)), (*way, field.alias or name), field.description or "")


def _of_field(members: Sequence[Any], way: Way, text: str) -> Iterator[_Option]:
    kinds = [each for each in members if each is not NoneType]
    if len(kinds) == 1 and inspect.isclass(kinds[0]) and issubclass(kinds[0], BaseModel):
        yield from _of_model(kinds[0], way)
    elif len(kinds) == 1 and kinds[0] in PLAIN:
        yield _Option(way, kinds[0], text)
    elif kinds and all(get_origin(each) is Literal for each in kinds):
        names = [str(name) for each in kinds for name in get_args(each)]
        yield _Option(way, str, f"{text} One of: {', '.join(names)}.")
    else:
        words = {str(name) for each in kinds if get_origin(each) is Literal for name in get_args(each)}
        yield _Option(way, str, f"{text} As JSON.", lambda said: said if said in words else _json(said))


def _members(annotation: Any) -> Iterator[Any]:
    """Take apart what a field may be."""
    if get_origin(annotation) is Annotated:
        yield from _members(get_args(annotation)[0])
    elif get_origin(annotation) in {Union, UnionType}:
        for each in get_args(annotation):
            yield from _members(each)
    else:
        yield annotation


def _document_parameters(process: Process[Any]) -> Iterator[inspect.Parameter]:
    """Give the inputs that are JSON files of their own, the first as argument."""
    for number, name in enumerate(process.document_inputs):
        text = escape(f"File. {process.inputs.model_fields[name].description or ''}")
        if number == 0:
            yield _parameter(name, Path, typer.Argument(exists=True, dir_okay=False, help=text), ...)
        else:
            option = typer.Option(f"--{name.replace('_', '-')}", exists=True, dir_okay=False, help=text)
            yield _parameter(name, Path | None, option, None)


def _file_parameters(files: Sequence[_Files]) -> Iterator[inspect.Parameter]:
    """Give the first input of files as arguments, others as options."""
    for number, each in enumerate(files):
        kind: Any = list[Path] if each.many else Path
        flag, text = each.name.replace("_", "-"), escape(each.help)
        if number == 0:
            said = typer.Argument(exists=True, dir_okay=False, help=text)
            optional = each.of_job or not each.needed
            yield _parameter(each.name, kind | None if optional else kind, said, None if optional else ...)
        else:
            yield _parameter(each.name, kind | None, typer.Option(f"--{flag}", exists=True, help=text), None)
        if each.of_job:
            text = "Instead of files: id of a finished registration of the service, whose stations they are."
            option = typer.Option("--job" if number == 0 else f"--{flag}-job", help=text)
            yield _parameter(_job_parameter(each.name), str | None, option, None)


def _option_parameter(option: _Option) -> inspect.Parameter:
    flag = option.flag
    # the format of an output goes by the name of the output alone: --registered e57
    if option.way[0] == "outputs" and option.way[-1] == "format":
        flag = flag.removesuffix("-format")
    names = [f"{flag}/--no-{flag[2:]}"] if option.kind is bool else [flag]
    return _parameter(option.parameter, option.kind | None, typer.Option(*names, help=escape(option.help)), None)


def _common_parameters(files: Sequence[_Files]) -> Iterator[inspect.Parameter]:
    if any(not issubclass(each.kind, FileReference) or issubclass(each.kind, ScanReference) for each in files):
        columns = "What the columns of text files are, such as row,col,x,y,z,i; left out: as named in them or as found."
        unit = "Unit of the coordinates: mm, m, ft or us-ft; left out: as the files declare, else metres."
        yield _parameter("columns", str | None, typer.Option(help=columns), None)
        yield _parameter("unit", str | None, typer.Option(help=unit), None)
    if any(issubclass(each.kind, PosedStation) for each in files):
        poses = (
            "JSON file with the pose of each station by name: 4x4 matrices, or objects with `matrix`. Or `ignore`: "
            "poses that E57 and PTX files state are not taken (`file`, the default, takes them)."
        )
        yield _parameter("poses", str | None, typer.Option(help=poses), None)
    options = "JSON file with any inputs of the request; options given here come first."
    yield _parameter("options", Path | None, typer.Option(help=options, exists=True, dir_okay=False), None)
    url = "Address of a running service; without one a service is started for this job."
    yield _parameter("url", str | None, typer.Option(help=url), None)
    output = "Folder for all that comes out; without it, tieline-<time> here."
    yield _parameter("output", Path | None, typer.Option(help=output), None)
    key = "Key for a running service that wants one; better in the environment, where others do not see it."
    yield _parameter("key", str | None, typer.Option(help=key, envvar="TIELINE_KEY", show_envvar=True), None)


def _parameter(name: str, kind: Any, said: Any, default: Any) -> inspect.Parameter:
    given = inspect.Parameter.empty if default is ... else default
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=given, annotation=Annotated[kind, said])


def _job_parameter(name: str) -> str:
    return f"{name}_job"


def _as_list(given: Any) -> list[Any]:
    return given if isinstance(given, list) else [given]


def _read(option: _Option, value: Any) -> Any:
    try:
        return value if option.read is None else option.read(value)
    except InvalidRequestError as error:
        raise InvalidRequestError(str(error), [FieldFault(option.flag, str(error))]) from None


def _json(text: str) -> Any:
    return table_in(Path(text)) if text.endswith((".csv", ".txt")) else parse_json(text.encode())


def _put(document: Document, way: Way, value: Any) -> None:
    for name in way[:-1]:
        document = document.setdefault(name, {})
    document[way[-1]] = value
