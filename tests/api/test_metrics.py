"""Figures for Prometheus."""

import re
from datetime import UTC, datetime
from pathlib import Path

from prometheus_client.parser import text_string_to_metric_families

from service.dependencies import Adapters
from service.ports import Job, JobStatus, StepFigures
from service.routes.metrics import FAULTS
from service.settings import Settings
from tests.api.conftest import Client, FakeSteps
from tests.doubles.application import create_app
from tests.doubles.memory import MemoryBlobStore, MemoryFileStore, MemoryJobLog, MemoryJobStore, MemoryQueue


def figures(client: Client) -> dict[tuple[str, ...], float]:
    """Read the figures as Prometheus does: by name and values of the labels."""
    text = client.get("/metrics").text
    return {
        (sample.name, *(value for _, value in sorted(sample.labels.items()))): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


def test_jobs_are_counted_by_status(client: Client, adapters: Adapters) -> None:
    now = datetime.now(UTC)
    for k in range(3):
        adapters.jobs.create_and_enqueue(Job(f"job{k}", "echo", {}, JobStatus.ACCEPTED, created=now))
    adapters.jobs.dismiss("job0", now)
    found = figures(client)
    assert found["tieline_jobs", "accepted"] == 2
    assert found["tieline_jobs", "dismissed"] == 1
    assert found["tieline_workers",] == 1


def test_the_queue_of_steps_is_told_with_times_and_failures(tmp_path: Path) -> None:
    totals = {
        "steps": {"features": 4.0},
        "step_seconds": {"features": 20.0},
        "step_wait_seconds": {"features": 2.0},
        "job_failures": {"Unusable input": 3.0},
        "deaths": {"": 1.0},
    }
    blobs = MemoryBlobStore()
    queue = MemoryQueue(figures=StepFigures(7, 2, 31.5, totals))
    adapters = Adapters(MemoryJobStore(), MemoryFileStore(), blobs, queue, FakeSteps(blobs), MemoryJobLog())
    found = figures(Client(create_app(Settings(data_dir=tmp_path), adapters)))
    assert (found["tieline_steps", "waiting"], found["tieline_steps", "running"]) == (7, 2)
    assert found["tieline_oldest_waiting_step_seconds",] == 31.5
    assert found["tieline_step_seconds_sum", "features"] / found["tieline_step_seconds_count", "features"] == 5.0
    assert found["tieline_step_wait_seconds_sum", "features"] == 2.0
    assert found["tieline_job_failures_total", "Unusable input"] == 3
    assert found["tieline_interrupted_steps_total",] == 1


def test_failures_that_are_the_services_are_told_before_there_is_any_so_that_the_first_one_is_an_increase(
    client: Client,
) -> None:
    found = figures(client)
    for kind in ("Computation failed", "Insufficient storage", "Internal error", "Queue unavailable"):
        assert found["tieline_job_failures_total", kind] == 0
    assert found["tieline_job_failures_total", "Storage unavailable"] == 0


def test_requests_are_counted_by_route_not_by_address(client: Client) -> None:
    for name in ("one", "two"):
        client.get(f"/jobs/{name}")
    assert figures(client)["http_requests_total", "/jobs/{job_id}", "GET", "404"] == 2


def test_looking_at_the_figures_is_not_counted(client: Client) -> None:
    figures(client)
    assert not [name for name in figures(client) if "/metrics" in name]


def test_what_is_refused_before_a_route_is_looked_for_counts_for_that_route(client: Client) -> None:
    client.get("/keys")
    client.post("/jobs/one")
    client.get("/nowhere")
    found = figures(client)
    assert found["http_requests_total", "/keys", "GET", "403"] == 1
    assert found["http_requests_total", "/jobs/{job_id}", "POST", "405"] == 1
    assert found["http_requests_total", "none", "GET", "404"] == 1


def test_sizes_and_times_are_counted_by_route(client: Client) -> None:
    client.get("/jobs/one")
    found = figures(client)
    assert found["http_request_duration_seconds_count", "/jobs/{job_id}", "GET"] == 1
    assert found["http_request_duration_highr_seconds_count",] >= 1
    assert found["http_response_size_bytes_sum", "/jobs/{job_id}"] > 0


def test_alarms_that_the_page_names_ask_for_figures_and_kinds_that_there_are(client: Client) -> None:
    client.get("/jobs")
    page = (Path(__file__).resolve().parents[2] / "service" / "README.md").read_text()
    alarms = page.partition("\n## Watching it\n")[2].partition("\n## ")[0]
    known = {name for name, *_ in figures(client)} | {
        f"tieline_step{what}_seconds{part}" for what in ("", "_wait") for part in ("", "_sum", "_count")
    }
    named = set(re.findall(r"\b(?:tieline|http)_\w+", alarms))
    assert named
    assert named <= known
    kinds = re.search(r'kind=~"([^"]+)"', alarms)
    assert kinds is not None
    assert set(kinds[1].split("\\|")) == set(FAULTS)
