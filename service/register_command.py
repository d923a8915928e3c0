"""Register scan files from the command line, through a running service or an embedded one."""

import errno
import json
import os
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, DownloadColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from schemas.values.text_columns import TEXT_ENDINGS
from service.client import ServiceClient
from service.embedded import embedded_service
from service.errors import InvalidRequestError
from service.names.result_lists import STREAMED
from service.processes.register import REGISTER
from service.register_request import RequestOptions, read_request
from service.result_tables import print_report_place, print_result
from service.settings import Settings
from service.use_cases.access.service_proof import secret_of
from service.use_cases.documents.scan_warnings import is_usable
from service.use_cases.inputs.read_photo_list import PhotoList
from service.use_cases.jobs.uploaded_stations import UploadedFile, names_of_scans, stations_of_uploads

Document = dict[str, Any]
LINE_INTERVAL_S = 5.0


def register_files(
    paths: Sequence[Path],
    said: RequestOptions,
    url: str | None,
    output: Path,
    console: Console,
    *,
    key: str | None = None,
) -> bool:
    """Upload, register, keep all that comes out, print the parameters; tell whether all stations were registered.

    Parameters
    ----------
    paths
        Scan files.
    said
        What else was said of the job.
    url
        Address of a running service.
    output
        Folder for the result document and all downloads; a name that ends in ``.json`` is that of a file for the
        document alone.
    console
        Where to print.
    key
        For a running service that wants one.

    Raises
    ------
    InvalidRequestError
        The options make no sense, or photos cannot be assigned to stations.
    RefusedError
        A file or the whole job was refused.
    UnreachableError
        No service answers.
    OSError
        The results cannot be written.
    """
    listed = read_request(said, paths)
    check_writable(output)
    with chosen_service(url, console) as address, ServiceClient(address, key=key) as client:
        files = upload_files(client, paths, console, said.columns) + upload_files(client, listed.paths, console)
        for file in files[: len(paths)]:
            for warning in file.get("warnings") or []:
                console.print(f"{file['name']}: {warning}", style="yellow", markup=False)
        stations = stations_with_photos(listed, files[: len(paths)], files[len(paths) :])
        stations = [said.completed(station) for station in stations]
        outputs = said.outputs(REGISTER.output_names - REGISTER.file_outputs.keys())
        job_id = start_job(client, REGISTER.id, {**listed.inputs, "stations": stations}, console, outputs)
        result = wait_for_job(client, job_id, console)
        keep_results(client, job_id, result, output)
    print_result(console, result)
    console.print(f"results: {output}")
    print_report_place(console, output)
    return bool(result["status"] == "registered")


def default_output(now: datetime) -> Path:
    """Name the folder in which results are kept where nothing is said."""
    return Path(f"tieline-{now:%Y%m%d-%H%M%S}")


def check_writable(output: Path) -> None:
    """Find out before anything is computed whether its results can be written.

    Raises
    ------
    OSError
        They cannot.
    """
    place = output.absolute()
    while not place.exists():
        place = place.parent
    wants_file = place == output.absolute() and output.suffix.lower() == ".json"
    if not place.is_dir() and not wants_file:
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(place))
    if not os.access(place, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(place))


def keep_results(client: ServiceClient, job_id: str, result: Document, output: Path) -> None:
    """Write the result document, and all that the job offers besides, before the service goes.

    The lists of a large network, which do not stand in the document, become files with an entry on each line.
    """
    text = json.dumps(result, indent=1)
    if output.suffix.lower() == ".json":
        output.parent.mkdir(parents=True, exist_ok=True)
        output.write_text(text, encoding="utf-8")
        return
    output.mkdir(parents=True, exist_ok=True)
    (output / "result.json").write_text(text, encoding="utf-8")
    for name in client.artifacts(job_id):
        # names come from the service, which may be another one
        client.download(job_id, name, output / Path(name).name)
    for name in result.get("lists") or {}:
        client.download_list(job_id, name, output / f"{Path(name).name}{STREAMED}")


