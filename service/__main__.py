"""The command line: ``tieline serve | worker | migrate | register | demo | keys``, and one for each process."""

import sys

# `python -m service` looks for modules where it is called first, and would run a `typing.py` that lies there
if not sys.flags.safe_path and __package__ and not __file__.startswith(f"{sys.path[0]}/service/"):
    del sys.path[0]

import signal
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Annotated, NoReturn

import typer
from rich.console import Console

from service.client import RefusedError, UnreachableError
from service.errors import InvalidRequestError, ServiceError, to_problem
from service.refusals import OpenToAllError
from service.settings import Settings

REGISTERED, NOT_REGISTERED, BAD_INPUT, SERVICE_FAULT = 0, 1, 2, 3
EXIT_CODES = "Exit codes: 0 registered, 1 not registered, 2 bad input, 3 service fault."

DataDirectory = Annotated[
    Path | None, typer.Option(help="Where files, results and the embedded database live [default: tieline-data].")
]

app = typer.Typer(
    help="Register laser scans by straight lines, planes and cylinders.", no_args_is_help=True, add_completion=False
)


keys = typer.Typer(help="Make, revoke and list the keys of a service.", no_args_is_help=True)
app.add_typer(keys, name="keys")


@app.command()
def serve(
    host: Annotated[str | None, typer.Option(help="Address to bind to [default: 127.0.0.1].")] = None,
    port: Annotated[int | None, typer.Option(help="Port to bind to [default: 8765].", min=0, max=65535)] = None,
    data_dir: DataDirectory = None,
) -> None:
    """Run the service: web interface and worker. Settings are environment variables with the prefix TIELINE_.

    Beyond this machine (`--host 0.0.0.0`) it wants a key to exist, see `tieline keys`.
    """
    from service.launcher import serve as run_service

    settings = _settings(host=host, port=port, data_dir=data_dir)
    try:
        run_service(settings)
    except OpenToAllError as error:
        _fail(str(error), BAD_INPUT)
    except (ServiceError, OSError) as error:
        _fail(f"the service cannot run: {error}", SERVICE_FAULT)


@app.command()
def migrate() -> None:
    """Bring the database up to date and exit; `serve` does it by itself, several machines do it once beforehand."""
    from service.launcher import prepare

    try:
        prepare(_settings())
    except (ServiceError, OSError) as error:
        _fail(f"the database cannot be brought up to date: {error}", SERVICE_FAULT)


@app.command()
def worker(data_dir: DataDirectory = None) -> None:
    """Run one more worker beside a service that uses the same database and data directory."""
    from service.launcher import prepare
    from service.worker import main as run_worker

    settings = _settings(data_dir=data_dir)
    try:
        prepare(settings)
        run_worker(settings)
    except (ServiceError, OSError) as error:
        _fail(f"the worker cannot run: {error}", SERVICE_FAULT)


