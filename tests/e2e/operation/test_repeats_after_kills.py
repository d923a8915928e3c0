"""The API dies in the middle of a request that has an Idempotency-Key: sent again, it is done once."""

import time
from collections.abc import Iterator
from contextlib import suppress

import httpx
import pytest

from tests.e2e.operation.dying_service import ANSWERED, POINTS
from tests.e2e.running.running_service import Document, RunningService, alive, wait_until
from tests.measures.patience import patience

pytestmark = pytest.mark.service

WITHIN_S = 120.0
DEATHS = (*POINTS, ANSWERED)


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningService]:
    home = tmp_path_factory.mktemp("dying")
    running = RunningService(
        home, {"WORKERS": "1", "API_PROCESSES": "2"}, program=("tests.e2e.operation.dying_service",)
    )
    running.start()
    wait_until(lambda: len(running.apis()) == 2)
    yield running
    running.stop()


def asked(service: RunningService, point: str) -> httpx.Response:
    return httpx.post(
        f"{service.url}/processes/echo/execution",
        json={"inputs": {"stringInput": point}},
        headers={"Idempotency-Key": f"dies-{point}", "Prefer": "respond-async"},
        timeout=30.0 * patience(),
    )


def asked_until_answered(service: RunningService, point: str) -> httpx.Response:
    deadline = time.monotonic() + WITHIN_S * patience()
    while time.monotonic() < deadline:
        try:
            answer = asked(service, point)
        except httpx.TransportError:  # it is not there again yet
            time.sleep(0.1)
            continue
        if answer.status_code != httpx.codes.CONFLICT:
            return answer
        assert answer.json()["title"] == "Request under way"
        time.sleep(0.2)
    pytest.fail(f"{point}: no answer in {WITHIN_S} s")


@pytest.fixture(scope="module")
def repeated(service: RunningService) -> dict[str, list[httpx.Response]]:
    """Send every request until its process dies, and then twice more: all deaths before all repetitions."""
    for point in DEATHS:
        (service.data / f"die-{point}").touch()
        apis = service.apis()
        with suppress(httpx.TransportError):
            asked(service, point)
        wait_until(lambda: not all(alive(api) for api in apis), 30.0)  # noqa: B023
        wait_until(service.answers, WITHIN_S)
    return {point: [asked_until_answered(service, point) for _ in range(2)] for point in DEATHS}


def jobs(service: RunningService) -> list[Document]:
    return list(httpx.get(f"{service.url}/jobs", timeout=30.0 * patience()).json()["jobs"])


@pytest.mark.parametrize("point", DEATHS)
def test_who_asks_again_gets_the_same_job(repeated: dict[str, list[httpx.Response]], point: str) -> None:
    first, second = repeated[point]
    assert (first.status_code, second.status_code) == (201, 201)
    assert first.json() == second.json()
    assert first.headers["location"] == second.headers["location"]
    assert second.headers["idempotent-replayed"] == "true"


@pytest.mark.parametrize("point", ["kept", ANSWERED])
def test_an_answer_that_was_kept_is_given_at_once(repeated: dict[str, list[httpx.Response]], point: str) -> None:
    assert repeated[point][0].headers["idempotent-replayed"] == "true"


def test_there_is_one_job_of_each_and_it_runs_once(
    service: RunningService, repeated: dict[str, list[httpx.Response]]
) -> None:
    made = sorted(answers[0].json()["jobID"] for answers in repeated.values())
    assert sorted(job["jobID"] for job in jobs(service)) == made
    for job_id in made:
        assert service.finished(job_id)["status"] == "successful"
        log = httpx.get(f"{service.url}/jobs/{job_id}/log", timeout=30.0 * patience()).text
        assert log.count("echoing: done") == 1
    assert len(jobs(service)) == len(DEATHS)
