"""Jobs, files and pages of lists as documents."""

from urllib.parse import urlencode

from schemas.resources.files import FileDocument, PhotoDocument, ScanDocument
from schemas.values.links import Link
from service.dependencies import BaseUrl
from service.ports import StoredFile
from service.use_cases.documents.scan_warnings import file_warnings
from service.use_cases.jobs.describe_job import status_info

__all__ = ["file_document", "page_links", "status_info"]


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
        warnings=file_warnings(file),
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
