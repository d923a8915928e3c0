"""What request handlers are given: the adapters, the settings, the base of links."""

from dataclasses import dataclass
from typing import Annotated, cast

from fastapi import Depends, Request

from service.ports import (
    BlobStore,
    CallbackSender,
    FileStore,
    JobLog,
    JobStore,
    Queue,
    Sources,
    StepRunner,
    UploadStore,
)
from service.settings import Settings


@dataclass(frozen=True)
class Adapters:
    """Everything outside the web process."""

    jobs: JobStore
    files: FileStore
    blobs: BlobStore
    queue: Queue
    steps: StepRunner
    log: JobLog


@dataclass(frozen=True)
class BaseUrl:
    """Beginning of all links of one answer, without a slash at its end."""

    url: str

    def __call__(self, path: str) -> str:
        """Give the full address of a path of this service."""
        return self.url + path


# coroutines, though they wait for nothing: the framework would run functions in a thread each, for every request


async def _adapters(request: Request) -> Adapters:
    return cast("Adapters", request.app.state.adapters)


async def _uploads(request: Request) -> UploadStore:
    return cast("UploadStore", request.app.state.uploads)


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
UploadsDependency = Annotated[UploadStore, Depends(_uploads)]
SourcesDependency = Annotated[Sources, Depends(_sources)]
CallbacksDependency = Annotated[CallbackSender, Depends(_callbacks)]
SettingsDependency = Annotated[Settings, Depends(_settings)]
BaseUrlDependency = Annotated[BaseUrl, Depends(_base_url)]
