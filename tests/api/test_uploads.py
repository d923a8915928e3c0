"""Resumable uploads by tus 1.0.0 over HTTP."""

import asyncio
import base64
import hashlib
import os
import shutil
from collections.abc import AsyncIterator
from datetime import UTC, datetime, timedelta
from email.utils import parsedate_to_datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import httpx
import pytest

from service.adapters.uploads.local_uploads import LocalUploads
from service.dependencies import Adapters
from service.ports import PendingUpload
from service.settings import Settings
from tests.api.conftest import Client
from tests.doubles.application import create_app

CONTENT = b"1 2 3\n" * 40
TUS = {"Tus-Resumable": "1.0.0"}
PART = {**TUS, "Content-Type": "application/offset+octet-stream"}


def named(name: str) -> str:
    return f"filename {base64.b64encode(name.encode()).decode()}"


def checksum(algorithm: str, content: bytes) -> str:
    return f"{algorithm} {base64.b64encode(hashlib.new(algorithm, content).digest()).decode()}"


def begin(client: Client, length: int = len(CONTENT), name: str = "a.xyz", **what: Any) -> httpx.Response:
    headers = {**TUS, "Upload-Length": str(length), "Upload-Metadata": named(name), **what.pop("headers", {})}
    return client.post("/uploads", headers=headers, **what)


def begun(client: Client, **what: Any) -> str:
    answer = begin(client, **what)
    assert answer.status_code == 201, answer.text
    return answer.headers["location"]


def send(client: Client, upload: str, offset: int, content: bytes, **headers: str) -> httpx.Response:
    return client.request("PATCH", upload, headers={**PART, "Upload-Offset": str(offset), **headers}, content=content)


def offset(client: Client, upload: str) -> int:
    answer = client.request("HEAD", upload, headers=TUS)
    assert answer.status_code == 200
    return int(answer.headers["upload-offset"])


def test_options_tell_what_is_spoken(client: Client) -> None:
    answer = client.request("OPTIONS", "/uploads")
    assert answer.status_code == 204
    assert answer.headers["tus-version"] == "1.0.0"
    assert set(answer.headers["tus-extension"].split(",")) == {
        *("creation", "creation-with-upload", "expiration", "checksum", "termination")
    }
    assert answer.headers["tus-checksum-algorithm"] == "sha1,sha256"
    assert answer.headers["tus-max-size"] == "1000000"


def test_an_upload_in_parts_becomes_a_file_of_the_same_id(client: Client) -> None:
    upload = begun(client)
    assert send(client, upload, 0, CONTENT[:100]).headers["upload-offset"] == "100"
    last = send(client, upload, 100, CONTENT[100:])
    assert last.status_code == 204
    file = last.headers["tieline-file"]
    assert upload.endswith(f"/uploads/{file}")
    assert client.get(last.headers["content-location"]).json()["sha256"] == hashlib.sha256(CONTENT).hexdigest()
    assert client.get(f"/files/{file}/content").content == CONTENT


def test_head_and_get_name_the_file(client: Client) -> None:
    upload = begun(client)
    file = send(client, upload, 0, CONTENT).headers["tieline-file"]
    head = client.request("HEAD", upload, headers=TUS)
    assert (head.headers["tieline-file"], head.headers["upload-offset"]) == (file, str(len(CONTENT)))
    document = client.get(upload).json()
    assert (document["status"], document["file"], document["offset"]) == ("finished", file, len(CONTENT))


def test_head_tells_offset_length_metadata_and_is_not_cached(client: Client) -> None:
    upload = begun(client)
    send(client, upload, 0, CONTENT[:7])
    answer = client.request("HEAD", upload, headers=TUS)
    assert (answer.headers["upload-offset"], answer.headers["upload-length"]) == ("7", str(len(CONTENT)))
    assert answer.headers["upload-metadata"] == named("a.xyz")
    assert answer.headers["cache-control"] == "no-store"


def test_creation_may_bring_the_first_part(client: Client) -> None:
    answer = begin(client, headers=PART, content=CONTENT[:60])
    assert (answer.status_code, answer.headers["upload-offset"]) == (201, "60")
    assert send(client, answer.headers["location"], 60, CONTENT[60:]).status_code == 204


def test_creation_may_bring_everything(client: Client) -> None:
    answer = begin(client, headers=PART, content=CONTENT)
    assert (answer.status_code, answer.headers["upload-offset"]) == (201, str(len(CONTENT)))
    assert client.get(f"/files/{answer.headers['tieline-file']}/content").content == CONTENT


def test_a_damaged_first_part_leaves_no_upload(client: Client, settings: Settings) -> None:
    headers = {**PART, "Upload-Checksum": checksum("sha1", b"other")}
    assert begin(client, headers=headers, content=CONTENT).status_code == 460
    assert LocalUploads(settings.data_dir / "uploads").ids() == []


@pytest.mark.parametrize("algorithm", ["sha1", "sha256"])
def test_a_part_with_its_checksum_is_taken(client: Client, algorithm: str) -> None:
    upload = begun(client)
    answer = send(client, upload, 0, CONTENT, **{"Upload-Checksum": checksum(algorithm, CONTENT)})
    assert answer.status_code == 204


