"""Register scan files from the command line, through a running service or an embedded one."""

import json
import re
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, DownloadColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from service.client import ServiceClient
from service.embedded import embedded_service
from service.errors import InvalidRequestError
from service.result_tables import print_result
from service.settings import Settings
from service.use_cases.read_photo_list import PhotoList, read_photo_list
from service.use_cases.service_proof import secret_of
from service.use_cases.uploaded_stations import UploadedFile, stations_of_uploads

Document = dict[str, Any]


def register_files(
    paths: Sequence[Path],
    photos: Path | None,
    url: str | None,
    output: Path | None,
    console: Console,
    *,
    known: Document | None = None,
    key: str | None = None,
) -> bool:
    """Upload, register, print the parameters; tell whether all stations were registered.

    Parameters
    ----------
    paths
        Scan files.
    photos
        JSON file with inputs of `register` whose stations name photos; None for scans alone.
    url
        Address of a running service.
    output
        Where to write the result document.
    console
        Where to print.
    known
        What holds for every station of which the JSON file does not say otherwise, such as ``levelled_std_gon``.
    key
        For a running service that wants one.

    Raises
    ------
    InvalidRequestError
        The photos cannot be assigned to stations.
    RefusedError
        A file or the whole job was refused.
    UnreachableError
        No service answers.
    """
    listed = PhotoList({}, []) if photos is None else read_photo_list(photos, paths)
    with chosen_service(url, console) as address, ServiceClient(address, key=key) as client:
        files = upload_files(client, [*paths, *listed.paths], console)
        stations = stations_with_photos(listed, files[: len(paths)], files[len(paths) :])
        stations = [{**(known or {}), **station} for station in stations]
        result = run_job(client, "register", {**listed.inputs, "stations": stations}, console)
    if output is not None:
        output.write_text(json.dumps(result, indent=1), encoding="utf-8")
    print_result(console, result)
    return bool(result["status"] == "registered")


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


def upload_files(client: ServiceClient, paths: Sequence[Path], console: Console) -> list[Document]:
    """Upload files one after the other, with a bar each."""
    files = []
    columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console) as bars:
        for path in paths:
            bar = bars.add_task(f"uploading {path.name}", total=path.stat().st_size)
            files.append(client.upload(path, partial(bars.advance, bar)))
    return files


def run_job(client: ServiceClient, process_id: str, inputs: Document, console: Console) -> Document:
    """Start a job and wait for its result with a bar; a break from the keyboard dismisses it."""
    job_id = client.execute(process_id, inputs)
    console.print(f"{client.url}/jobs/{job_id}", style="dim")
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    try:
        with Progress(*columns, console=console) as bars:
            bar = bars.add_task("waiting", total=100)
            return client.wait(
                job_id, lambda percent, message: bars.update(bar, completed=percent, description=message)
            )
    except KeyboardInterrupt:
        client.dismiss(job_id)
        raise


def stations_with_photos(listed: PhotoList, scans: Sequence[Document], photos: Sequence[Document]) -> list[Document]:
    """Make stations of uploaded scans, named after their files, with the photos that the list or the files have.

    Raises
    ------
    InvalidRequestError
        The list names a scan that is not there, or several of one name.
    """
    identifiers = {path: photo["id"] for path, photo in zip(listed.paths, photos, strict=True)}
    names = [station["name"] for station in stations_of(scans)]
    return stations_of_uploads(listed.stations(identifiers), _uploaded(scans), _uploaded(photos), names)


def _uploaded(files: Sequence[Document]) -> list[UploadedFile]:
    return [UploadedFile(file["id"], file["name"], file["scans"], file["photos"]) for file in files]


def stations_of(files: Sequence[Document]) -> list[Document]:
    """Make one station of each scan, named after its file."""
    stations: list[Document] = []
    taken: set[str] = set()
    for file in files:
        for scan in file["scans"]:
            stem = _station_name(Path(file["name"]).stem)
            wanted = stem if len(file["scans"]) == 1 else f"{stem}-{scan['index'] + 1}"
            name, number = wanted, 2
            while name in taken:
                name, number = f"{wanted} ({number})", number + 1
            taken.add(name)
            stations.append({"name": name, "scan": {"file": file["id"], "index": scan["index"]}})
    return stations


def _station_name(text: str) -> str:
    """Replace what a station's name may not hold."""
    cleaned = re.sub(r"[^\w .()+-]", "_", text)[:48]
    return cleaned if re.match(r"\w", cleaned) else f"scan{cleaned}"
