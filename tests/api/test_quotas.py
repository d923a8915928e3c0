"""How much one project may have, and how urgent its jobs are."""

from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any

import pytest

from service.adapters.uploads.local_uploads import LocalUploads
from service.dependencies import Adapters
from service.names.feature_keys import features_of_project
from service.settings import Settings
from service.use_cases.jobs.urgency import urgency_of
from service.use_cases.limits.quotas import count_results
from tests.api.key_service import KeyedClient, KeyService

NOW = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)

TUS = {"Tus-Resumable": "1.0.0", "Upload-Metadata": "filename YS54eXo="}
ECHO = {"json": {"inputs": {"stringInput": "a"}}, "headers": {"Prefer": "respond-async"}}


def made(settings: Settings, adapters: Adapters, **limits: Any) -> KeyService:
    return KeyService(settings.model_copy(update=limits), adapters)


def test_a_project_with_too_many_jobs_waits_and_others_do_not(settings: Settings, adapters: Adapters) -> None:
    service = made(settings, adapters, max_project_jobs=1)
    alice, bob = service.client("alice"), service.client("bob")
    answers = [alice.post("/processes/echo/execution", **ECHO) for _ in range(2)]
    assert [answer.status_code for answer in answers] == [201, 429]
    assert int(answers[1].headers["retry-after"]) > 0
    assert "of this project" in answers[1].json()["detail"]
    assert bob.post("/processes/echo/execution", **ECHO).status_code == 201


def test_all_projects_together_have_a_limit_too(settings: Settings, adapters: Adapters) -> None:
    service = made(settings, adapters, max_queued_jobs=1)
    answers = [service.client(name).post("/processes/echo/execution", **ECHO) for name in ("alice", "bob")]
    assert [answer.status_code for answer in answers] == [201, 429]


def test_a_job_that_has_ended_makes_room(settings: Settings, adapters: Adapters) -> None:
    alice = made(settings, adapters, max_project_jobs=1).client("alice")
    job = alice.post("/processes/echo/execution", **ECHO).json()["jobID"]
    alice.delete(f"/jobs/{job}")
    assert alice.post("/processes/echo/execution", **ECHO).status_code == 201


def test_a_project_has_no_more_bytes_than_it_may(settings: Settings, adapters: Adapters) -> None:
    service = made(settings, adapters, max_project_bytes=10)
    alice, bob = service.client("alice"), service.client("bob")
    alice.upload(content=b"1 2 3\n")
    refused = alice.post("/files", files={"file": ("b.xyz", b"4 5 6\n")})
    assert (refused.status_code, refused.json()["title"]) == (413, "Quota exceeded")
    assert alice.get("/files").json()["numberMatched"] == 1
    bob.upload(content=b"4 5 6\n")


def test_a_declared_size_is_refused_before_it_comes(settings: Settings, adapters: Adapters) -> None:
    alice = made(settings, adapters, max_project_bytes=10).client("alice")
    asked = []

    async def body() -> Any:
        asked.append(1)
        yield b"1" * 20

    headers = {"Content-Length": "20", "Content-Disposition": 'attachment; filename="a.xyz"'}
    assert alice.post("/files", content=body(), headers=headers).status_code == 413
    assert asked == []


def test_a_size_that_is_not_declared_is_refused_when_it_has_come(settings: Settings, adapters: Adapters) -> None:
    alice = made(settings, adapters, max_project_bytes=10).client("alice")

    async def body() -> Any:
        for _ in range(4):
            yield b"1 2 3\n"

    headers = {"Content-Disposition": 'attachment; filename="a.xyz"'}
    assert alice.post("/files", content=body(), headers=headers).status_code == 413
    assert alice.get("/files").json()["numberMatched"] == 0
    assert adapters.blobs.keys("") == []


def test_a_project_has_no_more_files_than_it_may(settings: Settings, adapters: Adapters) -> None:
    alice = made(settings, adapters, max_project_files=1).client("alice")
    both = [("file", ("a.xyz", b"1 2 3\n")), ("file", ("b.xyz", b"4 5 6\n"))]
    assert alice.post("/files", files=both).status_code == 413
    assert alice.get("/files").json()["numberMatched"] == 0
    alice.upload()
    assert alice.post("/files", files=both[:1]).status_code == 413