def test_a_damaged_part_is_not_kept(client: Client) -> None:
    upload = begun(client)
    send(client, upload, 0, CONTENT[:10])
    answer = send(client, upload, 10, CONTENT[10:], **{"Upload-Checksum": checksum("sha256", CONTENT)})
    assert answer.status_code == 460
    assert "from offset 10" in answer.json()["detail"]
    assert offset(client, upload) == 10


@pytest.mark.parametrize("value", ["md5 AAAA", "sha1 AAAA", "sha1 %%%", "", "sha256"])
def test_a_checksum_that_is_none_is_refused(client: Client, value: str) -> None:
    upload = begun(client)
    answer = send(client, upload, 0, CONTENT, **{"Upload-Checksum": value})
    assert answer.status_code == 400
    assert answer.json()["errors"][0]["pointer"] == "/Upload-Checksum"
    assert offset(client, upload) == 0


@pytest.mark.parametrize("at", [0, 9, 11, 240])
def test_a_gap_or_an_overlap_is_refused_and_the_right_offset_told(client: Client, at: int) -> None:
    upload = begun(client)
    send(client, upload, 0, CONTENT[:10])
    answer = send(client, upload, at, CONTENT[at:])
    assert answer.status_code == 409
    assert answer.json()["offset"] == 10


@pytest.mark.parametrize("chunked", [True, False])
def test_more_than_was_announced_is_refused(client: Client, chunked: bool) -> None:
    async def pieces() -> AsyncIterator[bytes]:
        yield CONTENT
        yield b"more"

    upload = begun(client)
    headers = {**PART, "Upload-Offset": "0"}
    body: Any = pieces() if chunked else CONTENT + b"more"
    assert client.request("PATCH", upload, headers=headers, content=body).status_code == 413
    assert client.get("/files").json()["numberMatched"] == 0


def test_an_upload_beyond_the_limit_is_refused_when_it_is_announced(client: Client) -> None:
    answer = begin(client, length=1_000_001)
    assert answer.status_code == 413
    assert answer.headers["tus-resumable"] == "1.0.0"


def test_an_upload_that_would_fill_the_disk_is_refused_when_it_is_announced(tmp_path: Path, adapters: Adapters) -> None:
    free = shutil.disk_usage(tmp_path).free
    tight = Client(create_app(Settings(data_dir=tmp_path, min_free_bytes=free - 200_000_000), adapters))
    assert begin(tight, length=1_000_000_000).status_code == 507


def test_a_disk_that_fills_up_meanwhile_is_told(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    upload = begun(client)
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: SimpleNamespace(free=-1))
    assert send(client, upload, 0, CONTENT).status_code == 507
    monkeypatch.undo()
    assert offset(client, upload) == 0


def test_an_empty_upload_is_refused(client: Client) -> None:
    answer = begin(client, length=0)
    assert answer.status_code == 400
    assert "empty" in answer.json()["detail"]


def test_content_that_is_no_scan_is_refused_by_the_last_part_and_remembered(client: Client, adapters: Adapters) -> None:
    upload = begun(client, length=6)
    answer = send(client, upload, 0, b"broken")
    assert answer.status_code == 400
    assert answer.json()["file"] == "a.xyz"
    document = client.get(upload).json()
    assert (document["status"], document["problem"]["title"]) == ("refused", "Unreadable file")
    assert client.request("HEAD", upload, headers=TUS).status_code == 410
    assert not adapters.blobs.keys("")


@pytest.mark.parametrize("length", ["", "-1", "1.5", "ten", "1" * 30, "٣"])
def test_a_length_that_is_none_is_refused(client: Client, length: str) -> None:
    headers = {**TUS, "Upload-Length": length.encode(), "Upload-Metadata": named("a.xyz")}
    answer = client.post("/uploads", headers=headers)
    assert answer.status_code == 400
    assert answer.json()["errors"][0]["pointer"] == "/Upload-Length"


@pytest.mark.parametrize(
    "metadata", ["", "filename", "filename %%%", "filetype dGV4dA==", "filename Li4=", "filename /w=="]
)
def test_metadata_without_a_usable_name_are_refused(client: Client, metadata: str) -> None:
    answer = client.post("/uploads", headers={**TUS, "Upload-Length": "5", "Upload-Metadata": metadata})
    assert answer.status_code == 400
    assert answer.json()["errors"][0]["pointer"] == "/Upload-Metadata"


def test_names_lose_their_path(client: Client) -> None:
    upload = begun(client, name="../../Höfe.xyz")
    assert client.get(upload).json()["name"] == "Höfe.xyz"


@pytest.mark.parametrize("version", [{}, {"Tus-Resumable": "0.2.2"}])
@pytest.mark.parametrize("method", ["POST", "HEAD", "PATCH", "DELETE"])
def test_other_versions_of_the_protocol_are_refused(client: Client, method: str, version: dict[str, str]) -> None:
    upload = "/uploads" if method == "POST" else begun(client)
    answer = client.request(method, upload, headers={**version, "Upload-Offset": "0"})
    assert answer.status_code == 412
    assert answer.headers["tus-version"] == "1.0.0"


