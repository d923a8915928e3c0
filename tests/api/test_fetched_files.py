"""Scans and photos given by their address: checked against what is allowed, and left to the job to fetch."""

from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from pathlib import Path
from typing import Any

import httpx
import pytest

from service.dependencies import Adapters
from service.errors import AddressRefusedError
from service.ports import Job, RemoteFile
from service.settings import Settings
from tests.api.conftest import CAMERA, POSE, Client
from tests.doubles.application import create_app

Pointers = Callable[[httpx.Response], list[str]]
A, B, PHOTO = ({"href": f"https://x.org/{name}"} for name in ("a.e57", "b.e57", "p.jpg"))


class Elsewhere:
    """Allow one server, and reach none."""

    def check(self, href: str) -> None:
        if not href.startswith("https://x.org/"):
            raise AddressRefusedError(href, "not allowed")

    def opened(self, href: str) -> AbstractAsyncContextManager[RemoteFile]:
        raise AssertionError(f"{href} is fetched while the client waits")


@pytest.fixture
def client(settings: Settings, adapters: Adapters) -> Client:
    app = create_app(settings, adapters)
    app.state.sources = Elsewhere()
    return Client(app)


def stations(*scans: dict[str, Any]) -> dict[str, Any]:
    return {"stations": [{"name": f"S{k}", "scan": scan} for k, scan in enumerate(scans)]}


def made(adapters: Adapters, answer: httpx.Response) -> Job:
    assert answer.status_code == 201, answer.text
    job = adapters.jobs.get(answer.json()["jobID"])
    assert job is not None
    return job


def test_the_job_is_told_what_to_fetch_each_address_once(client: Client, adapters: Adapters) -> None:
    job = made(adapters, client.submit(stations(A, {**A, "index": 1}, B)))
    first, second = job.fetches
    assert (first["href"], second["href"]) == (A["href"], B["href"])
    assert first["pointers"] == ["/inputs/stations/0/scan", "/inputs/stations/1/scan"]
    assert (first["label"], second["label"]) == ("S0", "S2")
    assert job.file_ids == (first["id"], second["id"])
    assert [station["scan"] for station in job.inputs["stations"]] == [
        *({"file": first["id"], "index": 0}, {"file": first["id"], "index": 1}),
        {"file": second["id"], "index": 0},
    ]


def test_photos_are_fetched_too(client: Client, adapters: Adapters) -> None:
    photo = {**PHOTO, "camera": CAMERA, "scan_from_camera": POSE}
    asked = stations({"file": client.upload()}, A)
    asked["stations"][0]["photos"] = [photo, {**photo, "href": "https://x.org/q.jpg"}]
    job = made(adapters, client.submit(asked))
    assert [fetch["pointers"] for fetch in job.fetches] == [
        *(["/inputs/stations/0/photos/0"], ["/inputs/stations/0/photos/1"]),
        ["/inputs/stations/1/scan"],
    ]
    assert job.fetches[1]["label"] == "photo 2 of S0"


def test_other_processes_fetch_too(client: Client, adapters: Adapters) -> None:
    lines = made(adapters, client.submit({"station": {"name": "S", "scan": A}}, "extract-lines"))
    edges = made(adapters, client.submit({"photo": PHOTO}, "detect-edges"))
    assert lines.fetches[0]["pointers"] == ["/inputs/station/scan"]
    assert edges.fetches[0]["pointers"] == ["/inputs/photo"]


def test_a_file_to_come_cannot_be_removed(client: Client, adapters: Adapters) -> None:
    job = made(adapters, client.submit(stations(A, B)))
    assert adapters.jobs.unfinished_using(job.fetches[0]["id"]) == job


def test_every_address_that_is_not_allowed_is_pointed_at(client: Client, pointers: Pointers) -> None:
    answer = client.submit(stations({"href": "https://y.org/a.e57"}, {"href": "ftp://x"}, A))
    assert pointers(answer) == ["/inputs/stations/0/scan/href", "/inputs/stations/1/scan/href"]


def test_what_is_wrong_elsewhere_is_pointed_at(client: Client, pointers: Pointers) -> None:
    assert pointers(client.submit({**stations(A, B), "fix": "x"})) == ["/inputs/fix"]
    assert pointers(client.submit(stations(A, {"file": "none"}))) == ["/inputs/stations/1/scan/file"]
    same = {"stations": [{"name": "S", "scan": A}, {"name": "S", "scan": B}]}
    assert pointers(client.submit(same)) == ["/inputs/stations/1/name"]


def test_the_pose_of_a_photo_to_come_is_checked_as_far_as_it_can_be(client: Client, pointers: Pointers) -> None:
    asked = stations(A, B)
    asked["stations"][0]["photos"] = [{**PHOTO, "camera": CAMERA, "mount": POSE}]
    assert pointers(client.submit(asked)) == ["/inputs/stations/0/photos/0/cop"]


@pytest.mark.parametrize("scan", [{"file": "f", **A}, {"href": 7}, {"href": None}, {}])
def test_what_is_no_reference_is_refused(client: Client, pointers: Pointers, scan: dict[str, Any]) -> None:
    assert pointers(client.submit(stations(scan, B)))[0].startswith("/inputs/stations/0/scan/")


def test_nothing_is_kept_of_a_refused_request(client: Client, adapters: Adapters, pointers: Pointers) -> None:
    pointers(client.submit(stations(A, {"href": "https://y.org/a.e57"})))
    assert adapters.blobs.keys("") == []
    assert client.get("/jobs").json()["numberMatched"] == 0


def test_by_default_nothing_is_fetched(tmp_path: Path, adapters: Adapters, pointers: Pointers) -> None:
    client = Client(create_app(Settings(data_dir=tmp_path, min_free_bytes=0), adapters))
    href = "https://169.254.169.254/latest/meta-data/a.e57"
    answer = client.submit(stations({"href": href}, {"href": href}))
    assert pointers(answer) == [f"/inputs/stations/{k}/scan/href" for k in range(2)]
    assert "TIELINE_ALLOWED_SOURCES" in answer.json()["errors"][0]["detail"]


@pytest.mark.parametrize("process", ["register", "extract-lines", "detect-edges"])
def test_the_description_of_a_process_knows_addresses(client: Client, process: str) -> None:
    assert '"title":"Href"' in client.get(f"/processes/{process}").text
