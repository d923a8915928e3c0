"""Forms by which processes are started."""

from fastapi import Request, Response

from service.processes import PROCESSES, offered_process
from service.processes.register import REGISTER
from service.routes.page_answers import PageRoute, page


def list_processes(request: Request) -> Response:
    """List what this service can do."""
    return page(request, "processes", {"processes": PROCESSES})


def show_process(request: Request) -> Response:
    """Show the form of a process; what it asks for follows from the schema of its inputs."""
    return page(request, "process", {"process": offered_process(request.path_params["process_id"])})


def new_registration(request: Request) -> Response:
    """Show where scans and photos are dropped, stations named, options chosen, and a registration started."""
    return page(request, "registration", {"process": REGISTER})


ROUTES = (
    PageRoute("/processes", list_processes),
    PageRoute("/processes/{process_id}", show_process),
    PageRoute("/registrations", new_registration),
)
