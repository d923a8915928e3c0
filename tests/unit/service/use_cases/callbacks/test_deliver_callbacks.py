"""What subscribers are told, how often, and what the log of the job says of it."""

import asyncio
import json
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from service.adapters.database.callbacks import DatabaseCallbacks
from service.adapters.database.executors import DatabaseExecutors
from service.adapters.database.job_log import DatabaseJobLog
from service.adapters.database.jobs import DatabaseJobStore, migrate
from service.adapters.database.tables import connect
from service.errors import AddressRefusedError
from service.ports import CallbackBody, CallbackEvent, Job, JobStatus, Subscription
from service.settings import Settings
from service.use_cases.callbacks.deliver_callbacks import MOST_PER_HOST, CallbackDelivery
from tests.doubles.memory import MemoryBlobStore

NOW = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
SUBSCRIPTION = Subscription(
    {event: f"https://{event.value}.example/hook?token=secret" for event in CallbackEvent}, "", "https://base.example"
)


class Receivers:
    """Answer as told; remember what came."""

    def __init__(self) -> None:
        self.answers: list[int | str] = []
        self.received: list[tuple[str, Mapping[str, str], Any]] = []
        self.open = asyncio.Event()
        self.open.set()
        self.waiting = 0

    async def check(self, uri: str) -> None:
        raise AssertionError(uri)

    async def send(self, uri: str, headers: Mapping[str, str], body: CallbackBody) -> int:
        self.waiting += 1
        await self.open.wait()
        self.waiting -= 1
        content = b"".join([piece async for piece in body.pieces()])
        assert len(content) == body.size
        self.received.append((uri, headers, json.loads(content)))
        answer = self.answers.pop(0) if self.answers else 200
        if isinstance(answer, str):
            raise AddressRefusedError(uri, answer)
        return answer


class Scene:
    def __init__(self, directory: Path) -> None:
        settings = Settings(data_dir=directory, callback_attempts=3, callback_back_off_s=1e-6, callback_interval_s=1e-6)
        migrate(settings)
        self.engine = connect(settings)
        DatabaseExecutors(self.engine).register("worker")
        self.jobs = DatabaseJobStore(self.engine)
        self.log = DatabaseJobLog(self.engine)
        self.blobs, self.receivers = MemoryBlobStore(), Receivers()
        callbacks = DatabaseCallbacks(self.engine)
        self.delivery = CallbackDelivery(
            *(callbacks, self.jobs, self.blobs, self.log, self.receivers, settings, "worker")
        )

    def add(self, job_id: str = "j", wanted: dict[str, Any] | None = None) -> None:
        subscriber = SUBSCRIPTION.to_json()
        job = Job(job_id, "echo", {}, JobStatus.ACCEPTED, NOW, subscriber=subscriber, wanted=wanted)
        self.jobs.create_and_enqueue(job)
        self.blobs.write_bytes(f"jobs/{job_id}/result.json", b'{"a": 1, "b": 2}')

    def deliver(self, times: int = 1) -> None:
        """Deliver all that is due, so often."""

        async def each() -> None:
            for _ in range(times):
                for claimed in self.delivery.callbacks.claim("worker", 10, 60.0, ()):
                    await self.delivery.deliver(claimed)

        asyncio.run(each())

    def texts(self) -> list[str]:
        return [f"{line.level} {line.text}" for line in self.log.read("j", 100)]


@pytest.fixture
def scene(tmp_path: Path) -> Iterator[Scene]:
    made = Scene(tmp_path)
    yield made
    made.engine.dispose()


def test_a_success_is_told_with_the_result(scene: Scene) -> None:
    scene.add()
    scene.jobs.succeed("j", NOW)
    scene.deliver(2)
    ((uri, headers, body),) = scene.receivers.received
    assert (uri, body) == ("https://success.example/hook?token=secret", {"a": 1, "b": 2})
    assert headers["webhook-id"] == "j_success"


def test_of_a_success_only_the_outputs_are_told_that_were_wanted(scene: Scene) -> None:
    scene.add(wanted={"outputs": ["b"], "raw": True})
    scene.jobs.succeed("j", NOW)
    scene.deliver()
    assert scene.receivers.received[0][2] == {"b": 2}


