"""Files over HTTP: uploads are taken whole or not at all."""

import asyncio
import hashlib
import shutil
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import httpx
import pytest

from service.dependencies import Adapters
from service.settings import Settings
from tests.api.conftest import Client
from tests.doubles.application import create_app

RAW = {"Content-Type": "application/octet-stream"}


@pytest.fixture
def nothing_stored(client: Client, adapters: Adapters) -> Callable[[], bool]:
    def check() -> bool:
        return not adapters.blobs.keys("") and client.get("/files").json()["numberMatched"] == 0

    return check


def test_an_upload_is_answered_with_its_document(client: Client) -> None:
    answer = client.post("/files", files={"file": ("yard.xyz", b"1 2 3\n")})
    assert answer.status_code == 201
    document = answer.json()
    assert answer.headers["location"] == f"http://tieline.test/files/{document['id']}"
    assert (document["name"], document["bytes"], document["kind"]) == ("yard.xyz", 6, "scan")
    assert document["sha256"] == hashlib.sha256(b"1 2 3\n").hexdigest()
    assert document["scans"][0]["points"] == 12
    assert client.get(answer.headers["location"]).json() == document


def test_a_raw_body_is_taken_with_the_name_from_its_header(client: Client) -> None:
    headers = {**RAW, "Content-Disposition": 'attachment; filename="yard.xyz"'}
    answer = client.post("/files", content=b"1 2 3\n", headers=headers)
    assert answer.status_code == 201
    assert answer.json()["name"] == "yard.xyz"


def test_a_name_beyond_ascii_survives(client: Client) -> None:
    headers = {**RAW, "Content-Disposition": "attachment; filename*=UTF-8''H%C3%B6fe%20%E2%82%AC.xyz"}
    assert client.post("/files", content=b"1", headers=headers).json()["name"] == "Höfe €.xyz"
    assert client.post("/files", files={"file": ("Höfe.xyz", b"1")}).json()["name"] == "Höfe.xyz"


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ("../../etc/passwd", "passwd"),
        ("C:\\scans\\a.e57", "a.e57"),
        ("x" * 400 + ".xyz", "x" * 251 + ".xyz"),
    ],
)
def test_names_lose_their_path(client: Client, given: str, kept: str) -> None:
    assert client.post("/files", files={"file": (given, b"1")}).json()["name"] == kept


def test_names_lose_their_control_characters(client: Client) -> None:
    headers = {**RAW, "Content-Disposition": "attachment; filename*=UTF-8''a%09%0Ab%00.xyz"}
    assert client.post("/files", content=b"1", headers=headers).json()["name"] == "ab.xyz"


@pytest.mark.parametrize("name", ["..", "/", "a/", " "])
def test_a_file_without_a_usable_name_is_refused(client: Client, nothing_stored: Callable[[], bool], name: str) -> None:
    headers = {**RAW, "Content-Disposition": f'attachment; filename="{name}"'}
    assert client.post("/files", content=b"1", headers=headers).status_code == 400
    assert nothing_stored()


def test_several_files_come_back_in_their_order(client: Client) -> None:
    files = [("file", (f"{name}.xyz", b"1")) for name in "abc"]
    answer = client.post("/files", files=files)
    assert answer.status_code == 201
    assert [each["name"] for each in answer.json()["files"]] == ["a.xyz", "b.xyz", "c.xyz"]


def test_content_comes_back_whole_and_in_ranges(client: Client) -> None:
    content = bytes(range(256)) * 300
    file = client.upload("a.xyz", content)
    assert client.get(f"/files/{file}/content").content == content
    part = client.get(f"/files/{file}/content", headers={"Range": "bytes=1000-1999"})
    assert part.status_code == 206
    assert part.content == content[1000:2000]


def test_content_that_looks_like_a_boundary_is_not_taken_for_one(client: Client) -> None:
    content = b"\r\n--X\r\n--XY--\r\n-\r\n--" * 5000
    file = client.upload("a.xyz", content)
    assert client.get(f"/files/{file}/content").content == content


@pytest.mark.parametrize("split", [1, 7, 64])
def test_a_form_may_arrive_in_pieces_of_any_size(client: Client, split: int) -> None:
    content = b"1 2 3\r\n--" * 200
    whole = httpx.Request("POST", "http://x/", files=[("file", ("a.xyz", content)), ("file", ("b.xyz", b"4 5 6"))])
    body = whole.read()

    async def pieces() -> AsyncIterator[bytes]:
        for start in range(0, len(body), split):
            yield body[start : start + split]

    answer = client.post("/files", content=pieces(), headers={"Content-Type": whole.headers["content-type"]})
    assert answer.status_code == 201
    assert client.get(f"/files/{answer.json()['files'][0]['id']}/content").content == content


