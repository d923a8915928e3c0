"""A request that is sent twice with the same Idempotency-Key is done once."""

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from starlette.middleware import Middleware

from service.dependencies import Adapters
from service.errors import QueueError
from service.ports import JobFilter
from service.routes.repeated_requests import RepeatedRequests
from service.settings import Settings
from tests.api.conftest import Client, FakeSteps
from tests.doubles.application import create_app
from tests.doubles.memory import MemoryBlobStore, MemoryFileStore, MemoryJobLog, MemoryJobStore, MemoryQueue
from tests.doubles.memory_access import MemoryIdempotencyStore, memory_access

ECHO = {"inputs": {"stringInput": "a"}}
ASYNC = {"Prefer": "respond-async"}


def keyed(key: str = "k1", **more: str) -> dict[str, str]:
    return {"Idempotency-Key": key, **more}


def execute(client: Client, key: str, inputs: dict[str, Any] = ECHO) -> httpx.Response:
    return client.post("/processes/echo/execution", json=inputs, headers=keyed(key, **ASYNC))


def jobs_of(adapters: Adapters) -> int:
    return adapters.jobs.find(JobFilter())[1]


def test_the_second_request_gets_the_first_answer(client: Client, adapters: Adapters) -> None:
    first, second = execute(client, "k1"), execute(client, "k1")
    assert (second.status_code, second.content, second.headers["location"]) == (
        201,
        first.content,
        first.headers["location"],
    )
    assert jobs_of(adapters) == 1


def test_the_second_answer_says_that_it_is_the_first(client: Client) -> None:
    assert "idempotent-replayed" not in execute(client, "k1").headers
    assert execute(client, "k1").headers["idempotent-replayed"] == "true"


def test_another_key_is_another_request(client: Client, adapters: Adapters) -> None:
    execute(client, "k1")
    execute(client, "k2")
    assert jobs_of(adapters) == 2


def test_a_quoted_key_is_the_same_as_a_bare_one(client: Client, adapters: Adapters) -> None:
    execute(client, "k1")
    execute(client, '"k1"')
    assert jobs_of(adapters) == 1


def test_another_body_with_the_same_key_is_refused(client: Client, adapters: Adapters) -> None:
    execute(client, "k1")
    answer = execute(client, "k1", {"inputs": {"stringInput": "b"}})
    assert (answer.status_code, answer.json()["title"]) == (409, "Idempotency-Key used before")
    assert jobs_of(adapters) == 1


def test_the_same_body_for_something_else_is_refused(client: Client) -> None:
    execute(client, "k1")
    answer = client.post("/processes/register/execution", json=ECHO, headers=keyed("k1"))
    assert answer.status_code == 409


def test_a_refused_request_may_be_corrected_with_the_same_key(client: Client, adapters: Adapters) -> None:
    assert execute(client, "k1", {"inputs": {"stringInput": 7}}).status_code == 400
    assert execute(client, "k1").status_code == 201
    assert jobs_of(adapters) == 1


@pytest.mark.parametrize("key", ["", " ", "a" * 256, "tab\there"])
def test_a_key_that_is_none_is_refused(client: Client, key: str) -> None:
    assert execute(client, key).status_code == 400


def test_a_file_is_stored_once(client: Client, adapters: Adapters) -> None:
    for _ in range(2):
        answer = client.post(
            "/files",
            content=b"1 2 3\n",
            headers=keyed("f", **{"Content-Disposition": 'attachment; filename="a.xyz"'}),
        )
        assert answer.status_code == 201
    assert adapters.files.find(10, 0)[1] == 1


def test_the_same_form_with_another_boundary_is_the_same_request(client: Client, adapters: Adapters) -> None:
    answers = [client.post("/files", files={"file": ("a.xyz", b"1 2 3\n")}, headers=keyed("f")) for _ in range(2)]
    assert answers[0].request.headers["content-type"] != answers[1].request.headers["content-type"]
    assert answers[0].content == answers[1].content
    assert adapters.files.find(10, 0)[1] == 1


def test_a_form_with_another_content_is_refused(client: Client) -> None:
    client.post("/files", files={"file": ("a.xyz", b"1 2 3\n")}, headers=keyed("f"))
    assert client.post("/files", files={"file": ("a.xyz", b"1 2 4\n")}, headers=keyed("f")).status_code == 409