def test_what_is_removed_makes_room(settings: Settings, adapters: Adapters) -> None:
    alice = made(settings, adapters, max_project_files=1).client("alice")
    alice.delete(f"/files/{alice.upload()}")
    alice.upload()


def test_uploads_under_way_count(settings: Settings, adapters: Adapters) -> None:
    service = made(settings, adapters, max_project_bytes=10)
    alice, bob = service.client("alice"), service.client("bob")
    begun = alice.post("/uploads", headers={**TUS, "Upload-Length": "6"})
    assert begun.status_code == 201
    assert alice.post("/uploads", headers={**TUS, "Upload-Length": "6"}).status_code == 413
    assert bob.post("/uploads", headers={**TUS, "Upload-Length": "6"}).status_code == 201
    alice.delete(begun.headers["location"], headers=TUS)
    assert alice.post("/uploads", headers={**TUS, "Upload-Length": "6"}).status_code == 201


def test_uploads_under_way_count_for_what_comes_otherwise_and_not_twice(settings: Settings, adapters: Adapters) -> None:
    alice = made(settings, adapters, max_project_bytes=12).client("alice")
    begun = alice.post("/uploads", headers={**TUS, "Upload-Length": "6"}).headers["location"]
    alice.upload(content=b"4 5 6\n")
    assert alice.post("/files", files={"file": ("b.xyz", b"1")}).status_code == 413
    headers = {**TUS, "Upload-Offset": "0", "Content-Type": "application/offset+octet-stream"}
    assert alice.request("PATCH", begun, headers=headers, content=b"1 2 3\n").status_code == 204
    assert alice.get("/files").json()["numberMatched"] == 2


def test_uploads_under_way_are_counted_as_often_for_many_files_of_a_form_as_for_one(
    settings: Settings, adapters: Adapters, monkeypatch: pytest.MonkeyPatch
) -> None:
    counted: list[int] = []
    count = LocalUploads.promised_bytes
    monkeypatch.setattr(LocalUploads, "promised_bytes", lambda self: counted.append(1) or count(self))
    alice = made(settings, adapters).client("alice")
    often = []
    for number in (1, 5):
        counted.clear()
        form = [("file", (f"{k}.xyz", b"1 2 3\n")) for k in range(number)]
        assert alice.post("/files", files=form).status_code == 201
        often.append(len(counted))
    assert often[0] == often[1] <= 2


@dataclass
class Full:
    """A project of which a job has left more results than there is room for."""

    client: KeyedClient
    service: KeyService
    job: str

    @classmethod
    def of(cls, settings: Settings, adapters: Adapters, results: int) -> "Full":
        service = made(settings, adapters, max_project_bytes=20)
        alice = service.client("alice")
        job = alice.post("/processes/echo/execution", **ECHO).json()["jobID"]
        adapters.blobs.write_bytes(f"jobs/{job}/artifacts/lines.csv", b"1" * results)
        count_results(job, adapters.jobs, adapters.files, adapters.blobs)
        adapters.jobs.succeed(job, NOW)
        return cls(alice, service, job)


SCANS = [("scan", ("a.xyz", b"1 2 3\n")), ("scan", ("b.xyz", b"4 5 6\n"))]
MORE: dict[str, tuple[str, dict[str, Any]]] = {
    "a file": ("/files", {"files": {"file": ("a.xyz", b"1 2 3\n")}}),
    "an upload": ("/uploads", {"headers": {**TUS, "Upload-Length": "6"}}),
    "a registration": ("/registrations", {"files": SCANS}),
    "a job": ("/processes/echo/execution", ECHO),
}


@pytest.mark.parametrize("what", MORE)
def test_results_of_jobs_count(settings: Settings, adapters: Adapters, what: str) -> None:
    full = Full.of(settings, adapters, results=21)
    path, sent = MORE[what]
    refused = full.client.post(path, **sent)
    assert (refused.status_code, refused.json()["title"]) == (413, "Quota exceeded")
    assert "/jobs/{id}" in refused.json()["detail"]
    assert full.client.get("/files").json()["numberMatched"] == 0
    assert full.client.get("/jobs").json()["numberMatched"] == 1
    assert full.service.client("bob").post(path, **sent).status_code == 201
    full.client.delete(f"/jobs/{full.job}")
    assert full.client.post(path, **sent).status_code == 201


