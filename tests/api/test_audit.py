"""Who changed what and what was refused is noted, and found again by the name of the request."""

import json
import re

import httpx
import pytest
import structlog

from service.dependencies import Adapters
from service.ports import AuditEntry, AuditFilter
from service.settings import Settings
from tests.api.conftest import Client
from tests.api.key_service import KeyService


@pytest.fixture
def service(settings: Settings, adapters: Adapters) -> KeyService:
    return KeyService(settings, adapters)


def entries(service: KeyService) -> list[AuditEntry]:
    return list(service.stores.audit.find(AuditFilter())[0])


def test_a_change_is_noted_with_who_made_it(service: KeyService) -> None:
    alice = service.client("alice", "bridge")
    answer = alice.post("/processes/echo/execution", json={"inputs": {"stringInput": "a"}})
    (entry,) = entries(service)
    key_id = alice.secret.split("_")[1]
    assert (entry.key_id, entry.project, entry.method, entry.path, entry.status, entry.remote) == (
        key_id,
        "bridge",
        "POST",
        "/processes/echo/execution",
        200,
        "127.0.0.1",
    )
    assert entry.request_id == answer.headers["x-request-id"]


@pytest.mark.parametrize(("method", "path", "status"), [("DELETE", "/jobs/x", 404), ("POST", "/files", 415)])
def test_a_change_that_fails_is_noted_too(service: KeyService, method: str, path: str, status: int) -> None:
    service.client("alice").request(method, path)
    assert [entry.status for entry in entries(service)] == [status]


def test_who_only_looks_is_not_noted(service: KeyService) -> None:
    alice = service.client("alice")
    for path in ("/jobs", "/files", "/jobs/x"):
        alice.get(path)
    assert entries(service) == []


def test_a_refusal_is_noted_also_of_who_only_looks(service: KeyService) -> None:
    service.client("alice", scopes=["write"]).get("/jobs")
    service.stranger().get("/jobs")
    assert [(entry.status, bool(entry.key_id)) for entry in entries(service)] == [(401, False), (403, True)]


def test_who_hammers_at_the_door_does_not_fill_the_audit_log(service: KeyService) -> None:
    service.client("alice")
    for _ in range(70):
        service.stranger().get("/jobs")
    assert len(entries(service)) == 60


def test_without_keys_changes_are_noted_too(client: Client, service: KeyService) -> None:
    del client
    service.stranger().upload()
    assert [(entry.key_id, entry.path, entry.status) for entry in entries(service)] == [("", "/files", 201)]


@pytest.mark.parametrize("fault", [ArithmeticError, RuntimeError, OSError])
def test_a_fault_of_the_service_is_noted(
    service: KeyService, monkeypatch: pytest.MonkeyPatch, fault: type[Exception]
) -> None:
    def broken(*_: object) -> None:
        raise fault

    alice = service.client("alice")
    job_id = alice.register_two()
    monkeypatch.setattr("service.routes.jobs.dismiss_job", broken)
    answer = alice.delete(f"/jobs/{job_id}")
    assert (answer.status_code, entries(service)[0].status) == (500, 500)
    assert answer.headers["x-request-id"] == entries(service)[0].request_id


def test_a_path_that_no_database_takes_is_noted_too(service: KeyService) -> None:
    service.client("alice").delete("/jobs/a%00b")
    assert [entry.path for entry in entries(service)] == ["/jobs/a\N{REPLACEMENT CHARACTER}b"]


def test_the_admin_reads_the_audit_log(service: KeyService) -> None:
    alice, admin = service.client("alice"), service.client("admin", scopes=["admin"])
    alice.upload()
    service.stranger().get("/jobs")
    found = admin.get("/audit").json()
    assert [(entry["project"], entry["status"]) for entry in found["entries"]] == [("(nobody)", 401), ("alice", 201)]
    of_alice = admin.get("/audit?project=alice&limit=1").json()
    assert (of_alice["numberMatched"], of_alice["entries"][0]["path"]) == (1, "/files")
    key_id = alice.secret.split("_")[1]
    assert admin.get(f"/audit?key={key_id}&since=2020-01-01T00:00:00Z").json()["numberMatched"] == 1


def test_a_request_keeps_the_name_that_it_brings(service: KeyService) -> None:
    answer = service.stranger().post("/files", headers={"X-Request-ID": "survey-7.1"})
    assert (answer.headers["x-request-id"], entries(service)[0].request_id) == ("survey-7.1", "survey-7.1")


@pytest.mark.parametrize("name", ["", "a b", "x" * 129, "ä", "a\tb", "{}"])
def test_a_name_that_could_confuse_a_log_is_replaced(service: KeyService, name: str) -> None:
    answer = service.stranger().get("/", headers={"X-Request-ID": name.encode()})
    assert re.fullmatch(r"[0-9a-f]{32}", answer.headers["x-request-id"])


def test_a_job_knows_the_request_that_made_it(service: KeyService) -> None:
    headers = {"X-Request-ID": "survey-7", "Prefer": "respond-async"}
    answer = service.stranger().post(
        "/processes/echo/execution", json={"inputs": {"stringInput": "a"}}, headers=headers
    )
    job = service.adapters.jobs.get(answer.json()["jobID"])
    assert job is not None
    assert job.request_id == "survey-7"


def test_a_change_leaves_one_line_in_the_log(service: KeyService) -> None:
    with structlog.testing.capture_logs() as lines:
        answer: httpx.Response = service.client("alice").post("/files", headers={"X-Request-ID": "survey-8"})
    (line,) = [line for line in lines if line["event"] == "request"]
    told = {name: line[name] for name in ("method", "path", "status", "project")}
    assert told == {"method": "POST", "path": "/files", "status": answer.status_code, "project": "alice"}
    assert json.dumps(line)
