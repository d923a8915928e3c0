"""The composition root of the web process."""

import asyncio
import random
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import asdict
from datetime import UTC, datetime
from functools import lru_cache, partial
from importlib.metadata import version
from typing import Any

import anyio.to_thread
import structlog
from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from sqlalchemy.exc import SQLAlchemyError
from starlette.staticfiles import StaticFiles

from service.adapters.database.audit import DatabaseAuditLog
from service.adapters.database.executors import DatabaseExecutors
from service.adapters.database.files import DatabaseFileStore
from service.adapters.database.idempotency import DatabaseIdempotencyStore
from service.adapters.database.job_log import DatabaseJobLog
from service.adapters.database.jobs import DatabaseJobStore, give_space_back
from service.adapters.database.keys import DatabaseKeyStore
from service.adapters.database.queue import DatabaseQueue
from service.adapters.database.sessions import DatabaseSessionStore
from service.adapters.database.steps import DatabaseSteps
from service.adapters.database.tables import FRESH_S, connect, reserve_connections
from service.adapters.files.object_files import blob_store
from service.adapters.outgoing.http_callbacks import HttpCallbacks
from service.adapters.outgoing.remote_sources import RemoteSources
from service.adapters.processes.child_process import ChildProcesses
from service.adapters.processes.confinement import available
from service.adapters.processes.nursery_client import WarmUp
from service.adapters.uploads.local_uploads import LocalUploads
from service.adapters.uploads.shared_uploads import upload_store_of
from service.dependencies import AccessStores, Adapters
from service.errors import ServiceError
from service.ports import UploadStore
from service.processes import PROCESSES
from service.routes import (
    audit,
    files,
    health,
    job_events,
    jobs,
    keys,
    landing,
    metrics,
    openapi_30,
    pages,
    processes,
    registrations,
    result_lists,
    scenes,
    uploads,
)
from service.routes.access_description import describe_access
from service.routes.answer_headers import AnswerHeaders
from service.routes.correlation import RequestIds
from service.routes.described_once import DescribedOnce
from service.routes.described_processes import process_components
from service.routes.gate import Doorway, Gate
from service.routes.problems import PROBLEM_SCHEMA, install_error_handlers
from service.routes.repeated_requests import RepeatedRequests
from service.settings import Settings
from service.use_cases.access.browser_sessions import BrowserSessions
from service.use_cases.access.check_access import Gatekeeper
from service.use_cases.limits.check_readiness import ReadinessWatch, check_readiness
from service.use_cases.limits.quotas import Belongings
from service.use_cases.uploads.clean_up import Cleaner
from service.use_cases.uploads.forget_old import forget_old
from service.use_cases.uploads.receive_uploads import UploadDesk
from service.use_cases.uploads.upload_threads import step_back
from service.web.page_rendering import STATIC

THREADS = 16
"""In which requests are answered. More would not answer more, only wait for each other and keep memory."""
log = structlog.get_logger()


def app_from_environment() -> FastAPI:
    """Build the web application that `tieline serve` runs; the database must have been prepared."""
    settings = Settings()
    database = connect(settings, reserve=True, fresh_s=FRESH_S)
    step_back(settings.niceness)
    readers = ChildProcesses(settings, blob_store, warm_up=WarmUp("service.use_cases.steps.warm_up:load_for_reading"))
    blobs = blob_store(settings)
    upload_store = upload_store_of(settings, database, blobs)
    adapters = Adapters(
        jobs=DatabaseJobStore(database),
        files=DatabaseFileStore(database),
        blobs=blobs,
        queue=DatabaseQueue(DatabaseExecutors(database), DatabaseSteps(database)),
        steps=readers,
        log=DatabaseJobLog(database),
        requests=readers,
    )

    access = AccessStores(
        keys=DatabaseKeyStore(database),
        audit=DatabaseAuditLog(database),
        answers=DatabaseIdempotencyStore(database),
        sessions=DatabaseSessionStore(database),
    )

    @asynccontextmanager
    async def closing(_app: FastAPI) -> AsyncIterator[None]:
        log.info("computations are confined", by=_confinement(settings))
        anyio.to_thread.current_default_thread_limiter().total_tokens = THREADS
        try:
            await asyncio.to_thread(reserve_connections, database)
        except SQLAlchemyError as error:
            log.warning("the database has no connections to keep in reserve for requests", error=str(error))
        belongings = Belongings(adapters.files, adapters.jobs, upload_store)
        desk = UploadDesk(upload_store, files.file_intake(belongings, adapters, settings))
        cleaning = asyncio.create_task(
            _clean_up_regularly(Cleaner(desk, adapters.jobs), access, settings, partial(give_space_back, database))
        )
        yield
        cleaning.cancel()
        readers.close()
        database.dispose()

    return create_app(settings, adapters, access, closing, upload_store)