def test_an_unreadable_file_tells_file_reason_and_place_and_is_not_kept(
    client: Client, nothing_stored: Callable[[], bool]
) -> None:
    answer = client.post("/files", files={"file": ("photo.e57", b"broken")})
    assert answer.status_code == 400
    problem = answer.json()
    assert (problem["file"], problem["place"]) == ("photo.e57", "byte 0")
    assert problem["reason"]
    assert nothing_stored()


def test_a_file_that_kills_its_reader_is_a_bad_file(client: Client, nothing_stored: Callable[[], bool]) -> None:
    answer = client.post("/files", files={"file": ("a.e57", b"deadly")})
    assert answer.status_code == 400
    assert answer.json()["file"] == "a.e57"
    assert nothing_stored()


def test_one_bad_file_among_several_means_none_is_kept(client: Client, nothing_stored: Callable[[], bool]) -> None:
    files = [("file", ("a.xyz", b"1")), ("file", ("b.xyz", b"broken")), ("file", ("c.xyz", b"1"))]
    assert client.post("/files", files=files).status_code == 400
    assert nothing_stored()


def test_an_empty_file_is_refused(client: Client, nothing_stored: Callable[[], bool]) -> None:
    answer = client.post("/files", files={"file": ("a.xyz", b"")})
    assert answer.status_code == 400
    assert "empty" in answer.json()["detail"]
    assert nothing_stored()


def test_a_file_beyond_the_limit_is_refused(client: Client, nothing_stored: Callable[[], bool]) -> None:
    answer = client.post("/files", files=[("file", ("a.xyz", b"1")), ("file", ("b.xyz", b"1" * 1_000_001))])
    assert answer.status_code == 413
    assert nothing_stored()


def test_a_raw_body_beyond_the_limit_is_refused_before_it_is_read(
    client: Client, nothing_stored: Callable[[], bool]
) -> None:
    async def unread() -> AsyncIterator[bytes]:
        raise AssertionError("the body was read")
        yield b""

    headers = {**RAW, "Content-Disposition": "attachment; filename=a.xyz", "Content-Length": "1000001"}
    assert client.post("/files", content=unread(), headers=headers).status_code == 413
    assert nothing_stored()


def test_a_stream_of_unknown_length_beyond_the_limit_is_refused(
    client: Client, nothing_stored: Callable[[], bool]
) -> None:
    async def endless() -> AsyncIterator[bytes]:
        while True:
            yield b"1" * 100_000

    headers = {**RAW, "Content-Disposition": "attachment; filename=a.xyz"}
    assert client.post("/files", content=endless(), headers=headers).status_code == 413
    assert nothing_stored()


def test_a_full_disk_is_told(client: Client, nothing_stored: Callable[[], bool], monkeypatch: Any) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: SimpleNamespace(free=-1))
    assert client.post("/files", files={"file": ("a.xyz", b"1")}).status_code == 507
    assert nothing_stored()


def test_an_upload_that_would_fill_the_disk_is_refused_at_once(tmp_path: Path, adapters: Adapters) -> None:
    free = shutil.disk_usage(tmp_path).free
    tight = Client(create_app(Settings(data_dir=tmp_path, min_free_bytes=free - 1000), adapters))
    assert tight.post("/files", files={"file": ("a.xyz", b"1" * 200_000_000)}).status_code == 507


@pytest.mark.parametrize(
    ("headers", "body", "status"),
    [
        ({"Content-Type": "multipart/form-data"}, b"x", 400),
        ({"Content-Type": "multipart/form-data; boundary=X"}, b"", 400),
        ({"Content-Type": "multipart/form-data; boundary=X"}, b"garbage", 400),
        ({"Content-Type": "multipart/form-data; boundary=X"}, b"--X--\r\n", 400),
        ({"Content-Type": "multipart/form-data; boundary=" + "X" * 300}, b"x", 400),
        ({"Content-Type": "multipart/form-data; boundary=X"}, b"--X\r\n\r\nabc\r\n--X--\r\n", 400),
        ({"Content-Type": "multipart/mixed; boundary=X"}, b"--X--", 415),
        ({"Content-Type": "application/json"}, b"{}", 415),
        ({}, b"1 2 3", 415),
    ],
)
def test_bodies_that_are_no_uploads_are_refused(
    client: Client, nothing_stored: Callable[[], bool], headers: dict[str, str], body: bytes, status: int
) -> None:
    answer = client.post("/files", content=body, headers=headers)
    assert answer.status_code == status
    assert answer.headers["content-type"] == "application/problem+json"
    assert nothing_stored()


