"""The one place where jobs and files become documents."""

from urllib.parse import urlencode

from schemas.files import FileDocument, PhotoDocument, ScanDocument
from schemas.jobs import StatusInfo
from schemas.links import Link
from service.dependencies import BaseUrl
from service.ports import Job, JobStatus, StoredFile

RESULTS = "http://www.opengis.net/def/rel/ogc/1.0/results"


def status_info(job: Job, url: BaseUrl) -> StatusInfo:
    """Describe where a job stands, as OGC API - Processes 1.0 names it."""
    here = url(f"/jobs/{job.id}")
    links = [Link(href=here, rel="self", title="This job")]
    if job.status is not JobStatus.ACCEPTED:
        links.append(Link(href=f"{here}/log", rel="related", type="text/plain", title="Log of the job"))
    if job.status in {JobStatus.SUCCESSFUL, JobStatus.FAILED}:
        links.append(Link(href=f"{here}/results", rel=RESULTS, title="Result of the job"))
    if job.status is JobStatus.SUCCESSFUL:
        links.append(Link(href=f"{here}/artifacts", rel="related", title="Downloads of the job"))
    if not job.status.finished:
        links.append(Link(href=here, rel="dismiss", title="DELETE to dismiss the job"))
        links.append(Link(href=f"{here}/events", rel="monitor", type="text/event-stream", title="Events of the job"))
    return StatusInfo(
        process_id=job.process_id,
        job_id=job.id,
        status=job.status.value,
        message=job.message,
        progress=job.progress,
        attempts=job.attempts,
        created=job.created,
        started=job.started,
        finished=job.finished,
        updated=job.updated,
        links=links,
    )


def file_document(file: StoredFile, url: BaseUrl) -> FileDocument:
    """Describe an uploaded file."""
    here = url(f"/files/{file.id}")
    return FileDocument(
        id=file.id,
        name=file.name,
        bytes=file.bytes,
        sha256=file.sha256,
        format=file.format,
        kind=file.kind,
        scans=[ScanDocument.model_validate(scan) for scan in file.scans],
        photos=[PhotoDocument.model_validate(photo) for photo in file.photos],
        created=file.created,
        expires=file.expires,
        links=[
            Link(href=here, rel="self", title="This file"),
            Link(href=f"{here}/content", rel="enclosure", type="application/octet-stream", title="Its content"),
        ],
    )


def page_links(url: BaseUrl, path: str, query: dict[str, list[str]], limit: int, offset: int, total: int) -> list[Link]:
    """Link a page of a list to itself and its neighbours."""
    pages = {"self": offset}
    if offset + limit < total:
        pages["next"] = offset + limit
    if offset > 0:
        pages["prev"] = max(offset - limit, 0)
    return [
        Link(href=url(f"{path}?{_encoded(query, limit, start)}"), rel=rel, title=f"{rel} page")
        for rel, start in pages.items()
    ]


def _encoded(query: dict[str, list[str]], limit: int, offset: int) -> str:
    return urlencode({**query, "limit": limit, "offset": offset}, doseq=True)
