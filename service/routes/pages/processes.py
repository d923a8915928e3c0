"""Forms by which processes are started."""

from typing import Any

from fastapi import Request, Response

from service.ports import Process
from service.processes import PROCESSES, offered_process
from service.processes.register import REGISTER
from service.routes.page_answers import PageRoute, language_of, page
from service.web.option_help import option_words


def list_processes(request: Request) -> Response:
    """List what this service can do."""
    return page(request, "processes", {"processes": PROCESSES})


def show_process(request: Request) -> Response:
    """Show the form of a process; what it asks for follows from the schema of its inputs."""
    return _form(request, "process", offered_process(request.path_params["process_id"]))


def new_registration(request: Request) -> Response:
    """Show where scans and photos are dropped, stations named, options chosen, and a registration started."""
    return _form(request, "registration", REGISTER)


def _form(request: Request, template: str, process: Process[Any]) -> Response:
    words = option_words(process, language_of(request))
    return page(request, template, {"process": process, "option_words": words})


ROUTES = (
    PageRoute("/processes", list_processes),
    PageRoute("/processes/{process_id}", show_process),
    PageRoute("/registrations", new_registration),
)