@app.command(epilog=EXIT_CODES)
def register(
    scans: Annotated[
        list[Path], typer.Argument(help="Scan files (E57, PTX, PLY, PCD, LAS/LAZ, text).", exists=True, dir_okay=False)
    ],
    photos: Annotated[
        Path | None,
        typer.Option(
            help="JSON file that names the photos of each station with cameras and poses (see service/PHOTOS.md); "
            "its stations may also have `levelled_std_gon`, `approximate_pose` and `point_std_m`.",
            exists=True,
            dir_okay=False,
        ),
    ] = None,
    levelled_std_gon: Annotated[
        float | None, typer.Option(help="All stations were levelled, with this standard deviation in gon.")
    ] = None,
    point_std_m: Annotated[
        float | None,
        typer.Option(help="Standard deviation of points in metres; left out: estimated from the scans."),
    ] = None,
    columns: Annotated[
        str | None,
        typer.Option(
            help="What the columns of text files are, such as row,col,x,y,z,i; left out: as named in them, or as found."
        ),
    ] = None,
    unit: Annotated[
        str | None,
        typer.Option(help="Unit of the coordinates: mm, m, ft or us-ft; left out: as the files declare, else metres."),
    ] = None,
    method: Annotated[
        str | None,
        typer.Option(
            help="auto, lines, planes, icp-plane, icp-point, icp-d2, planes-triples, ndt, ndt-3d, egi, lines-compat, "
            "lines-alshawa, icl or targets."
        ),
    ] = None,
    compare_methods: Annotated[
        str | None,
        typer.Option(help="Methods to lay beside it on every pair, separated by commas: lines,planes-triples,ndt."),
    ] = None,
    pairs: Annotated[
        str | None,
        typer.Option(help="Which pairs of stations to try, as target:source, separated by commas, or `auto`."),
    ] = None,
    reference: Annotated[
        Path | None,
        typer.Option(
            help="JSON file with known poses by station, to compare with: 4x4 matrices, or objects with `matrix`.",
            exists=True,
            dir_okay=False,
        ),
    ] = None,
    control: Annotated[
        Path | None,
        typer.Option(
            help="Known points: a text table with columns name, x, y, z, std, use (control or check), or a JSON file "
            "(ending .json) with a list of such points; poses come in their frame.",
            exists=True,
            dir_okay=False,
        ),
    ] = None,
    targets: Annotated[
        Path | None,
        typer.Option(
            help="JSON file with the survey targets of stations by name: lists of name, x, y, z, std (or covariance).",
            exists=True,
            dir_okay=False,
        ),
    ] = None,
    find_targets: Annotated[
        str | None,
        typer.Option(
            help="Kinds of targets to look for in the scans, with their sizes in metres: sphere:0.0725 (radius), "
            "board:0.3, retro-square:0.05, retro-cylinder:0.05."
        ),
    ] = None,
    crs: Annotated[
        str | None, typer.Option(help="Map projection of the control, such as EPSG:25832; left out: it is Cartesian.")
    ] = None,
    control_axes: Annotated[
        str | None, typer.Option(help="east-north-height, or north-east-height (left-handed).")
    ] = None,
    fix: Annotated[
        str | None,
        typer.Option(help="Whose frame becomes that of the world: first-station, a station's name, control or free."),
    ] = None,
    options: Annotated[
        Path | None,
        typer.Option(
            help="JSON file with any inputs of the request, as `POST /processes/register/execution` takes them; of "
            "`stations` what differs from the scans' own. Options given here come first.",
            exists=True,
            dir_okay=False,
        ),
    ] = None,
    registered: Annotated[
        str | None,
        typer.Option(
            help="Also the registered scans as files: e57 (uploaded E57 come back with new poses and all else as it "
            "was), laz, copc, ply, pcd, ptx, pts, xyz, or poses alone for other programs."
        ),
    ] = None,
    registered_merge: Annotated[
        bool, typer.Option("--registered-merge", help="Of the registered scans one file with all stations.")
    ] = False,
    registered_crs: Annotated[
        str | None, typer.Option(help="Coordinate reference system of the common frame, such as EPSG:25832.")
    ] = None,
    registered_std: Annotated[
        bool, typer.Option("--registered-std", help="With the standard deviation of each point's position.")
    ] = False,
    url: Annotated[
        str | None, typer.Option(help="Address of a running service; without one a service is started for this job.")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            help="Folder for all that comes out: result.json, report, poses, lines … (a file for the result alone "
            "where the name ends in .json); without it, tieline-<time> here."
        ),
    ] = None,
    key: Annotated[
        str | None,
        typer.Option(
            envvar="TIELINE_KEY",
            show_envvar=True,
            help="Key for a running service that wants one; better in the environment, where others do not see it.",
        ),
    ] = None,
) -> None:
    """Register two or more scans; the first gives the common frame."""
    from service.register_command import default_output, register_files
    from service.register_request import RequestOptions

    said = RequestOptions(
        photos=photos,
        options=options,
        method=method,
        compare_methods=compare_methods,
        pairs=pairs,
        reference=reference,
        control=control,
        targets=targets,
        find_targets=find_targets,
        crs=crs,
        control_axes=control_axes,
        fix=fix,
        levelled_std_gon=levelled_std_gon,
        point_std_m=point_std_m,
        columns=columns,
        unit=unit,
        registered=None
        if registered is None
        else {
            "format": registered,
            "merge": registered_merge,
            "crs": registered_crs,
            "per_point_std": registered_std,
        },
    )
    folder = output or default_output(datetime.now())  # noqa: DTZ005 - the user's own clock
    _finish(lambda: register_files(scans, said, url, folder, Console(), key=key))


@app.command(epilog=EXIT_CODES)
def demo(
    scans: Annotated[
        Path | None, typer.Option(help="Folder to leave the simulated scan files and the report in.")
    ] = None,
    plan: Annotated[Path | None, typer.Option(help="SVG file for a plan of the lines with the verdict.")] = None,
) -> None:
    """Simulate two stations of a house, register them over HTTP, print truth beside estimate."""
    from service.demo import run_demo

    console = Console()
    _finish(lambda: run_demo(console, scans, plan))


