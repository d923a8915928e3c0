"""Following a job by Server-Sent Events."""

import asyncio
import json
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from typing import Any

import httpx
import pytest
from fastapi import FastAPI

from service.dependencies import Adapters
from service.ports import Job, JobStatus
from service.settings import Settings
from tests.api.conftest import Client
from tests.doubles.application import create_app
from tests.measures.patience import patience

NOW = datetime(2026, 1, 31, 12, tzinfo=UTC)


@pytest.fixture
def app(settings: Settings, adapters: Adapters) -> FastAPI:
    return create_app(settings, adapters)


@pytest.fixture
def job(adapters: Adapters) -> str:
    adapters.jobs.create_and_enqueue(Job("job0", "echo", {}, JobStatus.ACCEPTED, created=NOW, updated=NOW))
    return "job0"


def events_of(text: str) -> list[dict[str, Any]]:
    """Read a stream as a browser does."""
    found = []
    for block in text.split("\n\n"):
        lines = [line.partition(": ") for line in block.splitlines() if line and not line.startswith(":")]
        if lines:
            fields = {name: value for name, _, value in lines}
            found.append({**fields, "data": json.loads(fields["data"])})
    return found


def followed(
    app: FastAPI, adapters: Adapters, *changes: Callable[[], object], headers: dict[str, str] | None = None
) -> list[dict[str, Any]]:
    """Follow the job; each change comes when the state before it has been looked at."""
    looks, get = [0], adapters.jobs.get

    def counted(job_id: str) -> Job | None:
        found = get(job_id)
        looks[0] += 1
        return found

    async def follow() -> str:
        transport = httpx.ASGITransport(app=app)
        async with httpx.AsyncClient(transport=transport, base_url="http://service") as client:
            asked = asyncio.create_task(client.get("/jobs/job0/events", headers=headers))
            for change in changes:
                seen = looks[0]
                while looks[0] < seen + 2:  # noqa: ASYNC110 - another thread looks
                    await asyncio.sleep(0.01)
                change()
            return (await asyncio.wait_for(asked, 10.0 * patience())).text

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(adapters.jobs, "get", counted)
        return events_of(asyncio.run(follow()))


def test_events_tell_every_change_and_end_with_the_final_status(app: FastAPI, adapters: Adapters, job: str) -> None:
    later = [NOW + timedelta(seconds=k) for k in range(1, 4)]
    events = followed(
        app,
        adapters,
        lambda: adapters.jobs.start(job, later[0]),
        lambda: adapters.jobs.report(job, 40, "features of A", later[1]),
        lambda: adapters.jobs.succeed(job, later[2]),
    )
    assert [event["event"] for event in events] == ["status", "status", "progress", "status"]
    assert [event["data"]["status"] for event in events] == ["accepted", "running", "running", "successful"]
    assert events[2]["data"]["progress"] == 40
    assert events[2]["data"]["message"] == "features of A"


def test_a_client_that_lost_the_line_is_told_only_what_is_new(app: FastAPI, adapters: Adapters, job: str) -> None:
    adapters.jobs.start(job, NOW + timedelta(seconds=1))
    done = NOW + timedelta(seconds=2)
    first = followed(app, adapters, lambda: adapters.jobs.succeed(job, done))
    again = followed(app, adapters, headers={"Last-Event-ID": first[0]["id"]})
    assert [event["data"]["status"] for event in again] == ["successful"]


def test_who_knows_the_end_is_told_that_nothing_will_come(client: Client, adapters: Adapters, job: str) -> None:
    adapters.jobs.dismiss(job, NOW + timedelta(seconds=1))
    last = events_of(client.get(f"/jobs/{job}/events").text)[-1]
    assert client.get(f"/jobs/{job}/events", headers={"Last-Event-ID": last["id"]}).status_code == 204


def test_events_of_a_job_that_does_not_exist_are_a_problem(client: Client) -> None:
    answer = client.get("/jobs/none/events")
    assert answer.status_code == 404
    assert answer.headers["content-type"] == "application/problem+json"


def test_a_removed_job_ends_its_events(app: FastAPI, adapters: Adapters, job: str) -> None:
    def remove() -> None:
        adapters.jobs.dismiss(job, NOW + timedelta(seconds=1))
        adapters.jobs.delete(job)

    statuses = [event["data"]["status"] for event in followed(app, adapters, remove)]
    assert statuses in (["accepted"], ["accepted", "dismissed"])


def test_the_status_document_links_to_the_events_while_there_are_any(client: Client, job: str) -> None:
    links = {link["type"]: link["href"] for link in client.get(f"/jobs/{job}").json()["links"]}
    assert links["text/event-stream"].endswith(f"/jobs/{job}/events")


def test_head_of_the_events_ends_at_once(client: Client, job: str) -> None:
    answer = client.request("HEAD", f"/jobs/{job}/events")
    assert (answer.status_code, answer.content) == (200, b"")
    assert answer.headers["content-type"].startswith("text/event-stream")
