"""The client behind the command line, against the real application over memory adapters."""

import asyncio
import json
import math
from pathlib import Path
from typing import Any

import httpx
import pytest
from rich.console import Console

from service.client import RefusedError, ServiceClient, UnreachableError
from service.demo import print_comparison
from service.dependencies import Adapters
from service.names.result_lists import rows_key
from service.ports import Job
from service.register_command import (
    ProgressLines,
    check_writable,
    keep_results,
    stations_of,
    upload_files,
    wait_for_job,
)
from service.result_tables import print_result
from service.routes.accepted_types import accepts_plain_json_only, prefers_html
from service.settings import Settings
from tests.doubles.application import create_app
from tests.doubles.memory import MemoryBlobStore, MemoryFileStore, MemoryJobLog, MemoryJobStore, MemoryQueue

SCAN = {"index": 0, "name": "", "points": 3, "structured": False, "bounds_m": [[0.0] * 3, [1.0] * 3]}
FOUND = {
    "format": "XYZ",
    "kind": "scan",
    "scans": [{**SCAN, "has_intensity": False, "has_color": False}],
    "photos": [],
}


class Steps:
    def __init__(self) -> None:
        self.columns: list[str] = []

    async def run(self, _step: str, arguments: Any, **_limits: Any) -> Any:
        self.columns.append(arguments["columns"])
        return FOUND


class InProcess(httpx.BaseTransport):
    """Hand requests to the application without a network."""

    def __init__(self, app: Any) -> None:
        self._app = app

    def handle_request(self, request: httpx.Request) -> httpx.Response:
        async def send() -> httpx.Response:
            async with httpx.AsyncClient(transport=httpx.ASGITransport(self._app)) as client:
                answer = await client.request(
                    request.method, request.url, headers=request.headers, content=request.read()
                )
                return httpx.Response(answer.status_code, headers=answer.headers, content=answer.content)

        return asyncio.run(send())


@pytest.fixture
def adapters() -> Adapters:
    blobs = MemoryBlobStore()

    def store_result(job: Job) -> None:
        blobs.write_bytes(f"jobs/{job.id}/result.json", b'{"status": "registered"}')

    return Adapters(MemoryJobStore(store_result), MemoryFileStore(), blobs, MemoryQueue(), Steps(), MemoryJobLog())


@pytest.fixture
def client(adapters: Adapters, tmp_path: Path) -> ServiceClient:
    app = create_app(Settings(data_dir=tmp_path, min_free_bytes=0), adapters)
    return ServiceClient("http://tieline.test", InProcess(app))


@pytest.fixture
def scan(tmp_path: Path) -> Path:
    path = tmp_path / "Höfe 1.xyz"
    path.write_bytes(b"1 2 3\n")
    return path


def uploaded_twice(client: ServiceClient, scan: Path) -> list[dict[str, Any]]:
    """Upload a file and another one of the same name."""
    first = client.upload(scan)
    scan.write_bytes(b"4 5 6\n")
    return [first, client.upload(scan)]


def test_the_client_knows_a_tieline_service(client: ServiceClient) -> None:
    assert client.is_tieline()
    assert client.ready()


def test_an_upload_keeps_its_name_and_tells_its_bytes(client: ServiceClient, scan: Path) -> None:
    sent: list[int] = []
    document = client.upload(scan, sent.append)
    assert document["name"] == "Höfe 1.xyz"
    assert sum(sent) == document["bytes"] == 6


def test_columns_are_said_of_tables_only(client: ServiceClient, scan: Path, adapters: Adapters, tmp_path: Path) -> None:
    other = tmp_path / "b.e57"
    other.write_bytes(b"1 2 3")
    upload_files(client, [scan, other], Console(quiet=True), "row,x,y,z")
    assert isinstance(adapters.steps, Steps)
    assert adapters.steps.columns == ["row,x,y,z", ""]


def test_scans_that_cannot_be_used_are_no_stations() -> None:
    scans = [SCAN, {**SCAN, "index": 1, "usable": False, "reason": "no points"}, {**SCAN, "index": 2}]
    stations = stations_of([{"name": "a.e57", "id": "1", "scans": scans}])
    assert [station["scan"]["index"] for station in stations] == [0, 2]


