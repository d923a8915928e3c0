"""What browsers are told with every answer, and that what describes the service costs next to nothing."""

import asyncio
import re
import time

import pytest

from schemas.resources.health import Readiness
from service.dependencies import Adapters
from service.settings import Settings
from service.use_cases.limits.check_readiness import ReadinessWatch
from service.use_cases.limits.limit_rates import network_of
from tests.api.conftest import Client
from tests.api.key_service import KeyService
from tests.doubles.application import create_app
from tests.doubles.memory import MemoryBlobStore

DESCRIBING = ("/", "/conformance", "/processes", "/processes/register", "/openapi.json", "/openapi-3.0.json", "/docs")
ERRORS = {"/nowhere": 404, "/jobs/none": 404, "/files?limit=x": 400}


@pytest.mark.parametrize("path", [*DESCRIBING, "/healthz", "/readyz", "/jobs", "/files", "/metrics", *ERRORS])
def test_no_answer_can_be_framed_sniffed_or_loaded_by_other_pages(client: Client, path: str) -> None:
    answer = client.get(path)
    assert answer.status_code == ERRORS.get(path, 200)
    policy = answer.headers["content-security-policy"]
    assert {"default-src 'none'", "frame-ancestors 'none'", "base-uri 'none'"} <= set(policy.split("; "))
    assert "unsafe" not in policy if path == "/docs" else "script" not in policy
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["cross-origin-resource-policy"] == "same-origin"


def test_an_unexpected_error_is_guarded_as_well(
    client: Client, adapters: Adapters, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(adapters.jobs, "get", lambda _job_id: 1 / 0)
    answer = client.get("/jobs/some")
    assert answer.status_code == 500
    assert "frame-ancestors 'none'" in answer.headers["content-security-policy"]
    assert answer.headers["cache-control"] == "private, no-store"


@pytest.mark.parametrize("path", ["/jobs", "/files", "/files/{file}", "/files/{file}/content", "/jobs/{job}"])
@pytest.mark.parametrize("keyed", [False, True])
def test_what_belongs_to_a_project_is_kept_by_no_cache(
    settings: Settings, adapters: Adapters, path: str, keyed: bool
) -> None:
    client = KeyService(settings, adapters).client("k") if keyed else Client(create_app(settings, adapters))
    job = client.register_two()
    answer = client.get(path.format(file=client.upload(), job=job))
    assert (answer.status_code, answer.headers["cache-control"]) == (200, "private, no-store")


def test_a_report_runs_no_script_wherever_its_text_comes_from(client: Client, adapters: Adapters) -> None:
    job = client.register_two()
    assert isinstance(adapters.blobs, MemoryBlobStore)
    found = adapters.jobs.get(job)
    assert found is not None
    adapters.blobs.write_bytes(
        f"jobs/{job}/result.json",
        b'{"artifacts": [{"name": "report.html", "type": "text/html", "bytes": 6, "href": "x"}]}',
    )
    adapters.blobs.write_bytes(f"jobs/{job}/artifacts/report.html", b"<html>")
    adapters.jobs.succeed(job, found.created)
    answer = client.get(f"/jobs/{job}/artifacts/report.html")
    assert answer.status_code == 200
    policy = answer.headers["content-security-policy"]
    assert policy.startswith("default-src 'none'")
    assert "style-src 'unsafe-inline'" in policy
    assert "script" not in policy


@pytest.mark.parametrize("path", DESCRIBING)
def test_a_description_is_named_by_its_content(client: Client, path: str) -> None:
    first = client.get(path)
    again = client.get(path)
    assert (first.content, first.headers["etag"]) == (again.content, again.headers["etag"])
    assert first.headers["x-request-id"] != again.headers["x-request-id"]
    known = client.get(path, headers={"If-None-Match": f'"other", W/{first.headers["etag"]}'})
    assert (known.status_code, known.content) == (304, b"")
    head = client.request("HEAD", path)
    assert (head.status_code, head.content, head.headers["etag"]) == (200, b"", first.headers["etag"])


def test_a_description_asked_for_by_another_name_has_its_links(client: Client) -> None:
    client.get("/processes")
    other = client.get("/processes", headers={"Host": "localhost:99"})
    assert "http://localhost:99/processes" in other.text
    assert "tieline.test" not in other.text
    assert "tieline.test" in client.get("/processes").text


def test_descriptions_are_put_together_once(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    client.get("/processes/register")
    monkeypatch.setattr("service.routes.processes.input_descriptions", lambda _process: 1 / 0)
    assert client.get("/processes/register").status_code == 200


def test_the_description_without_scripts_loads_nothing_and_runs_nothing(client: Client) -> None:
    page = client.get("/redoc", headers={"Accept": "text/html"})
    assert page.headers["content-type"].startswith("text/html")
    assert re.findall(r"<(?:script|link|img|iframe|object|embed)|\ssrc=|url\(|@import", page.text) == []


def test_the_documentation_has_every_operation(client: Client) -> None:
    page = client.get("/redoc").text
    for path in client.get("/openapi.json").json()["paths"]:
        assert f"<code>{path}</code>" in page


def test_readiness_is_looked_for_once_for_all_who_ask() -> None:
    looked: list[int] = []

    def look() -> Readiness:
        looked.append(1)
        time.sleep(0.05)
        return Readiness(status="ready", checks={})

    async def ask() -> None:
        watch = ReadinessWatch(look, 1000.0)
        await asyncio.gather(*(watch.readiness() for _ in range(50)))
        await watch.readiness()
        assert len(looked) == 1
        impatient = ReadinessWatch(look, 0.0)
        await impatient.readiness()
        await impatient.readiness()
        assert len(looked) == 3

    asyncio.run(ask())


@pytest.mark.parametrize(
    ("address", "network"),
    [
        ("192.0.2.7", "192.0.2.7"),
        ("2001:db8:1:2:3:4:5:6", "2001:db8:1:2::/64"),
        ("::ffff:192.0.2.7", "192.0.2.7"),
        ("", ""),
    ],
)
def test_an_ipv6_customer_is_one_address(address: str, network: str) -> None:
    assert network_of(address) == network
