"""Every error of a request as a problem document."""

from http import HTTPStatus
from typing import Any, cast

import structlog
from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from sqlalchemy.exc import DBAPIError, InterfaceError, OperationalError
from sqlalchemy.exc import TimeoutError as NoConnectionError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect

from algorithms.errors import AlgorithmError
from schemas.values.problem import ProblemDocument
from service.errors import (
    FULL,
    FieldFault,
    InsufficientStorageError,
    InvalidRequestError,
    Problem,
    ServiceError,
    StorageError,
    bounded,
    to_problem,
)
from service.routes.accepted_types import accepts_plain_json_only, prefers_html
from service.routes.access_rules import SAFE
from service.routes.answer_headers import ALWAYS, NOTHING, OWN
from service.routes.correlation import request_id_of
from service.routes.page_answers import page
from service.use_cases.inputs.validate_request import pointer_to

PROBLEM_JSON = "application/problem+json"
log = structlog.get_logger()
PROBLEM_RESPONSES: dict[int | str, dict[str, Any]] = {
    "4XX": {
        "description": "What is wrong with the request",
        "content": {PROBLEM_JSON: {"schema": {"$ref": "#/components/schemas/ProblemDocument"}}},
    },
    "5XX": {
        "description": "What is wrong with the service",
        "content": {PROBLEM_JSON: {"schema": {"$ref": "#/components/schemas/ProblemDocument"}}},
    },
}
"""Declared for every route; `ProblemDocument` itself is added to the components by the composition root."""
PROBLEM_SCHEMA = ProblemDocument.model_json_schema(ref_template="#/components/schemas/{model}")


def install_error_handlers(app: FastAPI) -> None:
    """Answer every error with a problem document."""
    app.add_exception_handler(ServiceError, _known_error)
    for away in (OperationalError, InterfaceError, NoConnectionError):
        app.add_exception_handler(away, _database_down)
    app.add_exception_handler(AlgorithmError, _known_error)
    app.add_exception_handler(OSError, _disk_full)
    app.add_exception_handler(RequestValidationError, _bad_parameters)
    app.add_exception_handler(HTTPException, _http_error)
    app.add_exception_handler(ClientDisconnect, _client_left)
    app.add_exception_handler(Exception, _known_error)


def problem_response(problem: Problem, request: Request, headers: dict[str, str] | None = None) -> Response:
    """Answer with a problem document, as plain JSON for clients that accept nothing else; with a page for browsers."""
    if request.method in SAFE and prefers_html(request.headers.get("accept", "")):
        return _problem_page(problem, request, headers or {})
    plain = accepts_plain_json_only(request.headers.get("accept", ""))
    return JSONResponse(
        bounded({**problem, "instance": problem.get("instance", request.scope["path"])}),
        status_code=problem["status"],
        # also where nothing else adds them: unexpected errors are answered outside of what guards all others
        headers={**ALWAYS, "Content-Security-Policy": NOTHING, "Cache-Control": OWN, **(headers or {})},
        media_type="application/json" if plain else PROBLEM_JSON,
    )


def _problem_page(problem: Problem, request: Request, headers: dict[str, str]) -> Response:
    """Say what is wrong; to whom a key is missing, ask for it."""
    status = problem["status"]
    if status == HTTPStatus.UNAUTHORIZED:
        query = request.scope["query_string"].decode("latin-1")
        back = request.scope["path"] + (f"?{query}" if query else "")
        return page(request, "login", {"back": back, "refused": False}, status=status, headers=headers)
    values = {"problem": bounded(problem), "request_id": request_id_of(request.scope)}
    return page(request, "problem", values, status=status, headers=headers)


def error_response(error: Exception, request: Request) -> Response:
    """Answer with the problem document of an error, and its headers."""
    headers = dict(error.headers()) if isinstance(error, ServiceError) else {}
    request_id = request_id_of(request.scope)
    if request_id:  # unexpected errors are answered outside of what names the others' answers
        headers["X-Request-ID"] = request_id
    return problem_response(to_problem(error), request, headers)


def _known_error(request: Request, error: Exception) -> Response:
    """Answer any error; the details of unexpected ones go to the log only."""
    if isinstance(error, ServiceError) and error.status == HTTPStatus.SERVICE_UNAVAILABLE:
        log.error("a request was answered with 503", path=request.scope["path"], error=str(error))
    return error_response(error, request)


WORDS_OF_FULL = ("is full", "no space left", "disk full", "disk i/o error", "could not extend")
BUSY = ("is locked", "is busy", "lock timeout", "statement timeout", "queuepool limit")
"""What SQLite, PostgreSQL and the pool say, in small letters."""


def away(error: Exception, path: str) -> StorageError | InsufficientStorageError:
    """Return what a client is told when the database is busy, full or away; its own words are for the log."""
    words = str(error.orig).strip() if isinstance(error, DBAPIError) else str(error)
    told: StorageError | InsufficientStorageError
    if any(sign in words.lower() for sign in WORDS_OF_FULL):
        told = InsufficientStorageError("the disk of the database is full: nothing can be entered until there is room")
    elif any(sign in words.lower() for sign in BUSY):
        told = StorageError("the database is busy: another process holds it; try again in some seconds")
    else:
        told = StorageError("the database does not answer")
    log.error("a request could not use the database", path=path, told=str(told), error=words, kind=type(error).__name__)
    return told


def _database_down(request: Request, error: Exception) -> Response:
    """Answer that the database is busy, full or away."""
    return error_response(away(error, request.scope["path"]), request)


def _disk_full(request: Request, error: Exception) -> Response:
    """Answer that the disk of the data directory is full; what else the system refuses is unexpected."""
    if cast("OSError", error).errno not in FULL:
        raise error
    log.error("a request found the disk full", path=request.scope["path"], error=str(error))
    return error_response(error, request)


def _bad_parameters(request: Request, error: Exception) -> Response:
    """Answer bad path or query parameters; bodies are validated by the use cases."""
    faults = [
        FieldFault(pointer_to(*fault["loc"]), fault["msg"]) for fault in cast("RequestValidationError", error).errors()
    ]
    detail = "; ".join(f"{fault.pointer}: {fault.detail}" for fault in faults)
    return problem_response(to_problem(InvalidRequestError(detail, faults)), request)


def _http_error(request: Request, error: Exception) -> Response:
    """Answer what the framework refuses: unknown paths, methods that a resource does not have."""
    http = cast("HTTPException", error)
    title = HTTPStatus(http.status_code).phrase
    path = request.scope["path"]
    details = {
        404: f"there is nothing at {path}; GET / lists what there is",
        405: f"{path} does not take {request.method}",
    }
    detail = details.get(http.status_code, str(http.detail))
    problem = {"type": "about:blank", "title": title, "status": http.status_code, "detail": detail}
    return problem_response(problem, request, dict(http.headers or {}))


def _client_left(request: Request, _error: Exception) -> Response:
    """Nobody will read this answer: the connection broke in the middle of an upload."""
    return problem_response(to_problem(InvalidRequestError("the connection broke before the body ended")), request)
