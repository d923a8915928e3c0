"""Callbacks of the whole service to a real receiver, which is slow, away, or wants no more; and deliverers that die."""

import json
import socket
from collections.abc import Iterator
from typing import Any

import pytest

from tests.e2e.callback_receiver import Receiver, receiving
from tests.e2e.running_service import RunningService, running_service, wait_until

pytestmark = pytest.mark.service
SECRET = "whsec_" + "MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw"
SETTINGS = {
    "SLOTS": "2",
    "STEP_TIMEOUT_S": "4",
    "ALLOW_PRIVATE_CALLBACKS": "true",
    "CALLBACK_PORTS": "",
    "CALLBACK_SECRET": SECRET,
    "CALLBACK_BACK_OFF_S": "0.5",
    "CALLBACK_ATTEMPTS": "4",
    "CALLBACK_INTERVAL_S": "0.5",
}


@pytest.fixture(scope="module")
def telling(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningService]:
    with running_service(tmp_path_factory.mktemp("telling"), **SETTINGS) as running:
        yield running


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    with receiving() as running:
        yield running


def run(service: RunningService, subscriber: dict[str, str], **inputs: Any) -> str:
    body = {"inputs": {"stringInput": "told", **inputs}, "subscriber": subscriber}
    answer = service.post("/processes/echo/execution", json=body, headers={"Prefer": "respond-async"})
    assert answer.status_code == 201, answer.text
    return str(answer.json()["jobID"])


def all_three(receiver: Receiver) -> dict[str, str]:
    return {f"{event}Uri": f"{receiver.url}/{event}" for event in ("success", "inProgress", "failed")}


def settled(service: RunningService, job: str, words: str) -> None:
    """Wait until the log of the job says what became of a callback."""
    wait_until(lambda: words in service.http.get(f"/jobs/{job}/log").text, 20.0, every_s=0.1)


def test_a_success_is_told_once_with_the_result_and_a_signature(telling: RunningService, receiver: Receiver) -> None:
    job = run(telling, all_three(receiver))
    settled(telling, job, f"{job}_success to {receiver.url}/success: delivered at attempt 1 (answer 204)")
    (told,) = receiver.of("/success")
    assert json.loads(told.body) == telling.http.get(f"/jobs/{job}/results").json() == {"stringInput": "told"}
    assert (told.id, told.headers["content-type"]) == (f"{job}_success", "application/json")
    assert told.is_signed_with(SECRET)
    assert not told.is_signed_with("another secret, as long")
    assert not receiver.of("/failed")


def test_a_failure_is_told_once_with_the_status(telling: RunningService, receiver: Receiver) -> None:
    job = run(telling, {**all_three(receiver), "secret": "a secret of the subscriber"}, pause=20)
    settled(telling, job, f"{job}_failed to {receiver.url}/failed: delivered")
    (told,) = receiver.of("/failed")
    status = telling.job(job)
    assert json.loads(told.body) == status
    assert status["status"] == "failed"
    assert told.is_signed_with("a secret of the subscriber")
    assert not receiver.of("/success")
    progress = [json.loads(each.body) for each in receiver.of("/inProgress")]
    assert progress
    assert {each["status"] for each in progress} == {"running"}
    assert [each.id for each in receiver.of("/inProgress")] == [
        f"{job}_inProgress_{number}" for number in range(1, len(progress) + 1)
    ]


def test_a_receiver_that_is_away_for_a_while_hears_it_later(telling: RunningService) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    job = run(telling, {"successUri": f"http://127.0.0.1:{port}/late"})
    settled(telling, job, "failed at attempt 1 of 4")
    assert telling.job(job)["status"] == "successful"
    with receiving(port) as receiver:
        settled(telling, job, "delivered at attempt")
        assert [told.id for told in receiver.of("/late")] == [f"{job}_success"]


def test_a_receiver_that_refuses_again_and_again_is_given_up(telling: RunningService, receiver: Receiver) -> None:
    receiver.answers["/success"] = [503, 302, 404, 500, 500]
    job = run(telling, all_three(receiver))
    settled(telling, job, "given up after 4 attempts: its server answered 500")
    assert [told.id for told in receiver.of("/success")] == [f"{job}_success"] * 4
    assert not receiver.of("/elsewhere")
    assert telling.job(job)["status"] == "successful"


def test_a_receiver_that_wants_no_more_is_not_asked_again(telling: RunningService, receiver: Receiver) -> None:
    receiver.answers["/success"] = [410]
    job = run(telling, all_three(receiver))
    settled(telling, job, "given up after 1 attempts: its server answered 410")
    assert len(receiver.of("/success")) == 1


def test_what_a_killed_worker_was_telling_is_told_by_the_next_under_the_same_name(
    telling: RunningService, receiver: Receiver
) -> None:
    receiver.answers["/success"] = [0]
    job = run(telling, all_three(receiver))
    wait_until(lambda: len(receiver.of("/success")) == 1, 20.0)
    telling.worker().kill()
    settled(telling, job, "delivered at attempt 2")
    assert [told.id for told in receiver.of("/success")] == [f"{job}_success"] * 2


def test_a_removed_job_is_told_nobody(telling: RunningService, receiver: Receiver) -> None:
    receiver.answers["/success"] = [503]
    job = run(telling, all_three(receiver))
    settled(telling, job, "failed at attempt 1 of 4")
    assert telling.http.delete(f"/jobs/{job}").status_code == 200
    later = run(telling, {"successUri": f"{receiver.url}/later"}, pause=2)
    settled(telling, later, "delivered")
    assert len(receiver.of("/success")) == 1