def test_a_registration_is_made_once(client: Client, adapters: Adapters) -> None:
    scans = [("scan", ("a.xyz", b"1 2 3\n")), ("scan", ("b.xyz", b"4 5 6\n"))]
    answers = [client.post("/registrations", files=scans, headers=keyed("r")) for _ in range(2)]
    assert answers[0].json() == answers[1].json()
    assert (jobs_of(adapters), adapters.files.find(10, 0)[1]) == (1, 2)


def test_an_upload_is_begun_once(client: Client) -> None:
    headers = {"Tus-Resumable": "1.0.0", "Upload-Length": "6", "Upload-Metadata": "filename YS54eXo="}
    answers = [client.post("/uploads", headers=keyed("u", **headers)) for _ in range(2)]
    assert answers[0].status_code == 201
    assert answers[0].headers["location"] == answers[1].headers["location"]


def test_another_upload_with_the_same_key_is_refused(client: Client) -> None:
    headers = {"Tus-Resumable": "1.0.0", "Upload-Length": "6", "Upload-Metadata": "filename YS54eXo="}
    client.post("/uploads", headers=keyed("u", **headers))
    assert client.post("/uploads", headers=keyed("u", **{**headers, "Upload-Length": "7"})).status_code == 409


class Breaking:
    """Make a service whose queue fails after it has taken the job, as if the process had died there."""

    def __init__(self, tmp_path: Path) -> None:
        self.blobs = MemoryBlobStore()
        self.jobs = MemoryJobStore()
        self.files = MemoryFileStore()
        self.answers = MemoryIdempotencyStore()
        self.settings = Settings(data_dir=tmp_path, min_free_bytes=0)

    def client(self, *, breaks: bool) -> Client:
        adapters = Adapters(self.jobs, self.files, self.blobs, MemoryQueue(), FakeSteps(self.blobs), MemoryJobLog())
        app = create_app(self.settings, adapters, access=memory_access(self.answers))
        return Client(_dying_before_it_answers(app) if breaks else app)


def _dying_before_it_answers(app: Any) -> Any:
    """Lose every answer when the work is done and nothing of the answer is kept."""
    layers = [layer.cls for layer in app.user_middleware]
    app.user_middleware.insert(layers.index(RepeatedRequests) + 1, Middleware(_Dying))
    return app


class _Dying:
    def __init__(self, app: Any) -> None:
        self._app = app

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        async def lost(_message: Any) -> None:
            raise QueueError("the process dies here")

        await self._app(scope, receive, lost if scope["type"] == "http" else send)


def test_a_job_that_was_made_before_the_service_died_is_not_made_again(tmp_path: Path) -> None:
    service = Breaking(tmp_path)
    assert execute(service.client(breaks=True), "k1").status_code == 500
    answer = execute(service.client(breaks=False), "k1")
    assert (answer.status_code, service.jobs.find(JobFilter())[1]) == (201, 1)


def test_files_that_were_stored_before_the_service_died_are_not_stored_again(tmp_path: Path) -> None:
    service = Breaking(tmp_path)
    scans = [("scan", ("a.xyz", b"1 2 3\n")), ("scan", ("b.xyz", b"4 5 6\n"))]
    for breaks in (True, False):
        answer = service.client(breaks=breaks).post("/registrations", files=scans, headers=keyed("r"))
    assert answer.status_code == 201
    assert (service.jobs.find(JobFilter())[1], service.files.find(10, 0)[1]) == (1, 2)


def test_after_the_service_died_the_key_stays_that_of_the_first_request(tmp_path: Path) -> None:
    service = Breaking(tmp_path)
    execute(service.client(breaks=True), "k1")
    client = service.client(breaks=False)
    assert execute(client, "k1", {"inputs": {"stringInput": "b"}}).status_code == 409
    assert execute(client, "k1").status_code == 201


def test_a_second_request_is_asked_to_wait_while_the_first_is_under_way(settings: Settings, adapters: Adapters) -> None:
    app = create_app(settings, adapters)

    async def both() -> tuple[httpx.Response, httpx.Response]:
        arrived, go_on = asyncio.Event(), asyncio.Event()

        async def slow_body() -> AsyncIterator[bytes]:
            yield b'{"inputs": '
            arrived.set()
            await go_on.wait()
            yield b'{"stringInput": "a"}}'

        async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://t") as client:
            path = "/processes/echo/execution"
            first = asyncio.create_task(client.post(path, content=slow_body(), headers=keyed("k", **ASYNC)))
            await arrived.wait()
            second = await client.post(path, json=ECHO, headers=keyed("k", **ASYNC))
            go_on.set()
            return await first, second

    first, second = asyncio.run(both())
    assert (first.status_code, second.status_code, second.headers["retry-after"]) == (201, 409, "2")
