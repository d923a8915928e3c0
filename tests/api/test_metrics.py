"""Figures for Prometheus."""

from datetime import UTC, datetime

from prometheus_client.parser import text_string_to_metric_families

from service.dependencies import Adapters
from service.ports import Job, JobStatus
from tests.api.conftest import Client


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