def test_a_finished_job_gives_its_result(client: ServiceClient, scan: Path, adapters: Adapters) -> None:
    stations = stations_of(uploaded_twice(client, scan))
    job = client.execute("register", {"stations": stations})
    found = adapters.jobs.get(job)
    assert found is not None
    adapters.jobs.succeed(job, found.created)
    assert client.wait(job) == {"status": "registered"}


@pytest.fixture
def job(client: ServiceClient, scan: Path, adapters: Adapters) -> str:
    """Run a job that has left two downloads."""
    made = client.execute("register", {"stations": stations_of(uploaded_twice(client, scan))})
    for name in ("report.html", "lines.dxf"):
        adapters.blobs.write_bytes(f"jobs/{made}/artifacts/{name}", name.encode())
    found = adapters.jobs.get(made)
    assert found is not None
    adapters.jobs.report(made, 40, "features of A: normals", found.created)
    adapters.jobs.succeed(made, found.created)
    return made


def test_all_that_a_job_offers_is_kept(client: ServiceClient, job: str, tmp_path: Path) -> None:
    keep_results(client, job, client.wait(job), tmp_path / "new" / "kept")
    kept = {path.name: path.read_text() for path in (tmp_path / "new" / "kept").iterdir()}
    assert json.loads(kept.pop("result.json")) == {"status": "registered"}
    assert kept == {"report.html": "report.html", "lines.dxf": "lines.dxf"}


def test_lists_of_a_large_network_become_files_of_lines(
    client: ServiceClient, adapters: Adapters, job: str, tmp_path: Path
) -> None:
    lists = {"stations": {"pointer": "/stations", "count": 2, "href": "", "stream": ""}}
    adapters.blobs.write_bytes(f"jobs/{job}/result.json", json.dumps({"lists": lists}).encode())
    adapters.blobs.write_bytes(rows_key(job, "stations", 0), b'{"name":"A"}\n{"name":"B"}\n')
    keep_results(client, job, client.wait(job), tmp_path / "kept")
    rows = (tmp_path / "kept" / "stations.ndjson").read_text().splitlines()
    assert [json.loads(row)["name"] for row in rows] == ["A", "B"]


def test_a_file_for_the_result_gets_the_result_alone(client: ServiceClient, job: str, tmp_path: Path) -> None:
    keep_results(client, job, client.wait(job), tmp_path / "new" / "only.json")
    (kept,) = (tmp_path / "new").iterdir()
    assert json.loads(kept.read_text()) == {"status": "registered"}


