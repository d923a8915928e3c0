"""What request handlers are given: the adapters, the settings, the base of links."""

from dataclasses import dataclass, replace
from typing import Annotated, cast

from fastapi import Depends, Request

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
    Sources,
    StepRunner,
    UploadStore,
)
from service.settings import Settings
from service.use_cases.identifiers import MakeIdentifier, new_identifier


@dataclass(frozen=True)
class Adapters:
    """Everything outside the web process."""

    jobs: JobStore
    files: FileStore
    blobs: BlobStore
    queue: Queue
    steps: StepRunner
    log: JobLog

    def of(self, owner: str) -> "Adapters":
        """Give them to one project: its files and jobs are all there are."""
        return replace(self, jobs=self.jobs.of(owner), files=self.files.of(owner), log=self.log.of(owner))


@dataclass(frozen=True)
class AccessStores:
    """What is kept of clients."""

    keys: KeyStore
    audit: AuditLog
    answers: IdempotencyStore


@dataclass(frozen=True)
class BaseUrl:
    """Beginning of all links of one answer, without a slash at its end."""

    url: str

    def __call__(self, path: str) -> str:
        """Give the full address of a path of this service."""
        return self.url + path


# coroutines, though they wait for nothing: the framework would run functions in a thread each, for every request


async def _adapters(request: Request) -> Adapters:
    """Give the adapters of who asks; a request that did not pass the gate has no `access` and fails here."""
    return cast("Adapters", request.app.state.adapters_of(request.state.access.owner))


async def _whole_service(request: Request) -> Adapters:
    """Give the adapters of all projects: for figures of the service as a whole only."""
    return cast("Adapters", request.app.state.adapters)


async def _uploads(request: Request) -> UploadStore:
    """Give the uploads of who asks."""
    return cast("UploadStore", request.app.state.uploads).of(request.state.access.owner)


async def _access_stores(request: Request) -> AccessStores:
    return cast("AccessStores", request.app.state.access_stores)


async def _identifiers(request: Request) -> MakeIdentifier:
    """Give what makes identifiers: when a request is sent again, the same ones."""
    return cast("MakeIdentifier", getattr(request.state, "identifiers", new_identifier))


async def _sources(request: Request) -> Sources:
    return cast("Sources", request.app.state.sources)


async def _callbacks(request: Request) -> CallbackSender:
    return cast("CallbackSender", request.app.state.callbacks)


async def _settings(request: Request) -> Settings:
    return cast("Settings", request.app.state.settings)


async def _base_url(request: Request) -> BaseUrl:
    public = cast("Settings", request.app.state.settings).public_url
    return BaseUrl((public or str(request.base_url)).rstrip("/"))


AdaptersDependency = Annotated[Adapters, Depends(_adapters)]
WholeServiceDependency = Annotated[Adapters, Depends(_whole_service)]
AccessStoresDependency = Annotated[AccessStores, Depends(_access_stores)]
IdentifiersDependency = Annotated[MakeIdentifier, Depends(_identifiers)]
UploadsDependency = Annotated[UploadStore, Depends(_uploads)]
SourcesDependency = Annotated[Sources, Depends(_sources)]
CallbacksDependency = Annotated[CallbackSender, Depends(_callbacks)]
SettingsDependency = Annotated[Settings, Depends(_settings)]
BaseUrlDependency = Annotated[BaseUrl, Depends(_base_url)]
