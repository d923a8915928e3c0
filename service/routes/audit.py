"""The audit log; with the scope admin only."""

from typing import Annotated

from fastapi import Query
from pydantic import AwareDatetime

from schemas.resources.audit import AuditDocument, AuditList
from service.dependencies import AccessStoresDependency, BaseUrlDependency
from service.ports import AuditFilter
from service.routes.documents import page_links
from service.routes.paging import LimitParameter, OffsetParameter, page_size
from service.routes.problems import PROBLEM_RESPONSES
from service.routes.readable_router import ReadableRouter
from service.use_cases.access.manage_keys import owner_of, shown_project

router = ReadableRouter(tags=["keys"], responses=PROBLEM_RESPONSES)
KeyParameter = Annotated[str | None, Query(description="Only what was done with this key (its `id`).")]
ProjectParameter = Annotated[str | None, Query(description="Only what was done in this project.")]
SinceParameter = Annotated[AwareDatetime | None, Query(description="Only what was done then or later.")]


@router.get("/audit", summary="Who changed what, newest first")
def list_audit(
    stores: AccessStoresDependency,
    url: BaseUrlDependency,
    limit: LimitParameter = 100,
    offset: OffsetParameter = 0,
    key: KeyParameter = None,
    project: ProjectParameter = None,
    since: SinceParameter = None,
) -> AuditList:
    """List the requests of all projects that changed something, and those that were refused, page by page."""
    limit = page_size(limit)
    owner = None if project is None else owner_of(project)
    found, total = stores.audit.find(AuditFilter(key, owner, since, limit, offset))
    given = {"key": key, "project": project, "since": None if since is None else since.isoformat()}
    query = {name: [value] for name, value in given.items() if value is not None}
    return AuditList(
        entries=[
            AuditDocument(
                time=entry.time,
                key=entry.key_id,
                project=shown_project(entry.project),
                remote=entry.remote,
                method=entry.method,
                path=entry.path,
                status=entry.status,
                request_id=entry.request_id,
            )
            for entry in found
        ],
        number_matched=total,
        number_returned=len(found),
        links=page_links(url, "/audit", query, limit, offset, total),
    )
