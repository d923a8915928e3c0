"""Figures for Prometheus: requests of all API processes, jobs and workers."""

import os
from collections.abc import Iterator, Sequence

from fastapi import FastAPI, Request, Response
from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, generate_latest
from prometheus_client.metrics_core import CounterMetricFamily, GaugeMetricFamily, Metric, SummaryMetricFamily
from prometheus_client.multiprocess import MultiProcessCollector
from prometheus_client.registry import Collector
from starlette.routing import BaseRoute

from service.dependencies import Adapters, WholeServiceDependency
from service.errors import (
    ComputationFailedError,
    InsufficientStorageError,
    QueueError,
    ServiceError,
    StorageError,
)
from service.ports import JobFilter, JobStatus, StepFigures
from service.routes.readable_router import ReadableRouter
from service.routes.request_counts import RequestCounts, RequestFigures

router = ReadableRouter(tags=["health"])

SHARED = "PROMETHEUS_MULTIPROC_DIR"
"""Environment variable of the folder in which all API processes of a service keep their counts."""
SUMMARIES = (
    ("tieline_step_seconds", "step_seconds", "How long steps were computed."),
    ("tieline_step_wait_seconds", "step_wait_seconds", "How long steps waited for a worker before they were computed."),
)


FAULTS = (
    ComputationFailedError.title,
    InsufficientStorageError.title,
    QueueError.title,
    ServiceError.title,
    StorageError.title,
)
"""Kinds of failures that are not the clients'."""


class JobFigures(Collector):
    """Count jobs and workers when asked.

    Parameters
    ----------
    adapters
        Where they are.
    """

    def __init__(self, adapters: Adapters) -> None:
        self._adapters = adapters

    def collect(self) -> Iterator[Metric]:
        """Give the figures."""
        jobs = GaugeMetricFamily("tieline_jobs", "Jobs that are kept, by status.", labels=["status"])
        for status in JobStatus:
            _, number = self._adapters.jobs.find(JobFilter(statuses=(status,), limit=1))
            jobs.add_metric([status.value], number)
        yield jobs
        yield GaugeMetricFamily(
            "tieline_workers", "Workers whose heart beats.", value=self._adapters.queue.live_workers()
        )
        yield from _of_steps(self._adapters.queue.figures())


def _of_steps(figures: StepFigures) -> Iterator[Metric]:
    """Give what there is to see of the queue; what is counted goes on growing over restarts of the service."""
    steps = GaugeMetricFamily("tieline_steps", "Steps of jobs that are not finished, by state.", labels=["state"])
    steps.add_metric(["waiting"], figures.waiting)
    steps.add_metric(["running"], figures.running)
    yield steps
    yield GaugeMetricFamily(
        "tieline_oldest_waiting_step_seconds",
        "How long the step has waited that waits longest.",
        value=figures.longest_wait_s,
    )
    for name, total, says in SUMMARIES:
        summary = SummaryMetricFamily(name, says, labels=["step"])
        for step, number in sorted(figures.totals.get("steps", {}).items()):
            summary.add_metric([step], int(number), figures.totals.get(total, {}).get(step, 0.0))
        yield summary
    failures = CounterMetricFamily("tieline_job_failures", "Jobs that failed, by kind of problem.", labels=["kind"])
    # an increase is only seen of what was there before
    for kind, number in sorted({**dict.fromkeys(FAULTS, 0.0), **figures.totals.get("job_failures", {})}.items()):
        failures.add_metric([kind], number)
    yield failures
    deaths = sum(figures.totals.get("deaths", {}).values())
    yield CounterMetricFamily("tieline_interrupted_steps", "Steps whose worker died meanwhile.", value=deaths)


def count_requests(app: FastAPI, routes: Sequence[BaseRoute]) -> None:
    """Count requests and how long they take, by route and status; files and events last until they begin to come.

    Parameters
    ----------
    app
        Answers the requests.
    routes
        What it answers, as it was written: the framework's own list builds every route anew when it is asked.
    """
    registry = CollectorRegistry()
    app.state.metrics = registry
    app.add_middleware(RequestCounts, figures=RequestFigures(registry), routes=routes)


@router.get("/metrics", summary="Figures for Prometheus", response_class=Response)
def metrics(request: Request, adapters: WholeServiceDependency) -> Response:
    """Give the counts of requests, jobs and workers in the text format of Prometheus."""
    if SHARED in os.environ:
        requests = CollectorRegistry()
        MultiProcessCollector(requests)  # type: ignore[no-untyped-call]
    else:
        requests = request.app.state.metrics
    figures = CollectorRegistry()
    figures.register(JobFigures(adapters))
    return Response(generate_latest(requests) + generate_latest(figures), media_type=CONTENT_TYPE_LATEST)