async def _clean_up_regularly(
    cleaner: Cleaner, access: AccessStores, settings: Settings, give_space_back: Callable[[], None]
) -> None:
    """Clean up from time to time, each process at its own; what fails is tried again the next time."""
    while True:
        await asyncio.sleep(settings.clean_up_interval_s * random.uniform(0.5, 1.0))  # noqa: S311 - no secret
        try:
            now = datetime.now(UTC)
            done = await cleaner.clean_up(now)
            days = settings.audit_days, now, settings.audit_refused_days
            forgotten = await asyncio.to_thread(forget_old, access.audit, access.answers, access.sessions, *days)
            await asyncio.to_thread(give_space_back)
        except (ServiceError, SQLAlchemyError, OSError) as error:
            log.warning("cleaning up failed", error=str(error))
            continue
        if not (done.nothing and forgotten.nothing):
            log.info("cleaned up", **asdict(done), **asdict(forgotten))


def create_app(
    settings: Settings,
    adapters: Adapters,
    access: AccessStores,
    lifespan: Callable[[FastAPI], AbstractAsyncContextManager[None]] | None = None,
    upload_store: UploadStore | None = None,
) -> FastAPI:
    """Build the web application.

    Parameters
    ----------
    settings, adapters
        What it works with.
    access
        What is kept of clients.
    lifespan
        Surrounds its run.
    upload_store
        Resumable uploads; None: in the data directory.
    """
    app = FastAPI(
        title=landing.TITLE,
        description=landing.DESCRIPTION,
        version=version("tieline"),
        lifespan=lifespan,
        docs_url=None,  # the framework's pages load their viewers from other hosts
        redoc_url=None,
        generate_unique_id_function=lambda route: route.name,
    )
    app.state.settings = settings
    app.state.adapters = adapters
    app.state.adapters_of = lru_cache(maxsize=1000)(adapters.of)
    app.state.access_stores = access
    app.state.readiness = ReadinessWatch(
        partial(check_readiness, adapters.jobs, adapters.blobs, adapters.queue, _confinement(settings)),
        look_again_s=1.0,
    )
    app.state.uploads = upload_store or LocalUploads(settings.data_dir / "uploads")
    app.state.sources = RemoteSources(settings)
    app.state.callbacks = HttpCallbacks(settings)
    app.state.sessions = BrowserSessions(access.sessions)
    app.router.routes.extend(pages.ROUTES)  # before those that answer programs at the same addresses
    routers = [jobs.status_router]
    routers += [
        resource.router
        for resource in (
            landing,
            openapi_30,
            processes,
            jobs,
            job_events,
            result_lists,
            scenes,
            files,
            uploads,
            registrations,
            keys,
            audit,
            health,
            metrics,
        )
    ]
    routes = list(app.router.routes)
    for router in routers:
        app.include_router(router)
        routes += router.routes
    app.mount("/static", StaticFiles(directory=STATIC))
    routes.append(app.router.routes[-1])
    install_error_handlers(app)
    app.state.gatekeeper = Gatekeeper(access.keys, settings)
    app.add_middleware(DescribedOnce)
    app.add_middleware(RepeatedRequests, answers=access.answers)
    app.add_middleware(Gate, doorway=Doorway(app.state.gatekeeper, access.audit, settings))
    metrics.count_requests(app, routes)
    app.add_middleware(AnswerHeaders)
    app.add_middleware(RequestIds)
    app.openapi = lambda: _openapi(app)  # type: ignore[method-assign]
    return app


def _confinement(settings: Settings) -> str:
    """Say how computations are confined."""
    return available().text if settings.confine_children else "off: TIELINE_CONFINE_CHILDREN=false"


def _openapi(app: FastAPI) -> dict[str, Any]:
    """Describe the interface; bodies that are validated per process are added to what the framework knows."""
    if app.openapi_schema is None:
        document = get_openapi(title=app.title, version=app.version, description=app.description, routes=app.routes)
        components = document.setdefault("components", {}).setdefault("schemas", {})
        definitions = PROBLEM_SCHEMA.get("$defs", {})
        components.update(definitions)
        components["ProblemDocument"] = {key: value for key, value in PROBLEM_SCHEMA.items() if key != "$defs"}
        # what both know by one name is the same, which a test holds them to
        components.update(process_components(PROCESSES))
        components["FilesForm"] = files.FILES_FORM
        _drop_422(document)
        describe_access(document)
        app.openapi_schema = document
    return app.openapi_schema


def _drop_422(document: dict[str, Any]) -> None:
    """Remove the framework's own validation answer: bad input is always 400 here."""
    for path in document["paths"].values():
        for operation in path.values():
            operation["responses"].pop("422", None)
    for name in ("HTTPValidationError", "ValidationError"):
        document["components"]["schemas"].pop(name, None)