def test_what_is_computed_of_files_counts_and_goes_with_them(settings: Settings, adapters: Adapters) -> None:
    service = made(settings, adapters, max_project_bytes=30)
    clients = {name: service.client(name) for name in ("alice", "bob")}
    uploaded = {name: client.upload(content=b"1 2 3\n") for name, client in clients.items()}
    folders = {}
    for name, client in clients.items():
        job = client.post("/processes/echo/execution", **ECHO).json()["jobID"]
        known = adapters.jobs.get(job)
        file = adapters.files.get(uploaded[name])
        assert known is not None
        assert file is not None
        of_file = replace(known, id=f"of-{name}", file_ids=(file.id,))
        adapters.jobs.create_and_enqueue(of_file)
        folders[name] = features_of_project(file.sha256, file.owner)
        adapters.blobs.write_bytes(f"{folders[name]}/scan.points", b"1" * 25)
        adapters.jobs.succeed(of_file.id, NOW)
        count_results(of_file.id, adapters.jobs, adapters.files, adapters.blobs)
    more = {"files": {"file": ("b.xyz", b"4 5 6\n")}}
    refused = clients["alice"].post("/files", **more)
    clients["alice"].delete(f"/files/{uploaded['alice']}")
    kept = [bool(adapters.blobs.keys(f"{folder}/")) for folder in folders.values()]
    assert (refused.status_code, kept) == (413, [False, True])
    assert clients["alice"].post("/files", **more).status_code == 201


def test_a_project_that_is_just_full_takes_jobs_and_no_files(settings: Settings, adapters: Adapters) -> None:
    full = Full.of(settings, adapters, results=20)
    assert full.client.post("/processes/echo/execution", **ECHO).status_code == 201
    assert full.client.post("/files", files={"file": ("b.xyz", b"1")}).status_code == 413


def test_an_upload_that_was_let_in_comes_to_its_end(settings: Settings, adapters: Adapters) -> None:
    alice = made(settings, adapters, max_project_bytes=20).client("alice")
    begun = alice.post("/uploads", headers={**TUS, "Upload-Length": "6"}).headers["location"]
    job = alice.post("/processes/echo/execution", **ECHO).json()["jobID"]
    adapters.jobs.note_results(job, 20)
    headers = {**TUS, "Upload-Offset": "0", "Content-Type": "application/offset+octet-stream"}
    assert alice.request("PATCH", begun, headers=headers, content=b"1 2 3\n").status_code == 204
    assert alice.get("/files").json()["numberMatched"] == 1


def test_a_job_of_a_full_project_may_be_asked_for_again(settings: Settings, adapters: Adapters) -> None:
    alice = made(settings, adapters, max_project_bytes=20).client("alice")
    keyed = {**ECHO, "headers": {**ECHO["headers"], "Idempotency-Key": "k"}}
    first = alice.post("/processes/echo/execution", **keyed)
    adapters.jobs.note_results(first.json()["jobID"], 21)
    again = alice.post("/processes/echo/execution", **keyed)
    assert (again.status_code, again.json()["jobID"]) == (201, first.json()["jobID"])


def test_an_upload_becomes_a_file_of_its_project(settings: Settings, adapters: Adapters) -> None:
    service = made(settings, adapters)
    alice = service.client("alice")
    headers = {**TUS, "Upload-Length": "6", "Content-Type": "application/offset+octet-stream"}
    answer = alice.post("/uploads", headers=headers, content=b"1 2 3\n")
    file = adapters.files.get(answer.headers["tieline-file"])
    assert file is not None
    assert file.owner == "alice"


