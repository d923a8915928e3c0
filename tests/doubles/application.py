"""The web application as tests start it: what is kept of clients is in memory unless they say otherwise."""

from collections.abc import Callable
from contextlib import AbstractAsyncContextManager

from fastapi import FastAPI

import service.main
from service.dependencies import AccessStores, Adapters
from service.ports import UploadStore
from service.settings import Settings
from tests.doubles.memory_access import memory_access


def create_app(
    settings: Settings,
    adapters: Adapters,
    lifespan: Callable[[FastAPI], AbstractAsyncContextManager[None]] | None = None,
    access: AccessStores | None = None,
    upload_store: UploadStore | None = None,
) -> FastAPI:
    """Build the application."""
    stores = access or memory_access()
    return service.main.create_app(settings, adapters, stores, lifespan, upload_store)