@pytest.mark.parametrize("keep", [0.1, 0.5, 0.99])
def test_a_form_that_ends_too_early_is_refused(client: Client, nothing_stored: Callable[[], bool], keep: float) -> None:
    whole = httpx.Request("POST", "http://x/", files=[("file", (f"{name}.xyz", b"1" * 5000)) for name in "ab"])
    body = whole.read()
    body = body[: int(len(body) * keep)]
    answer = client.post("/files", content=body, headers={"Content-Type": whole.headers["content-type"]})
    assert answer.status_code == 400
    assert nothing_stored()


def test_unknown_form_fields_are_pointed_at(
    client: Client, nothing_stored: Callable[[], bool], pointers: Callable[[httpx.Response], list[str]]
) -> None:
    files = [("file", ("a.xyz", b"1")), ("scan", ("b.xyz", b"1"))]
    assert pointers(client.post("/files", files=files)) == ["/scan"]
    assert nothing_stored()


@pytest.mark.parametrize("form", [True, False])
def test_a_client_that_leaves_in_the_middle_leaves_nothing_behind(
    settings: Settings, adapters: Adapters, nothing_stored: Callable[[], bool], form: bool
) -> None:
    first = b'--X\r\nContent-Disposition: form-data; name="file"; filename="a.xyz"\r\n\r\n1 2 3\r\n'
    second = b'--X\r\nContent-Disposition: form-data; name="file"; filename="b.xyz"\r\n\r\n4 5'
    messages = iter(
        [
            {"type": "http.request", "body": first + second if form else b"1 2 3", "more_body": True},
            {"type": "http.disconnect"},
        ]
    )
    kind = b"multipart/form-data; boundary=X" if form else b"application/octet-stream"
    scope = {
        "type": "http",
        "method": "POST",
        "path": "/files",
        "raw_path": b"/files",
        "query_string": b"",
        "root_path": "",
        "scheme": "http",
        "server": ("tieline.test", 80),
        "headers": [(b"content-type", kind), (b"content-disposition", b"attachment; filename=a.xyz")],
    }

    async def receive() -> dict[str, Any]:
        return next(messages)

    async def send(_message: dict[str, Any]) -> None:
        return None

    asyncio.run(create_app(settings, adapters)(scope, receive, send))  # type: ignore[arg-type]
    assert nothing_stored()


def test_files_are_listed_in_pages(client: Client) -> None:
    made = {client.upload(f"{number}.xyz") for number in range(3)}
    page = client.get("/files?limit=2").json()
    following = next(link["href"] for link in page["links"] if link["rel"] == "next")
    assert {file["id"] for file in page["files"] + client.get(following).json()["files"]} == made


def test_a_removed_file_is_gone(client: Client, nothing_stored: Callable[[], bool]) -> None:
    file = client.upload()
    answer = client.delete(f"/files/{file}")
    assert answer.status_code == 204
    assert answer.content == b""
    assert client.get(f"/files/{file}").status_code == 404
    assert nothing_stored()


def test_a_file_in_use_cannot_be_removed_before_its_job_ends(client: Client) -> None:
    job = client.register_two()
    file = client.get("/files").json()["files"][0]["id"]
    refused = client.delete(f"/files/{file}")
    assert refused.status_code == 409
    assert job in refused.json()["detail"]
    client.delete(f"/jobs/{job}")
    assert client.delete(f"/files/{file}").status_code == 204


@pytest.mark.parametrize("file", ["none", "%00", "..%2F..%2Fetc%2Fpasswd", "a" * 500, "%F0%9F%94%A5", "%ED%A0%80"])
@pytest.mark.parametrize("method", ["GET", "DELETE"])
def test_an_unknown_file_is_not_found(client: Client, method: str, file: str) -> None:
    assert client.request(method, f"/files/{file}").status_code == 404
    assert client.get(f"/files/{file}/content").status_code == 404


def test_the_same_content_is_stored_once_and_goes_with_its_last_file(client: Client, adapters: Adapters) -> None:
    files = [client.upload(name, b"1 2 3\n") for name in ("a.xyz", "b.xyz")]
    assert len(adapters.blobs.keys("")) == 1
    client.delete(f"/files/{files[0]}")
    assert client.get(f"/files/{files[1]}/content").content == b"1 2 3\n"
    client.delete(f"/files/{files[1]}")
    assert adapters.blobs.keys("") == []


def test_a_refused_upload_takes_nothing_from_a_file_of_the_same_content(client: Client) -> None:
    file = client.upload("a.xyz", b"1 2 3\n")
    files = [("file", ("b.xyz", b"1 2 3\n")), ("file", ("c.xyz", b"broken"))]
    assert client.post("/files", files=files).status_code == 400
    assert client.get(f"/files/{file}/content").content == b"1 2 3\n"
