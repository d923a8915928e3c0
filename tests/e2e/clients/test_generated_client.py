"""A client that a generator makes from the description of the interface registers two scans, and is typed."""

import importlib
import json
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from tests.e2e.running.running_service import RunningService

pytestmark = pytest.mark.service

SCRIPT = """
import time
from io import BytesIO
from pathlib import Path

from tieline_client import AuthenticatedClient
from tieline_client.api.files import upload_files
from tieline_client.api.jobs import get_job, get_results
from tieline_client.api.processes import execute
from tieline_client.models import (
    ExecuteRegister, FileDocuments, RegisterInputs, RegistrationDocument, ScanReference, Station, StationResult,
    StatusInfo, FilesForm,
)
from tieline_client.models.status_info_status import StatusInfoStatus
from tieline_client.types import File


def register(url: str, key: str, paths: list[Path]) -> RegistrationDocument:
    with AuthenticatedClient(base_url=url, token=key) as client:
        files = [File(payload=BytesIO(path.read_bytes()), file_name=path.name) for path in paths]
        uploaded = upload_files.sync(client=client, body=FilesForm(file=files))
        assert isinstance(uploaded, FileDocuments), uploaded
        stations = [
            Station(name=f"S{number}", scan=ScanReference(file=file.id))
            for number, file in enumerate(uploaded.files, start=1)
        ]
        body = ExecuteRegister(inputs=RegisterInputs(stations=stations))
        job = execute.sync("register", client=client, body=body)
        assert isinstance(job, StatusInfo), job
        while job.status in {StatusInfoStatus.ACCEPTED, StatusInfoStatus.RUNNING}:
            time.sleep(0.3)
            job = get_job.sync(job.job_id, client=client)
            assert isinstance(job, StatusInfo), job
        result = get_results.sync(job.job_id, client=client)
        assert isinstance(result, RegistrationDocument), result
        return result


def shift_m(station: StationResult) -> float | None:
    pose = station.world_from_scan
    return None if pose is None else pose.tx_m
"""


@pytest.fixture(scope="module")
def description(service: RunningService, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("description") / "openapi.json"
    path.write_text(json.dumps(service.http.get("/openapi.json").json()))
    return path


@pytest.fixture(scope="module")
def generated(description: Path) -> tuple[Path, str]:
    """Generate the client; give the folder of its package and what the generator said."""
    folder = description.parent / "client"
    command = ["openapi-python-client", "generate", "--path", description, "--meta", "none", "--output-path"]
    package = folder / "tieline_client"
    folder.mkdir()
    programs = Path(sys.executable).parent
    done = subprocess.run(
        [programs / command[0], *command[1:], package],
        env={"PATH": f"{programs}:/usr/bin:/bin"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    (folder / "through_the_client.py").write_text(SCRIPT)
    return folder, done.stdout + done.stderr


@pytest.fixture
def client(generated: tuple[Path, str], monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    monkeypatch.syspath_prepend(str(generated[0]))
    yield importlib.import_module("through_the_client")
    for name in [name for name in sys.modules if name.partition(".")[0] in {"tieline_client", "through_the_client"}]:
        del sys.modules[name]


def test_nothing_is_left_out_but_uploads_by_tus_which_have_clients_of_their_own(generated: tuple[Path, str]) -> None:
    said = [line for line in generated[1].splitlines() if line.startswith(("WARNING", "Unable", "Failure", "ERROR"))]
    assert said == [
        "WARNING parsing POST /uploads within uploads. Endpoint will not be generated.",
        "WARNING parsing PATCH /uploads/{upload_id} within uploads. Endpoint will not be generated.",
    ]


def test_a_type_checker_accepts_a_registration_through_it(generated: tuple[Path, str]) -> None:
    command = [
        sys.executable,
        "-m",
        "mypy",
        "--strict",
        "--follow-imports",
        "silent",
        "--config-file",
        "",
        "through_the_client.py",
    ]
    done = subprocess.run(command, cwd=generated[0], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_two_scans_are_registered_through_it(client: Any, service: RunningService, house: Sequence[Path]) -> None:
    result = client.register(service.url, "none-is-needed", list(house))
    assert result.status == "registered"
    assert [station.name for station in result.stations] == ["S1", "S2"]
    assert client.shift_m(result.stations[0]) == 0.0
    assert client.shift_m(result.stations[1]) != 0.0
    assert result.pairs[0].reasons