@keys.command()
def create(
    name: Annotated[str, typer.Argument(help="Name of the key, for people.")],
    project: Annotated[
        str | None,
        typer.Option(
            help="Whose files and jobs it sees; keys of one project see the same, others nothing of it. `default` is "
            "the project of all that was made without keys [default: one called like the key]."
        ),
    ] = None,
    scopes: Annotated[str, typer.Option(help="What it is good for: read, write, admin, metrics.")] = "read,write",
    expires: Annotated[
        str | None, typer.Option(help="When it ends by itself: a date, or days such as 90d [default: never].")
    ] = None,
    data_dir: DataDirectory = None,
) -> None:
    """Make a key and print its secret, which nobody can find out again. From then on the service wants keys."""
    from service.keys_command import make_key

    settings = _settings(data_dir=data_dir)
    _manage(lambda: print(make_key(settings, name, project, scopes, expires, Console(stderr=True))))


@keys.command()
def revoke(
    key: Annotated[str, typer.Argument(help="Id of a key, or the name of a valid one.")], data_dir: DataDirectory = None
) -> None:
    """Revoke a key for good."""
    from service.keys_command import revoke as revoke_key

    _manage(lambda: revoke_key(_settings(data_dir=data_dir), key, Console(stderr=True)))


@keys.command("list")
def list_keys(data_dir: DataDirectory = None) -> None:
    """List all keys, without their secrets."""
    from service.keys_command import show_keys

    _manage(lambda: show_keys(_settings(data_dir=data_dir), Console()))


@keys.command()
def callback(
    receiver: Annotated[str, typer.Argument(help="Address of the receiver, such as https://hooks.example.org.")],
    project: Annotated[str, typer.Option(help="Whose jobs it is told about.")] = "default",
    process: Annotated[str, typer.Option(help="Of which process.")] = "register",
) -> None:
    """Print the secret by which a receiver knows what it is told of a process (needs TIELINE_CALLBACK_SECRET)."""
    from service.keys_command import callback_secret

    _manage(lambda: print(callback_secret(_settings(), receiver, project, process)))


def _manage(work: Callable[[], None]) -> None:
    """Do something about keys on the machine that has the database."""
    from sqlalchemy.exc import SQLAlchemyError

    try:
        work()
    except ServiceError as error:
        faults = error.faults if isinstance(error, InvalidRequestError) else ()
        details = "".join(f"\n  {fault.pointer.lstrip('/')}: {fault.detail}" for fault in faults)
        _fail(f"{error}{details}", BAD_INPUT)
    except (SQLAlchemyError, OSError) as error:
        _fail(f"the database cannot be used: {error}", SERVICE_FAULT)


def _finish(work: Callable[[], bool]) -> None:
    """End the process with the code that tells what came out."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))  # so that what was started is stopped
    try:
        code = REGISTERED if work() else NOT_REGISTERED
    except RefusedError as error:
        message = "\n".join([str(error), *getattr(error, "__notes__", [])])
        _fail(message, BAD_INPUT if error.status < 500 else SERVICE_FAULT)
    except InvalidRequestError as error:
        _fail(str(RefusedError(to_problem(error))), BAD_INPUT)
    except UnreachableError as error:
        _fail(str(error), SERVICE_FAULT)
    except OSError as error:
        _fail(f"the results cannot be written: {error}", SERVICE_FAULT)
    raise typer.Exit(code)


def _fail(message: str, code: int) -> NoReturn:
    Console(stderr=True).print(message, style="red", markup=False)
    raise typer.Exit(code)


def _settings(**given: object) -> Settings:
    """Read the environment; options of the command line come first."""
    return Settings(**{name: value for name, value in given.items() if value is not None})  # type: ignore[arg-type]


def add_processes() -> None:
    """Add a command for every process that takes files and has none yet."""
    from service.process_command import process_command, takes_files
    from service.processes import PROCESSES

    for process in PROCESSES:
        if takes_files(process) and process.id != "register":
            epilog = "Exit codes: 0 done, 2 bad input, 3 service fault."
            app.command(process.id, help=process.description, epilog=epilog)(process_command(process, _finish))


def main() -> None:
    """Run the command line."""
    written = {command.name or getattr(command.callback, "__name__", "") for command in app.registered_commands}
    if sys.argv[1:2] != ["keys"] and written.isdisjoint(sys.argv[1:2]):  # these need not wait for all schemas
        add_processes()
    app()


if __name__ == "__main__":
    main()
