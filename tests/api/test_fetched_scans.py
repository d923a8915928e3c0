"""Scans given by their address: fetched before the job is made, or refused with a pointer."""

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from fastapi import FastAPI

from service.dependencies import Adapters
from service.errors import AddressRefusedError
from service.main import create_app
from service.ports import RemoteFile
from service.settings import Settings
from tests.api.conftest import Client, chunks_of

Pointers = Callable[[httpx.Response], list[str]]


class Elsewhere:
    """Serve a few files; the others are not there."""

    def __init__(self) -> None:
        self.contents = {
            "https://x.org/a.e57": b"scan scan",
            "https://x.org/b.e57": b"scan",
            "https://x.org/c": b"broken",
        }
        self.asked: list[str] = []

    def check(self, href: str) -> None:
        if not href.startswith("https://x.org/"):
            raise AddressRefusedError(href, "not allowed")

    @asynccontextmanager
    async def opened(self, href: str) -> AsyncIterator[RemoteFile]:
        self.asked.append(href)
        if href not in self.contents:
            raise AddressRefusedError(href, "its server answered 404")
        yield RemoteFile(href.rpartition("/")[2], chunks_of(self.contents[href]), len(self.contents[href]))


@pytest.fixture
def elsewhere() -> Elsewhere:
    return Elsewhere()


@pytest.fixture
def client(settings: Settings, adapters: Adapters, elsewhere: Elsewhere) -> Client:
    app: FastAPI = create_app(settings, adapters)
    app.state.sources = elsewhere
    return Client(app)


def stations(*scans: dict[str, Any]) -> dict[str, Any]:
    return {"stations": [{"name": f"S{k}", "scan": scan} for k, scan in enumerate(scans)]}


def test_scans_are_fetched_each_address_once(client: Client, elsewhere: Elsewhere, adapters: Adapters) -> None:
    first = {"href": "https://x.org/a.e57"}
    answer = client.submit(stations(first, {**first, "index": 1}, {"href": "https://x.org/b.e57"}))
    assert answer.status_code == 201, answer.text
    assert elsewhere.asked == ["https://x.org/a.e57", "https://x.org/b.e57"]
    job = adapters.jobs.get(answer.json()["jobID"])
    assert job is not None
    files = {file["name"]: file["id"] for file in client.get("/files").json()["files"]}
    assert job.file_ids == (files["a.e57"], files["b.e57"])


def test_what_cannot_be_fetched_is_pointed_at_and_nothing_is_kept(
    client: Client, adapters: Adapters, pointers: Pointers
) -> None:
    answer = client.submit(stations({"href": "https://x.org/a.e57"}, {"href": "https://x.org/none.e57"}))
    assert pointers(answer) == ["/inputs/stations/1/scan/href"]
    assert "404" in answer.json()["errors"][0]["detail"]
    assert adapters.blobs.keys("") == []
    assert client.get("/files").json()["numberMatched"] == 0


def test_what_is_no_scan_is_pointed_at(client: Client, adapters: Adapters, pointers: Pointers) -> None:
    answer = client.submit(stations({"href": "https://x.org/c"}, {"href": "https://x.org/b.e57"}))
    assert pointers(answer) == ["/inputs/stations/0/scan/href"]
    assert adapters.blobs.keys("") == []


def test_nothing_is_fetched_for_a_request_that_is_wrong_elsewhere(
    client: Client, elsewhere: Elsewhere, pointers: Pointers
) -> None:
    answer = client.submit({**stations({"href": "https://x.org/a.e57"}, {"href": "https://x.org/b.e57"}), "fix": "x"})
    assert pointers(answer) == ["/inputs/fix"]
    assert elsewhere.asked == []


def test_every_address_that_is_not_allowed_is_pointed_at(
    client: Client, elsewhere: Elsewhere, pointers: Pointers
) -> None:
    answer = client.submit(
        stations({"href": "https://y.org/a.e57"}, {"href": "ftp://x"}, {"href": "https://x.org/a.e57"})
    )
    assert pointers(answer) == ["/inputs/stations/0/scan/href", "/inputs/stations/1/scan/href"]
    assert elsewhere.asked == []


def test_a_number_that_the_fetched_file_does_not_have_leaves_nothing(
    client: Client, adapters: Adapters, pointers: Pointers
) -> None:
    answer = client.submit(stations({"href": "https://x.org/a.e57"}, {"href": "https://x.org/b.e57", "index": 7}))
    assert pointers(answer) == ["/inputs/stations/1/scan/index"]
    assert adapters.blobs.keys("") == []


def test_a_fetched_file_beyond_the_limit_is_refused(client: Client, elsewhere: Elsewhere, adapters: Adapters) -> None:
    elsewhere.contents["https://x.org/big.e57"] = b"scan" * 300_000
    answer = client.submit(stations({"href": "https://x.org/a.e57"}, {"href": "https://x.org/big.e57"}))
    assert answer.status_code == 413
    assert adapters.blobs.keys("") == []


def test_file_and_address_at_once_are_refused(client: Client, elsewhere: Elsewhere, pointers: Pointers) -> None:
    both = {"file": "f", "href": "https://x.org/a.e57"}
    assert "/inputs/stations/0/scan/href" in pointers(client.submit(stations(both, both)))
    assert elsewhere.asked == []


def test_by_default_nothing_is_fetched(tmp_path: Path, adapters: Adapters, pointers: Pointers) -> None:
    client = Client(create_app(Settings(data_dir=tmp_path, min_free_bytes=0), adapters))
    href = "https://169.254.169.254/latest/meta-data/a.e57"
    answer = client.submit(stations({"href": href}, {"href": href}))
    assert pointers(answer) == [f"/inputs/stations/{k}/scan/href" for k in range(2)]
    assert "TIELINE_ALLOWED_SOURCES" in answer.json()["errors"][0]["detail"]


def test_the_description_of_the_process_knows_addresses(client: Client) -> None:
    text = client.get("/processes/register").text
    assert '"href"' in text
