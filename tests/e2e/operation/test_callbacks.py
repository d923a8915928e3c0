"""Callbacks of the whole service to a real receiver, which is slow, away, or wants no more; and deliverers that die."""

import json
import socket
from collections.abc import Iterator
from typing import Any

import pytest

from service.use_cases.callbacks.callback_signatures import derived_secret
from tests.e2e.running.callback_receiver import Receiver, receiving
from tests.e2e.running.file_server import FileServer
from tests.e2e.running.reaching_service import SECRET
from tests.e2e.running.running_service import RunningService, wait_until

pytestmark = pytest.mark.service


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
    wait_until(lambda: words in service.http.get(f"/jobs/{job}/log").text, 60.0, every_s=0.1)


def test_a_success_is_told_once_with_the_result_and_for_echo_without_a_signature(
    reaching: RunningService, receiver: Receiver
) -> None:
    job = run(reaching, all_three(receiver))
    settled(reaching, job, f"{job}_success to {receiver.url}/success: delivered at attempt 1 (answer 204)")
    (told,) = receiver.of("/success")
    result = reaching.http.get(f"/jobs/{job}/results")
    assert (result.status_code, result.json()) == (200, {"stringInput": "told"})
    assert json.loads(told.body) == result.json()
    assert (told.id, told.headers["content-type"]) == (f"{job}_success", "application/json")
    assert "webhook-signature" not in told.headers
    assert not receiver.of("/failed")


def test_what_is_signed_in_the_operators_name_is_for_one_project_receiver_and_process(
    reaching: RunningService, receiver: Receiver, elsewhere: FileServer
) -> None:
    inputs = {"photo": {"href": f"{elsewhere.url}/none.jpg"}}
    body = {"inputs": inputs, "subscriber": all_three(receiver)}
    job = str(reaching.post("/processes/detect-edges/execution", json=body).json()["jobID"])
    settled(reaching, job, f"{job}_failed to {receiver.url}/failed: delivered")
    (told,) = receiver.of("/failed")
    assert told.is_signed_with(derived_secret(SECRET, "", receiver.url, "detect-edges"))
    for other in ((SECRET, "alice", receiver.url, "detect-edges"), (SECRET, "", receiver.url, "register")):
        assert not told.is_signed_with(derived_secret(*other))
    assert not told.is_signed_with(SECRET)


def test_a_failure_is_told_once_with_the_status(
    reaching: RunningService, receiver: Receiver, elsewhere: FileServer
) -> None:
    body = {
        "inputs": {"photo": {"href": f"{elsewhere.url}/none.jpg"}},
        "subscriber": {**all_three(receiver), "secret": "a secret of the subscriber"},
    }
    job = str(reaching.post("/processes/detect-edges/execution", json=body).json()["jobID"])
    kept = list(reaching.home.rglob("tieline.sqlite*"))
    assert kept
    assert [path.name for path in kept if b"a secret of the subscriber" in path.read_bytes()] == []
    settled(reaching, job, f"{job}_failed to {receiver.url}/failed: delivered")
    (told,) = receiver.of("/failed")
    assert json.loads(told.body) == reaching.job(job)
    assert reaching.job(job)["status"] == "failed"
    assert told.is_signed_with("a secret of the subscriber")
    assert not receiver.of("/success")


def test_progress_is_told_while_the_job_runs(reaching: RunningService, receiver: Receiver) -> None:
    job = run(reaching, {"inProgressUri": f"{receiver.url}/inProgress"}, pause=2)
    assert reaching.finished(job)["status"] == "successful"
    told = receiver.of("/inProgress")
    assert [each.id for each in told] == [f"{job}_inProgress_{number}" for number in range(1, len(told) + 1)]
    assert {json.loads(each.body)["status"] for each in told} == {"running"}


def test_a_receiver_that_is_away_for_a_while_hears_it_later(reaching: RunningService) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    job = run(reaching, {"successUri": f"http://127.0.0.1:{port}/late"})
    settled(reaching, job, "failed at attempt 1 of 4")
    assert reaching.job(job)["status"] == "successful"
    with receiving(port) as receiver:
        settled(reaching, job, "delivered at attempt")
        assert [told.id for told in receiver.of("/late")] == [f"{job}_success"]


def test_a_receiver_that_refuses_again_and_again_is_given_up(reaching: RunningService, receiver: Receiver) -> None:
    receiver.answers["/success"] = [503, 302, 404, 500, 500]
    job = run(reaching, all_three(receiver))
    settled(reaching, job, "given up after 4 attempts: its server answered 500")
    assert [told.id for told in receiver.of("/success")] == [f"{job}_success"] * 4
    assert not receiver.of("/elsewhere")
    assert reaching.job(job)["status"] == "successful"


def test_a_receiver_that_wants_no_more_is_not_asked_again(reaching: RunningService, receiver: Receiver) -> None:
    receiver.answers["/success"] = [410]
    job = run(reaching, all_three(receiver))
    settled(reaching, job, "given up after 1 attempts: its server answered 410")
    assert len(receiver.of("/success")) == 1


def test_what_a_killed_worker_was_telling_is_told_by_the_next_under_the_same_name(
    reaching: RunningService, receiver: Receiver
) -> None:
    receiver.answers["/success"] = [0]
    job = run(reaching, all_three(receiver))
    wait_until(lambda: len(receiver.of("/success")) == 1, 60.0)
    reaching.worker().kill()
    settled(reaching, job, "delivered at attempt 2")
    assert [told.id for told in receiver.of("/success")] == [f"{job}_success"] * 2


def test_a_removed_job_is_told_nobody(reaching: RunningService, receiver: Receiver) -> None:
    receiver.answers["/success"] = [503]
    job = run(reaching, all_three(receiver))
    settled(reaching, job, "failed at attempt 1 of 4")
    assert reaching.http.delete(f"/jobs/{job}").status_code == 200
    later = run(reaching, {"successUri": f"{receiver.url}/later"}, pause=2)
    settled(reaching, later, "delivered")
    assert len(receiver.of("/success")) == 1
