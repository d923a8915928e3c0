"""A service whose stores are those of production, with two projects that know nothing of each other."""

import asyncio
import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import httpx
from fastapi import FastAPI

from service.adapters.database.audit import DatabaseAuditLog
from service.adapters.database.files import DatabaseFileStore
from service.adapters.database.idempotency import DatabaseIdempotencyStore
from service.adapters.database.job_log import DatabaseJobLog
from service.adapters.database.jobs import DatabaseJobStore, migrate
from service.adapters.database.keys import DatabaseKeyStore
from service.adapters.database.sessions import DatabaseSessionStore
from service.adapters.database.tables import connect
from service.dependencies import AccessStores, Adapters
from service.names.scene_keys import scene_key
from service.ports import LogLine
from service.settings import Settings
from service.use_cases.access.manage_keys import create_key
from tests.api.conftest import FakeSteps
from tests.api.key_service import KeyedClient
from tests.doubles.application import create_app
from tests.doubles.memory import MemoryBlobStore, MemoryQueue

NOW = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
TUS = {"Tus-Resumable": "1.0.0", "Upload-Offset": "0", "Content-Type": "application/offset+octet-stream"}
FILE_OF_ALICE = "bridge-of-alice.xyz"
CONTENT_OF_ALICE = b"1 2 3 of alice\n"
LINE_OF_ALICE = "features of the bridge of alice"
REPEATED = "the-key-of-alice"
STATION_OF_ALICE: dict[str, Any] = {
    "name": "of alice", "status": "fixed", "world_from_scan": None, "covariance": None, "noise_std_m": 0.002,
    "points": 1, "sensor_m": None, "bounds_m": [[0, 0, 0], [1, 1, 1]], "lines": [], "planes": [], "cylinders": [],
}  # fmt: skip
SCENE_OF_ALICE = {
    "stations": [STATION_OF_ALICE], "stages": [], "pairs": [],
    "points": [["features/a/points", "features/a/points.json"]],
}  # fmt: skip


class TwoProjects:
    """Alice has something of everything; Mallory has a key of another project."""

    def __init__(self, app: FastAPI, adapters: Adapters, stores: AccessStores) -> None:
        self.app = app
        self.adapters = adapters
        self.keys = stores.keys
        self.alice = self._client("alice")
        self.mallory = self._client("mallory")
        self.file = self.alice.upload(FILE_OF_ALICE, CONTENT_OF_ALICE)
        self.finished = self._finished_job()
        self.waiting = self.alice.register_two()
        self.upload = self._pending_upload()
        self.key = next(key.id for key in self.keys.find(10, 0)[0] if key.name == "alice")

    def _client(self, name: str) -> KeyedClient:
        _, secret = create_key(name, None, ["read", "write"], None, self.keys, NOW)
        return KeyedClient(self.app, secret)

    def _finished_job(self) -> str:
        answer = self.alice.post(
            "/processes/echo/execution",
            json={"inputs": {"stringInput": "of alice"}},
            headers={"Prefer": "respond-async", "Idempotency-Key": REPEATED},
        )
        job_id = str(answer.json()["jobID"])
        self.adapters.jobs.start(job_id, NOW)
        self.adapters.jobs.succeed(job_id, NOW)
        self.adapters.log.write(job_id, [LogLine(NOW, "info", LINE_OF_ALICE)])
        self.adapters.blobs.write_bytes(
            f"jobs/{job_id}/result.json", b'{"stringInput": "of alice", "pairs": ["of alice"]}'
        )
        self.adapters.blobs.write_bytes(f"jobs/{job_id}/artifacts/report.html", b"<p>of alice</p>")
        self.adapters.blobs.write_bytes(scene_key(job_id), json.dumps(SCENE_OF_ALICE).encode())
        self.adapters.blobs.write_bytes("features/a/points", b"points of alice")
        self.adapters.blobs.write_bytes("features/a/points.json", b"{}")
        return job_id

    def _pending_upload(self) -> str:
        headers = {**TUS, "Upload-Length": "9", "Upload-Metadata": "filename YWxpY2UueHl6"}
        return self.alice.post("/uploads", headers=headers, content=b"1 2").headers["location"].rsplit("/", 1)[1]

    @property
    def identifiers(self) -> list[str]:
        """All by which something of Alice could be told or asked for."""
        return [self.file, self.finished, self.waiting, self.upload, self.key]

    def belongings(self) -> dict[str, Any]:
        """Describe all that Alice has, as she sees it; when her key was used last changes with her looking."""
        key = self.keys.get(self.key)
        upload = self.alice.request("HEAD", f"/uploads/{self.upload}", headers=TUS).headers["upload-offset"]
        return {
            "files": self.alice.get("/files").json(),
            "content": self.alice.get(f"/files/{self.file}/content").content,
            "jobs": self.alice.get("/jobs").json(),
            "result": self.alice.get(f"/jobs/{self.finished}/results").content,
            "upload": upload,
            "key": key and replace(key, key=replace(key.key, last_used=None)),
        }


@contextmanager
def two_projects(directory: Path) -> Iterator[TwoProjects]:
    settings = Settings(data_dir=directory, min_free_bytes=0, max_key_checks_per_minute=1000)
    migrate(settings)
    database = connect(settings)
    blobs = MemoryBlobStore()
    adapters = Adapters(
        DatabaseJobStore(database),
        DatabaseFileStore(database),
        blobs,
        MemoryQueue(),
        FakeSteps(blobs),
        DatabaseJobLog(database),
    )
    stores = AccessStores(
        DatabaseKeyStore(database),
        DatabaseAuditLog(database),
        DatabaseIdempotencyStore(database),
        DatabaseSessionStore(database),
    )
    yield TwoProjects(create_app(settings, adapters, access=stores), adapters, stores)
    database.dispose()


def stripped(answer: httpx.Response, identifier: str) -> tuple[int, str, dict[str, str]]:
    """Give all that an answer tells, besides the identifier that was asked for."""
    told = {name: value for name, value in answer.headers.items() if name not in {"x-request-id", "content-length"}}
    return (
        answer.status_code,
        answer.text.replace(identifier, "…"),
        {name: value.replace(identifier, "…") for name, value in told.items()},
    )


def all_at_once(client: KeyedClient, app: Any, paths: list[str]) -> list[httpx.Response]:
    """Ask for several things at the same time."""

    async def ask() -> list[httpx.Response]:
        headers = {"Authorization": f"Bearer {client.secret}"}
        transport = httpx.ASGITransport(app)
        async with httpx.AsyncClient(transport=transport, base_url="http://tieline.test", headers=headers) as web:
            return list(await asyncio.gather(*(web.get(path) for path in paths)))

    return asyncio.run(ask())