@pytest.mark.parametrize(
    ("priority", "urgency"),
    [
        (None, 3),
        ("", 3),
        ("u=0", 0),
        ("u=7, i", 7),
        ("i, u=5", 5),
        ("u = 2 ;x", 2),
        ("u=1, u=6", 6),
        ("u=8", 3),
        ("u=-1", 3),
        ("u=1.5", 3),
        ("nonsense;u=1", 3),
    ],
)
def test_the_priority_of_a_request_is_read_as_rfc_9218_says(priority: str | None, urgency: int) -> None:
    assert urgency_of(priority) == urgency


@pytest.mark.parametrize("path", ["/processes/echo/execution", "/registrations"])
def test_a_job_is_as_urgent_as_its_request(settings: Settings, adapters: Adapters, path: str) -> None:
    what = {"files": SCANS} if path == "/registrations" else {"json": ECHO["json"]}
    headers = {"Prefer": "respond-async", "Priority": "u=1"}
    answer = made(settings, adapters).stranger().post(path, headers=headers, **what)
    job = adapters.jobs.get(answer.json()["jobID"])
    assert job is not None
    assert job.urgency == 1


def test_inputs_of_jobs_have_bounds_and_are_given_back(settings: Settings, adapters: Adapters) -> None:
    service = made(settings, adapters, max_project_records_bytes=50_000)
    alice, bob = service.client("alice"), service.client("bob")
    large = {"json": {"inputs": {"stringInput": "a" * 20_000}}, "headers": {"Prefer": "respond-async"}}
    answers = [alice.post("/processes/echo/execution", **large) for _ in range(4)]
    assert [answer.status_code for answer in answers] == [201, 201, 413, 413]
    assert "in the database" in answers[2].json()["detail"]
    assert bob.post("/processes/echo/execution", **large).status_code == 201
    for _ in range(2):  # dismissed, then removed
        alice.delete(f"/jobs/{answers[0].json()['jobID']}")
    assert alice.post("/processes/echo/execution", **large).status_code == 201


def test_kept_answers_have_bounds(settings: Settings, adapters: Adapters) -> None:
    service = made(settings, adapters, max_project_records_bytes=50_000)
    alice = service.client("alice")
    large = {"inputs": {"stringInput": "a" * 20_000}}
    codes = [
        alice.post("/processes/echo/execution", json=large, headers={"Idempotency-Key": f"k{number}"}).status_code
        for number in range(5)
    ]
    assert codes == [200, 200, 200, 413, 413]


def test_the_audit_of_a_project_counts(settings: Settings, adapters: Adapters) -> None:
    alice = made(settings, adapters, max_project_records_bytes=3000).client("alice")
    codes = [alice.post("/processes/echo/execution", **ECHO).status_code for _ in range(12)]
    assert codes.index(413) in {8, 9, 10}
    assert set(codes[11:]) == {413}


def test_nothing_is_kept_on_a_disk_that_is_nearly_full(settings: Settings, adapters: Adapters) -> None:
    alice = made(settings, adapters, min_free_bytes=10**18).client("alice")
    assert alice.post("/processes/echo/execution", **ECHO).status_code == 507
    named = {"Idempotency-Key": "k"}
    assert alice.post("/processes/echo/execution", json=ECHO["json"], headers=named).status_code == 507
    assert alice.get("/jobs").json()["numberMatched"] == 0


def test_uploads_that_are_begun_or_refused_have_a_number(settings: Settings, adapters: Adapters) -> None:
    service = made(settings, adapters, max_project_uploads=2)
    alice, bob = service.client("alice"), service.client("bob")
    begun = alice.post("/uploads", headers={**TUS, "Upload-Length": "6"}).headers["location"]
    headers = {**TUS, "Upload-Offset": "0", "Content-Type": "application/offset+octet-stream"}
    assert alice.request("PATCH", begun, headers=headers, content=b"broken").status_code == 400
    assert alice.post("/uploads", headers={**TUS, "Upload-Length": "6"}).status_code == 201
    refused = alice.post("/uploads", headers={**TUS, "Upload-Length": "6"})
    assert (refused.status_code, refused.headers["retry-after"]) == (429, "30")
    assert bob.post("/uploads", headers={**TUS, "Upload-Length": "6"}).status_code == 201
    alice.delete(begun, headers=TUS)
    assert alice.post("/uploads", headers={**TUS, "Upload-Length": "6"}).status_code == 201