@contextmanager
def chosen_service(url: str | None, console: Console) -> Iterator[str]:
    """Give the address asked for, that of this user's service if it runs, or an embedded service's.

    Raises
    ------
    InvalidRequestError
        Something answers as if it were a service, and does not prove to be this user's.
    """
    settings = Settings()
    usual = f"http://{settings.host}:{settings.port}"
    if url is not None:
        yield url
        return
    with ServiceClient(usual) as client:
        own = client.proves(secret_of(settings.data_dir))
        if not own and client.is_tieline():
            raise InvalidRequestError(
                f"at {usual} something answers that does not prove to be your service: anybody may have taken its "
                f"place. --url {usual} sends your scans there all the same; TIELINE_DATA_DIR says where your service "
                "has its data"
            )
    if own:
        console.print(f"using the service at {usual}", style="dim")
        yield usual
        return
    with ExitStack() as running:
        with console.status("starting the service"):
            address = running.enter_context(embedded_service())
        yield address


def upload_files(
    client: ServiceClient, paths: Sequence[Path], console: Console, columns: str | None = None
) -> list[Document]:
    """Upload files one after the other, with a bar each; `columns` are those of text tables."""
    files = []
    tables = [path for path in paths if path.name.lower().endswith(TEXT_ENDINGS)] or paths
    parts = (TextColumn("{task.description}"), BarColumn(), DownloadColumn(), TimeElapsedColumn())
    with Progress(*parts, console=console) as bars:
        for path in paths:
            bar = bars.add_task(f"uploading {path.name}", total=path.stat().st_size)
            stated = columns if path in tables else None
            files.append(client.upload(path, partial(bars.advance, bar), stated))
    return files


def start_job(
    client: ServiceClient, process_id: str, inputs: Document, console: Console, outputs: Document | None = None
) -> str:
    """Start a job, tell its address, give its id."""
    job_id = client.execute(process_id, inputs, outputs)
    console.print(f"{client.url}/jobs/{job_id}", style="dim")
    return job_id


def wait_for_job(client: ServiceClient, job_id: str, console: Console) -> Document:
    """Wait for the result of a job with a bar, or line by line where nothing moves; a break from the keyboard
    dismisses it.
    """
    try:
        if not console.is_terminal:
            return client.wait(job_id, ProgressLines(console).tell)
        columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
        with Progress(*columns, console=console) as bars:
            bar = bars.add_task("waiting", total=100)
            return client.wait(
                job_id, lambda percent, message: bars.update(bar, completed=percent, description=message)
            )
    except KeyboardInterrupt:
        client.dismiss(job_id)
        raise


class ProgressLines:
    """Print what a job does as lines: each step when it begins, and what is said of it now and then."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._told: dict[str, tuple[str, float]] = {}

    def tell(self, percent: int, message: str) -> None:
        """Print a line if there is news of the step, several of which may take turns in what is said."""
        step, now = message.partition(":")[0], time.monotonic()
        last, next_time = self._told.get(step, ("", 0.0))
        if message != last and now >= next_time:
            self._console.print(f"{percent:3d} % {message}", markup=False, highlight=False, soft_wrap=True)
            self._told[step] = message, now + LINE_INTERVAL_S


def stations_with_photos(listed: PhotoList, scans: Sequence[Document], photos: Sequence[Document]) -> list[Document]:
    """Make stations of uploaded scans, named after their files, with the photos that the list or the files have.

    Raises
    ------
    InvalidRequestError
        The list names a scan that is not there, or several of one name.
    """
    identifiers = {path: photo["id"] for path, photo in zip(listed.paths, photos, strict=True)}
    uploaded = _uploaded(scans)
    names = names_of_scans(uploaded)
    return stations_of_uploads(listed.stations(identifiers), uploaded, _uploaded(photos), names)


def _uploaded(files: Sequence[Document]) -> list[UploadedFile]:
    return [UploadedFile(file["id"], file["name"], file["scans"], file["photos"]) for file in files]


def stations_of(files: Sequence[Document]) -> list[Document]:
    """Make one station of each scan, named after its file."""
    places = [(file["id"], scan["index"]) for file in files for scan in file["scans"] if is_usable(scan)]
    return [
        {"name": name, "scan": {"file": file, "index": index}}
        for name, (file, index) in zip(names_of_scans(_named(files)), places, strict=True)
    ]


def _named(files: Sequence[Document]) -> list[UploadedFile]:
    return [UploadedFile(file["id"], file["name"], file["scans"], ()) for file in files]
