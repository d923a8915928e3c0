"""Jobs: their list, how one goes, what came out."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from fastapi import Request, Response

from service.dependencies import Adapters, adapters_of
from service.names.identifiers import is_identifier
from service.ports import Job, JobFilter, JobStatus
from service.processes import OFFERED_PROCESSES, PROCESSES
from service.routes.page_answers import PageRoute, elsewhere, language_of, page
from service.routes.pages.pieces_of_lists import Piece, piece_of
from service.use_cases.jobs.find_job import find_artifacts, find_job, find_result, find_whole_job
from service.use_cases.jobs.find_rows import LARGEST_DOCUMENT, list_of_result
from service.use_cases.reports.figures import registration_figures
from service.web.links_graph import links_graph
from service.web.result_view import result_view

MOST_LINES = 200


def list_jobs(request: Request) -> Response:
    """List the jobs of a project, newest first."""
    piece = piece_of(request, ("status", "processID", "lang"))
    status, process = (request.query_params.get(name, "") for name in ("status", "processID"))
    which = JobFilter(
        statuses=tuple(each for each in JobStatus if each.value == status),
        process_ids=(process,) if is_identifier(process) else (),
        limit=piece.size,
        offset=piece.begin,
    )
    found, total = adapters_of(request).jobs.find(which)
    values = {
        "jobs": found,
        "piece": piece.of(total),
        "chosen_status": status,
        "chosen_process": process,
        "statuses": [each.value for each in JobStatus],
        "processes": [each.id for each in PROCESSES],
    }
    return page(request, "jobs", values)


def show_job(request: Request) -> Response:
    """Show where a job stands, and follow it."""
    adapters = adapters_of(request)
    return _job_page(request, find_whole_job(request.path_params["job_id"], adapters.jobs), adapters)


def show_result(request: Request) -> Response:
    """Show what came out of a job; what there is to see of it until then, or of one that failed, is on its own page."""
    adapters = adapters_of(request)
    job = find_job(request.path_params["job_id"], adapters.jobs)
    if job.status is not JobStatus.SUCCESSFUL:
        return elsewhere(request, f"/jobs/{job.id}")
    result = find_result(job.id, adapters.jobs, adapters.blobs)
    document = _document(result) if isinstance(result, Path) else result
    shown = part_of_lists(request, job.id, document or {}, result, adapters) if isinstance(result, Path) else None
    whole = document if shown is None else {**(document or {}), **shown.entries}
    values = {
        "job": job,
        "title": _title(job),
        "artifacts": find_artifacts(job.id, adapters.jobs, adapters.blobs),
        "view": None if document is None else result_view(job.process_id, document, language_of(request)),
        "graph": None if document is None else links_graph(document, language_of(request)),
        "document": whole,
        "found": registration_figures(whole) if whole is not None and job.process_id == "register" else None,
        "part": shown,
    }
    return page(request, "result", values)


@dataclass(frozen=True)
class Part:
    """Some entries of the lists of a large network."""

    chosen: str
    """The list whose piece is shown."""
    piece: Piece
    entries: Mapping[str, Sequence[Any]]
    """Lists of the document, by name."""
    pairs: str
    """Query for the first piece of the pairs."""
    stations: str
    """Query for the first piece of the stations."""


def part_of_lists(
    request: Request, job_id: str, document: Mapping[str, Any], result: Path, adapters: Adapters
) -> Part | None:
    """Give the stations with their features, or the pairs, that are asked for; None where all is in the document."""
    if not document.get("lists"):
        return None
    chosen = "pairs" if request.query_params.get("list") == "pairs" else "stations"
    names = ("pairs",) if chosen == "pairs" else ("stations", "features")
    piece = piece_of(request, ("list", "lang"))
    found = {name: list_of_result(job_id, name, result, adapters.blobs) for name in names}
    entries = {
        name: [json.loads(row) for row in rows.rows(piece.begin, piece.begin + piece.size)]
        for name, rows in found.items()
    }
    lang = {name: value for name in ("lang",) if (value := request.query_params.get(name))}
    pairs, stations = (f"?{urlencode({'list': each, **lang})}" for each in ("pairs", "stations"))
    return Part(chosen, piece.of(found[chosen].count), entries, pairs, stations)


def _document(result: Path) -> dict[str, Any] | None:
    if result.stat().st_size > LARGEST_DOCUMENT:  # only offered for download
        return None
    document = json.loads(result.read_bytes())
    return document if isinstance(document, dict) else None


def _job_page(request: Request, job: Job, adapters: Adapters) -> Response:
    values = {
        "job": job,
        "title": _title(job),
        "lines": adapters.log.read(job.id, MOST_LINES),
        "stations": [each for each in job.inputs.get("stations", []) if isinstance(each, dict)]
        if isinstance(job.inputs.get("stations"), list)
        else [],
    }
    return page(request, "job", values)


def _title(job: Job) -> str:
    process = OFFERED_PROCESSES.get(job.process_id)
    return job.process_id if process is None else process.title


ROUTES = (
    PageRoute("/jobs", list_jobs),
    PageRoute("/jobs/{job_id}", show_job),
    PageRoute("/jobs/{job_id}/results", show_result),
)
