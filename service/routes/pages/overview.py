"""The first page, and the start of a registration."""

from fastapi import Request, Response

from service.dependencies import adapters_of, base_url_of, belongings_of
from service.ports import JobFilter, JobStatus
from service.routes.page_answers import PageRoute, access_of, page
from service.use_cases.access.check_access import NOBODY

LATEST = 8


def overview(request: Request) -> Response:
    """Show a project's latest files and jobs, and what it stores; ask for a key where that is not known."""
    if access_of(request) is NOBODY:
        return page(request, "login", {"back": "/", "refused": False})
    adapters, belongings, settings = adapters_of(request), belongings_of(request), request.app.state.settings
    files, _ = adapters.files.find(LATEST, 0)
    jobs, all_jobs = adapters.jobs.find(JobFilter(limit=LATEST))
    unfinished = (JobStatus.ACCEPTED, JobStatus.RUNNING)
    _, waiting = adapters.jobs.find(JobFilter(statuses=unfinished, limit=1))
    amount = adapters.files.amount()
    values = {
        "files": files,
        "jobs": jobs,
        "number_of_files": amount.files,
        "number_of_jobs": all_jobs,
        "unfinished": waiting,
        "used_bytes": amount.bytes + belongings.besides_files(),
        "most_bytes": settings.max_project_bytes,
        "address": base_url_of(request)("/registrations"),
    }
    return page(request, "overview", values)


ROUTES = (PageRoute("/", overview),)
