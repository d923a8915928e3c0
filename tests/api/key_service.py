"""A service over memory adapters that wants keys, and clients that have them."""

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

import httpx

from service.dependencies import Adapters
from service.settings import Settings
from service.use_cases.access.manage_keys import create_key
from tests.api.conftest import Client
from tests.doubles.application import create_app
from tests.doubles.memory_access import memory_access

NOW = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)


class KeyedClient(Client):
    """Send a key with every request."""

    def __init__(self, app: Any, secret: str) -> None:
        super().__init__(app)
        self.secret = secret

    def request(self, method: str, path: str, **what: Any) -> httpx.Response:
        headers = {"Authorization": f"Bearer {self.secret}", **what.pop("headers", {})}
        return super().request(method, path, headers=headers, **what)


class KeyService:
    """A service with its stores at hand."""

    def __init__(self, settings: Settings, adapters: Adapters) -> None:
        self.settings = settings
        self.adapters = adapters
        self.stores = memory_access()
        self.app = create_app(settings, adapters, access=self.stores)

    def secret(self, name: str, project: str | None = None, scopes: Sequence[str] = ("read", "write")) -> str:
        return create_key(name, project, scopes, None, self.stores.keys, NOW)[1]

    def client(self, name: str, project: str | None = None, scopes: Sequence[str] = ("read", "write")) -> KeyedClient:
        return KeyedClient(self.app, self.secret(name, project, scopes))

    def stranger(self) -> Client:
        return Client(self.app)