def test_that_results_cannot_be_written_is_known_before_anything_is_computed(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for output in (tmp_path / "new" / "folder", tmp_path / "only.json", tmp_path):
        check_writable(output)
    for output in (tmp_path / "file", tmp_path / "file" / "folder"):
        with pytest.raises(NotADirectoryError, match="file"):
            check_writable(output)


def test_where_nothing_moves_on_the_screen_steps_are_told_line_by_line(client: ServiceClient, job: str) -> None:
    console = Console(record=True, width=100, force_terminal=False)
    wait_for_job(client, job, console)
    assert console.export_text().splitlines() == ["100 % done"]


def test_of_steps_side_by_side_each_is_told_now_and_then_on_a_line_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.register_command.LINE_INTERVAL_S", math.inf)
    console = Console(record=True, width=40, force_terminal=False)
    lines = ProgressLines(console)
    for number in range(3):
        for station in "AB":
            lines.tell(number, f"features of {station}: compiling the numerical kernels: {number} done")
    lines.tell(100, "done")
    assert console.export_text().splitlines() == [
        "  0 % features of A: compiling the numerical kernels: 0 done",
        "  0 % features of B: compiling the numerical kernels: 0 done",
        "100 % done",
    ]


def test_a_refused_request_is_an_error_that_names_the_fields(client: ServiceClient) -> None:
    stations = stations_of([{"name": "a", "id": "x", "scans": [SCAN]}])
    with pytest.raises(RefusedError) as refused:
        client.execute("register", {"stations": stations})
    assert refused.value.status == 400
    assert "/inputs/stations" in str(refused.value)


def test_a_service_that_is_not_there_is_unreachable() -> None:
    def refuse(request: httpx.Request) -> httpx.Response:
        raise httpx.ConnectError("refused", request=request)

    lost = ServiceClient("http://nowhere.test", httpx.MockTransport(refuse))
    assert not lost.is_tieline()
    with pytest.raises(UnreachableError):
        lost.execute("register", {})


@pytest.mark.parametrize("said", [b"", b"<html>Bad Gateway</html>"])
def test_what_a_proxy_says_of_a_service_that_is_away_is_passed_on(said: bytes) -> None:
    behind = ServiceClient("http://nowhere.test", httpx.MockTransport(lambda _: httpx.Response(502, content=said)))
    with pytest.raises(UnreachableError, match="502 Bad Gateway"):
        behind.execute("register", {})


def test_stations_are_named_after_their_files_and_never_twice() -> None:
    one, two = [SCAN], [SCAN, {**SCAN, "index": 1}]
    files = [
        {"name": "yard.e57", "id": "1", "scans": one},
        {"name": "yard.ply", "id": "2", "scans": one},
        {"name": "both.e57", "id": "3", "scans": two},
        {"name": "#/äöü.xyz", "id": "4", "scans": one},
    ]
    names = [station["name"] for station in stations_of(files)]
    assert names == ["yard", "yard (2)", "both-1", "both-2", "äöü"]


def test_what_was_not_determined_is_said_in_words() -> None:
    pose = dict.fromkeys(("omega_gon", "phi_gon", "kappa_gon", "tx_m", "ty_m", "tz_m"), 1.0)
    std = {**pose, "tz_m": None}
    result = {
        "status": "registered",
        "pairs": [{"target": "A", "source": "B", "status": "degenerate", "reasons": ["parallel lines only"]}],
        "stations": [
            {"name": "A", "status": "fixed", "world_from_scan": pose},
            {"name": "B", "status": "registered", "world_from_scan": {**pose, "std": std}},
            {"name": "C", "status": "unregistered", "world_from_scan": None, "reason": "no lines"},
        ],
    }
    console = Console(record=True, width=100)
    print_result(console, result)
    text = console.export_text()
    assert text.count("not determined") == 1
    assert "parallel lines only" in text
    assert "no lines" in text


def test_the_demo_measures_errors_in_standard_deviations_and_angles_the_short_way() -> None:
    keys = ("omega_gon", "phi_gon", "kappa_gon", "tx_m", "ty_m", "tz_m")
    truth = dict.fromkeys(keys, 0.0) | {"kappa_gon": 199.999}
    pose = dict.fromkeys(keys, 0.0) | {"kappa_gon": -199.999, "tx_m": 0.003}
    std = dict.fromkeys(keys, 0.001) | {"tz_m": None}
    result = {
        "status": "registered",
        "pairs": [{"target": "A", "source": "B", "status": "accepted", "reasons": []}],
        "stations": [
            {"name": "A", "status": "fixed"},
            {"name": "B", "status": "registered", "world_from_scan": {**pose, "std": std}},
        ],
    }
    console = Console(record=True, width=120)
    print_comparison(console, result, truth)
    rows = {line.split()[1]: line for line in console.export_text().splitlines() if line.startswith("│")}
    assert "2.000" in rows["κ"]
    assert "3.00" in rows["X"]
    assert rows["Z"].count("not determined") == 2


@pytest.mark.parametrize(
    ("accept", "plain"),
    [
        ("application/json", True),
        ("application/json;q=0.5", True),
        ("", False),
        ("*/*", False),
        ("application/json, application/problem+json", False),
        ("application/json, text/html;q=0", True),
    ],
)
def test_problems_are_plain_json_only_for_who_takes_nothing_else(accept: str, plain: bool) -> None:
    assert accepts_plain_json_only(accept) is plain


@pytest.mark.parametrize(
    ("accept", "html"),
    [
        ("text/html,application/xhtml+xml,*/*;q=0.8", True),
        ("*/*", False),
        ("", False),
        ("application/json, text/html;q=0.9", False),
        ("text/html;q=nonsense", True),
    ],
)
def test_pages_are_for_who_prefers_them(accept: str, html: bool) -> None:
    assert prefers_html(accept) is html
