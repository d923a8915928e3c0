"""What request handlers are given: the adapters, the settings, the base of links."""

from dataclasses import dataclass, replace
from typing import Annotated, cast
from urllib.parse import urlsplit

from fastapi import Depends, Header, Request

from service.names.identifiers import MakeIdentifier, new_identifier
from service.ports import (
    AuditLog,
    BlobStore,
    CallbackSender,
    FileStore,
    IdempotencyStore,
    JobLog,
    JobStore,
    KeyStore,
    Queue,
    RequestReader,
    SessionStore,
    Sources,
    StepRunner,
    UploadStore,
)
from service.settings import Settings
from service.use_cases.jobs.submit_job import Origin
from service.use_cases.jobs.urgency import urgency_of
from service.use_cases.limits.quotas import Belongings

LONGEST_IDEMPOTENCY_KEY = 255


@dataclass(frozen=True)
class Adapters:
    """Everything outside the web process."""

    jobs: JobStore
    files: FileStore
    blobs: BlobStore
    queue: Queue
    steps: StepRunner
    log: JobLog
    requests: RequestReader | None = None
    """Reads large requests; None: they are read as small ones are."""

    def of(self, owner: str) -> "Adapters":
        """Give them to one project: its files and jobs are all there are."""
        return replace(self, jobs=self.jobs.of(owner), files=self.files.of(owner), log=self.log.of(owner))


@dataclass(frozen=True)
class AccessStores:
    """What is kept of clients."""

    keys: KeyStore
    audit: AuditLog
    answers: IdempotencyStore
    sessions: SessionStore


@dataclass(frozen=True)
class BaseUrl:
    """Beginning of all links of one answer, without a slash at its end."""

    url: str

    def __call__(self, path: str) -> str:
        """Give the full address of a path of this service."""
        return self.url + path


IdempotencyKey = Annotated[
    str | None,
    Header(
        alias="Idempotency-Key",
        max_length=LONGEST_IDEMPOTENCY_KEY,
        description="Any text that is new with each request, such as a UUID. When the answer is lost, the same request "
        "with the same key gets it again, within 24 h, and nothing is made twice.",
    ),
]
Priority = Annotated[
    str | None,
    Header(
        description="How urgent the job is (RFC 9218): `u=0` (before all others) to `u=7`; the usual is `u=3`. Jobs of "
        "the same urgency are begun in the order in which they came."
    ),
]


def adapters_of(request: Request) -> Adapters:
    """Give the adapters of who asks; a request that did not pass the gate has no `access` and fails here."""
    return cast("Adapters", request.app.state.adapters_of(request.state.access.owner))


def base_url_of(request: Request) -> BaseUrl:
    """Give the beginning of all links of the answer to a request."""
    public = cast("Settings", request.app.state.settings).public_url
    return BaseUrl((public or str(request.base_url)).rstrip("/"))


def base_path_of(request: Request) -> str:
    """Give what stands before the paths of all addresses, where a proxy has put the service below a path."""
    return urlsplit(cast("Settings", request.app.state.settings).public_url or "").path.rstrip("/")


# coroutines, though they wait for nothing: the framework would run functions in a thread each, for every request


async def _adapters(request: Request) -> Adapters:
    return adapters_of(request)


async def _whole_service(request: Request) -> Adapters:
    """Give the adapters of all projects: for figures of the service as a whole only."""
    return cast("Adapters", request.app.state.adapters)


async def _uploads(request: Request) -> UploadStore:
    """Give the uploads of who asks."""
    return cast("UploadStore", request.app.state.uploads).of(request.state.access.owner)


async def _belongings(
    request: Request,
    adapters: Annotated[Adapters, Depends(_adapters)],
    uploads: Annotated[UploadStore, Depends(_uploads)],
) -> Belongings:
    """Give what who asks has stored."""
    return _bound(request, adapters, uploads)


def belongings_of(request: Request) -> Belongings:
    """Give what who asks has stored; a request that did not pass the gate fails here."""
    uploads = cast("UploadStore", request.app.state.uploads).of(request.state.access.owner)
    return _bound(request, adapters_of(request), uploads)


def _bound(request: Request, adapters: Adapters, uploads: UploadStore) -> Belongings:
    stores = cast("AccessStores", request.app.state.access_stores)
    owner = request.state.access.owner
    return Belongings(adapters.files, adapters.jobs, uploads, owner, stores.answers, stores.audit)


async def _access_stores(request: Request) -> AccessStores:
    return cast("AccessStores", request.app.state.access_stores)


async def _identifiers(request: Request, _key: IdempotencyKey = None) -> MakeIdentifier:
    """Give what makes identifiers: when a request is sent again, the same ones."""
    return cast("MakeIdentifier", getattr(request.state, "identifiers", new_identifier))


async def _origin(
    request: Request, make_id: Annotated[MakeIdentifier, Depends(_identifiers)], priority: Priority = None
) -> Origin:
    return Origin(make_id, request.state.request_id, urgency_of(priority))


async def _sources(request: Request) -> Sources:
    return cast("Sources", request.app.state.sources)


async def _callbacks(request: Request) -> CallbackSender:
    return cast("CallbackSender", request.app.state.callbacks)


async def _settings(request: Request) -> Settings:
    return cast("Settings", request.app.state.settings)


async def _base_url(request: Request) -> BaseUrl:
    return base_url_of(request)


AdaptersDependency = Annotated[Adapters, Depends(_adapters)]
WholeServiceDependency = Annotated[Adapters, Depends(_whole_service)]
AccessStoresDependency = Annotated[AccessStores, Depends(_access_stores)]
IdentifiersDependency = Annotated[MakeIdentifier, Depends(_identifiers)]
OriginDependency = Annotated[Origin, Depends(_origin)]
BelongingsDependency = Annotated[Belongings, Depends(_belongings)]
UploadsDependency = Annotated[UploadStore, Depends(_uploads)]
SourcesDependency = Annotated[Sources, Depends(_sources)]
CallbacksDependency = Annotated[CallbackSender, Depends(_callbacks)]
SettingsDependency = Annotated[Settings, Depends(_settings)]
BaseUrlDependency = Annotated[BaseUrl, Depends(_base_url)]
