"""The web application over memory adapters, driven by HTTP without a network."""

import asyncio
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import httpx
import pytest

from service.dependencies import Adapters
from service.errors import ComputationFailedError, UnreadableFileError
from service.settings import Settings
from tests.doubles.application import create_app
from tests.doubles.memory import MemoryBlobStore, MemoryFileStore, MemoryJobLog, MemoryJobStore, MemoryQueue

SCAN = {
    "index": 0,
    "name": "first",
    "points": 12,
    "dropped": 0,
    "structured": False,
    "rows": None,
    "columns": None,
    "bounds_m": [[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]],
    "has_intensity": True,
    "has_color": False,
    "scan_pose": None,
}


PHOTO = {
    "index": 0,
    "name": "north",
    "width": 640,
    "height": 480,
    "camera": None,
    "scan_from_camera": None,
    "scan": None,
    "refused": None,
    "remarks": [],
}

CAMERA = {"model": "brown", "width": 640, "height": 480, "fx": 500.0, "fy": 500.0, "cx": 320.0, "cy": 240.0}
POSE = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
POSED = {**PHOTO, "camera": CAMERA, "scan_from_camera": POSE}
"""A photo whose file has its camera and its pose."""


class FakeSteps:
    """Take every upload for a scan or a photo, as its content says, unless that says that it is broken."""

    def __init__(self, blobs: MemoryBlobStore) -> None:
        self.calls: list[dict[str, Any]] = []
        self._blobs = blobs

    async def run(
        self,
        step: str,
        arguments: dict[str, Any],
        *,
        timeout_s: float,  # noqa: ARG002 - the port's signature
        on_progress: Callable[[float, str], None] | None = None,  # noqa: ARG002
    ) -> dict[str, Any]:
        self.calls.append({"step": step, **arguments})
        content = self._blobs.local_path(arguments["key"]).read_bytes()
        if content.startswith(b"broken"):
            raise UnreadableFileError(arguments["filename"], "no scan format begins like this", "byte 0")
        if content.startswith(b"deadly"):
            raise ComputationFailedError("killed by signal 11")
        photos = [{**PHOTO, "index": index} for index in range(content.count(b"photo"))]
        count = content.count(b"scan") or int(not photos)
        posed = range(content.count(b"posed"))
        photos += [{**POSED, "index": len(photos) + index, "scan": index % max(1, count)} for index in posed]
        scans = [{**SCAN, "index": index} for index in range(count)]
        return {"format": "XYZ", "kind": "scan" if scans else "photo", "scans": scans, "photos": photos}


class Client:
    """Send one request at a time, as a browser or `curl` would."""

    def __init__(self, app: Any) -> None:
        self._app = app

    def request(self, method: str, path: str, **what: Any) -> httpx.Response:
        async def send() -> httpx.Response:
            transport = httpx.ASGITransport(self._app, raise_app_exceptions=False)
            async with httpx.AsyncClient(transport=transport, base_url="http://tieline.test") as client:
                return await client.request(method, path, **what)

        return asyncio.run(send())

    def get(self, path: str, **what: Any) -> httpx.Response:
        return self.request("GET", path, **what)

    def post(self, path: str, **what: Any) -> httpx.Response:
        return self.request("POST", path, **what)

    def delete(self, path: str, **what: Any) -> httpx.Response:
        return self.request("DELETE", path, **what)

    def upload(self, name: str = "a.xyz", content: bytes | None = None) -> str:
        """Upload a file, with a content of its own unless it is given, and give its id."""
        answer = self.post("/files", files={"file": (name, name.encode() if content is None else content)})
        assert answer.status_code == 201, answer.text
        return str(answer.json()["id"])

    def submit(self, inputs: dict[str, Any], process: str = "register") -> httpx.Response:
        return self.post(f"/processes/{process}/execution", json={"inputs": inputs})

    def register_two(self) -> str:
        """Start a registration of two uploads and give the job's id."""
        stations = [{"name": name, "scan": {"file": self.upload(f"{name}.xyz")}} for name in ("A", "B")]
        answer = self.submit({"stations": stations})
        assert answer.status_code == 201, answer.text
        return str(answer.json()["jobID"])


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return Settings(data_dir=tmp_path, max_file_bytes=1_000_000, min_free_bytes=0, max_stations=4, max_queued_jobs=20)


def memory_adapters() -> Adapters:
    blobs = MemoryBlobStore()
    return Adapters(MemoryJobStore(), MemoryFileStore(), blobs, MemoryQueue(), FakeSteps(blobs), MemoryJobLog())


@pytest.fixture
def adapters() -> Adapters:
    return memory_adapters()


@pytest.fixture
def client(settings: Settings, adapters: Adapters) -> Client:
    return Client(create_app(settings, adapters))


@pytest.fixture(scope="session")
def description(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Give the OpenAPI document, which takes half a second to write."""
    settings = Settings(data_dir=tmp_path_factory.mktemp("described"))
    return dict(Client(create_app(settings, memory_adapters())).get("/openapi.json").json())


@pytest.fixture
def pointers() -> Callable[[httpx.Response], list[str]]:
    """Give the pointers of a refused request, having checked that it was refused as promised."""

    def read(answer: httpx.Response) -> list[str]:
        assert answer.status_code == 400, answer.text
        assert answer.headers["content-type"] == "application/problem+json"
        return sorted(fault["pointer"] for fault in answer.json()["errors"])

    return read


async def chunks_of(*pieces: bytes) -> AsyncIterator[bytes]:
    for piece in pieces:
        yield piece