def test_a_part_of_another_content_type_is_refused(client: Client) -> None:
    upload = begun(client)
    answer = send(client, upload, 0, CONTENT, **{"Content-Type": "application/octet-stream"})
    assert answer.status_code == 415


def test_the_method_may_stand_in_a_header(client: Client) -> None:
    upload = begun(client)
    answer = client.post(
        upload, headers={**PART, "Upload-Offset": "0", "X-HTTP-Method-Override": "PATCH"}, content=CONTENT
    )
    assert answer.status_code == 204
    assert client.post(upload, headers={**TUS, "X-HTTP-Method-Override": "DELETE"}).status_code == 204


def test_a_terminated_upload_is_gone_with_its_bytes(client: Client, settings: Settings) -> None:
    upload = begun(client)
    send(client, upload, 0, CONTENT[:50])
    assert client.request("DELETE", upload, headers=TUS).status_code == 204
    assert client.request("HEAD", upload, headers=TUS).status_code == 404
    assert [path for path in (settings.data_dir / "uploads").rglob("*") if path.is_file()] == []


def test_terminating_a_finished_upload_leaves_the_file(client: Client) -> None:
    upload = begun(client)
    file = send(client, upload, 0, CONTENT).headers["tieline-file"]
    assert client.request("DELETE", upload, headers=TUS).status_code == 204
    assert client.get(f"/files/{file}").status_code == 200


@pytest.mark.parametrize("name", ["none", "..%2F..%2Fetc", "%2e%2e", ".hidden", "a" * 300, "%00"])
@pytest.mark.parametrize("method", ["HEAD", "PATCH", "DELETE", "GET"])
def test_an_unknown_upload_is_not_found(client: Client, method: str, name: str) -> None:
    assert client.request(method, f"/uploads/{name}", headers={**PART, "Upload-Offset": "0"}).status_code == 404


def test_expiry_is_told_and_kept(client: Client, settings: Settings) -> None:
    answer = begin(client)
    expires = parsedate_to_datetime(answer.headers["upload-expires"])
    assert abs(expires - datetime.now(UTC) - timedelta(days=1)) < timedelta(minutes=1)
    upload = answer.headers["location"]
    folder = settings.data_dir / "uploads" / upload.rpartition("/")[2]
    long_ago = datetime.now(UTC).timestamp() - settings.upload_expiry_s - 10
    for path in folder.iterdir():
        os.utime(path, (long_ago, long_ago))
    assert client.request("HEAD", upload, headers=TUS).status_code == 410
    assert send(client, upload, 0, CONTENT).status_code == 410


def test_an_upload_that_is_being_written_to_is_locked(client: Client, settings: Settings) -> None:
    upload = begun(client)
    store = LocalUploads(settings.data_dir / "uploads")
    opened = store.lock(upload.rpartition("/")[2])
    assert opened is not None
    opened.touch()
    assert client.request("HEAD", upload, headers=TUS).status_code == 423
    assert send(client, upload, 0, CONTENT).status_code == 423
    opened.close()
    assert send(client, upload, 0, CONTENT).status_code == 204


def test_a_complete_upload_whose_process_died_becomes_a_file_when_somebody_asks(
    client: Client, settings: Settings
) -> None:
    store = LocalUploads(settings.data_dir / "uploads")
    store.create(PendingUpload("left", "a.xyz", len(CONTENT), "", datetime.now(UTC)))
    opened = store.lock("left")
    assert opened is not None
    opened.write(CONTENT)
    opened.close()
    assert offset(client, "/uploads/left") == len(CONTENT)
    assert client.get("/files/left/content").content == CONTENT
    assert client.get("/uploads/left").json()["status"] == "finished"


@pytest.mark.parametrize("promised", [True, False])
def test_what_came_before_the_connection_broke_is_kept_unless_a_checksum_was_promised(
    client: Client, settings: Settings, adapters: Adapters, promised: bool
) -> None:
    upload = begun(client)
    messages = iter([{"type": "http.request", "body": CONTENT[:30], "more_body": True}, {"type": "http.disconnect"}])
    headers = {**PART, "Upload-Offset": "0"}
    if promised:
        headers["Upload-Checksum"] = checksum("sha1", CONTENT)
    path = httpx.URL(upload).path
    scope = {
        "type": "http",
        "method": "PATCH",
        "path": path,
        "raw_path": path.encode(),
        "query_string": b"",
        "root_path": "",
        "scheme": "http",
        "server": ("tieline.test", 80),
        "headers": [(name.lower().encode(), value.encode()) for name, value in headers.items()],
    }

    async def receive() -> dict[str, Any]:
        return next(messages)

    async def answered(_message: dict[str, Any]) -> None:
        return None

    asyncio.run(create_app(settings, adapters)(scope, receive, answered))  # type: ignore[arg-type]
    assert offset(client, upload) == (0 if promised else 30)