@pytest.mark.parametrize("end", ["fail", "dismiss"])
def test_the_status_of_a_job_that_does_not_succeed_is_told_with_links_to_the_service(scene: Scene, end: str) -> None:
    scene.add()
    getattr(scene.jobs, end)("j", *([{"title": "x"}] if end == "fail" else []), NOW)
    scene.deliver()
    ((uri, _, body),) = scene.receivers.received
    assert uri.startswith("https://failed.example/")
    assert (body["jobID"], body["status"]) == ("j", "failed" if end == "fail" else "dismissed")
    assert body["links"][0]["href"] == "https://base.example/jobs/j"


def test_progress_is_told_only_when_there_is_news(scene: Scene) -> None:
    scene.add()
    scene.jobs.start("j", NOW)
    scene.jobs.report("j", 0, "first", NOW)
    scene.deliver(3)
    scene.jobs.report("j", 40, "half", NOW.replace(minute=30))
    scene.deliver(3)
    assert [(headers["webhook-id"], body["message"]) for _, headers, body in scene.receivers.received] == [
        *(("j_inProgress_1", "first"), ("j_inProgress_2", "half")),
    ]


def test_the_log_says_what_failed_and_what_arrived_without_the_query(scene: Scene) -> None:
    scene.receivers.answers = [503, "it was not reached: no route"]
    scene.add()
    scene.jobs.succeed("j", NOW)
    scene.deliver(3)
    place = "callback j_success to https://success.example/hook"
    assert scene.texts() == [
        f"warning {place}: failed at attempt 1 of 3: its server answered 503; tried again in 0 s",
        f"warning {place}: failed at attempt 2 of 3: it was not reached: no route; tried again in 0 s",
        f"info {place}: delivered at attempt 3 (answer 200)",
    ]


def test_what_fails_as_often_as_it_may_is_given_up_and_the_job_stays_as_it_is(scene: Scene) -> None:
    scene.receivers.answers = [500] * 10
    scene.add()
    scene.jobs.succeed("j", NOW)
    scene.deliver(10)
    assert len(scene.receivers.received) == 3
    assert "given up after 3 attempts" in scene.texts()[-1]
    job = scene.jobs.get("j")
    assert job is not None
    assert job.status is JobStatus.SUCCESSFUL


def test_a_result_that_is_missing_is_given_up(scene: Scene) -> None:
    scene.add()
    scene.blobs.delete_prefix("jobs/j/")
    scene.jobs.succeed("j", NOW)
    scene.deliver(2)
    assert scene.receivers.received == []
    assert "the result is missing" in scene.texts()[-1]


def test_a_fault_of_the_service_holds_up_nothing_else_and_is_given_up_in_the_end(scene: Scene) -> None:
    scene.add("other")
    scene.add("wanted", wanted={"outputs": None, "raw": False})
    scene.blobs.write_bytes("jobs/wanted/result.json", b"{")  # no JSON, by a fault of the disk
    for job_id in ("wanted", "other"):
        scene.jobs.succeed(job_id, NOW)
    asyncio.run(scene.delivery.deliver_until(lambda: "given up" in str(scene.log.read("wanted", 100))))
    assert [headers["webhook-id"] for _, headers, _ in scene.receivers.received] == ["other_success"]


@pytest.mark.slow
def test_a_receiver_that_does_not_answer_holds_up_only_its_own(scene: Scene) -> None:
    for number in range(MOST_PER_HOST + 2):
        scene.add(f"j{number}")
        scene.jobs.succeed(f"j{number}", NOW)
    scene.add("other")
    scene.jobs.dismiss("other", NOW)
    scene.receivers.open.clear()

    async def begin() -> int:
        looks = 0

        def enough() -> bool:
            nonlocal looks
            looks += 1
            return looks > 2 and scene.receivers.waiting > MOST_PER_HOST

        await scene.delivery.deliver_until(enough)
        return scene.receivers.waiting

    assert asyncio.run(begin()) == MOST_PER_HOST + 1


@pytest.mark.slow
def test_what_is_under_way_is_left_when_told_to_stop(scene: Scene) -> None:
    scene.add()
    scene.jobs.succeed("j", NOW)
    scene.receivers.open.clear()
    asyncio.run(scene.delivery.deliver_until(lambda: scene.receivers.waiting > 0))
    assert scene.receivers.received == []
    assert scene.texts() == []
