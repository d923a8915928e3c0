"""Resumable uploads against the running service, with two API processes on one data directory."""

import base64
import hashlib
import socket
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest
from tusclient.client import TusClient

from tests.e2e.files.broken_uploads import PART, TUS, begun, finished, write_scan
from tests.e2e.running.running_service import RunningService, running_service, wait_until
from tests.measures.patience import patience

SIZE = 3_000_000


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningService]:
    home = tmp_path_factory.mktemp("uploads")
    with running_service(home, API_PROCESSES="2", BODY_TIMEOUT_S="4", WORKERS="1") as running:
        wait_until(lambda: len(running.apis()) == 2)
        yield running


@pytest.fixture
def scan(tmp_path: Path) -> Path:
    return write_scan(tmp_path / "a.las", SIZE)


@contextmanager
def patching(service: RunningService, upload: str, body: bytes, declared: int) -> Iterator[socket.socket]:
    """Begin a PATCH on a connection of its own, which stays open."""
    url = httpx.URL(service.url)
    headers = {**PART, "Host": url.netloc.decode(), "Upload-Offset": "0", "Content-Length": str(declared)}
    head = f"PATCH {upload} HTTP/1.1\r\n" + "".join(f"{k}: {v}\r\n" for k, v in headers.items()) + "\r\n"
    with socket.create_connection((url.host, url.port or 80), timeout=20.0 * patience()) as connection:
        connection.sendall(head.encode() + body)
        yield connection


@contextmanager
def sending(connection: socket.socket, body: bytes) -> Iterator[None]:
    """Send a byte twenty times a second, whatever else the test waits for."""
    ended = threading.Event()

    def send() -> None:
        for k in range(len(body)):
            if ended.wait(0.05):
                return
            connection.sendall(body[k : k + 1])

    thread = threading.Thread(target=send)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


@pytest.mark.parametrize("checked", [True, False])
def test_tuspy_uploads_in_parts(service: RunningService, scan: Path, checked: bool) -> None:
    client = TusClient(f"{service.url}/uploads")
    with scan.open("rb") as stream:
        uploader = client.uploader(
            file_stream=stream, chunk_size=700_000, metadata={"filename": "a.las"}, upload_checksum=checked
        )
        uploader.upload()
    file = finished(service, httpx.URL(uploader.url).path)
    assert file["sha256"] == hashlib.sha256(scan.read_bytes()).hexdigest()
    assert (file["name"], file["kind"]) == ("a.las", "scan")


def test_what_is_no_scan_is_refused_and_leaves_nothing(service: RunningService, tmp_path: Path) -> None:
    path = tmp_path / "a.e57"
    path.write_bytes(b"no E57 at all" * 1000)
    before = service.stored()
    upload = begun(service, path)
    answer = service.http.patch(upload, headers={**PART, "Upload-Offset": "0"}, content=path.read_bytes())
    assert (answer.status_code, answer.json()["file"]) == (400, "a.e57")
    document = service.http.get(upload).json()
    assert (document["status"], document["problem"]["title"]) == ("refused", "Unreadable file")
    assert service.http.head(upload, headers=TUS).status_code == 410
    assert {name for name in service.stored() - before if not name.endswith("/upload.json")} == set()


def test_a_request_that_stalls_is_ended_by_a_new_one(service: RunningService, scan: Path) -> None:
    content = scan.read_bytes()
    upload = begun(service, scan)
    with patching(service, upload, content[:1_000_000], SIZE):
        time.sleep(1.5)
        head = service.http.head(upload, headers=TUS)
        assert (head.status_code, head.headers["upload-offset"]) == (200, "1000000")
        headers = {**PART, "Upload-Offset": "1000000"}
        assert service.http.patch(upload, headers=headers, content=content[1_000_000:]).status_code == 204
    assert finished(service, upload)["sha256"] == hashlib.sha256(content).hexdigest()


def test_a_busy_upload_is_locked_at_once(service: RunningService, scan: Path) -> None:
    content = scan.read_bytes()
    upload = begun(service, scan)
    with patching(service, upload, content[:1000], SIZE) as busy, sending(busy, content[1000:]):
        wait_until(lambda: service.http.head(upload, headers=TUS).status_code == 423)
        for _ in range(6):
            time.sleep(0.2)
            begin = time.monotonic()
            headers = {**PART, "Upload-Offset": "0"}
            answers = [
                service.http.head(upload, headers=TUS),
                service.http.patch(upload, headers=headers, content=content),
            ]
            assert [answer.status_code for answer in answers] == [423, 423]
            assert time.monotonic() - begin < 1.0 * patience()
    service.http.delete(upload, headers=TUS)


def test_a_client_that_falls_silent_is_sent_away_and_may_come_back(service: RunningService, scan: Path) -> None:
    content = scan.read_bytes()
    upload = begun(service, scan)
    with patching(service, upload, content[:2_000_000], SIZE) as silent:
        assert silent.recv(100).startswith(b"HTTP/1.1 408 ")
    head = service.http.head(upload, headers=TUS)
    assert head.headers["upload-offset"] == "2000000"
    headers = {**PART, "Upload-Offset": "2000000"}
    assert service.http.patch(upload, headers=headers, content=content[2_000_000:]).status_code == 204
    assert finished(service, upload)["bytes"] == SIZE


@pytest.mark.parametrize("kind", ["application/octet-stream", "multipart/form-data; boundary=X"])
def test_other_uploads_that_fall_silent_leave_nothing(service: RunningService, kind: str) -> None:
    before = service.stored()
    url = httpx.URL(service.url)
    part = b'--X\r\nContent-Disposition: form-data; name="file"; filename="a.xyz"\r\n\r\n1 2 3\r\n'
    head = (
        f"POST /files HTTP/1.1\r\nHost: {url.netloc.decode()}\r\nContent-Type: {kind}\r\nContent-Length: 1000000\r\n"
        'Content-Disposition: attachment; filename="a.xyz"\r\n\r\n'
    )
    with socket.create_connection((url.host, url.port or 80), timeout=20.0 * patience()) as silent:
        silent.sendall(head.encode() + (part if kind.startswith("multipart") else b"1 2 3\n"))
        assert silent.recv(100).startswith(b"HTTP/1.1 408 ")
    assert service.stored() == before


def test_the_same_scan_sent_three_ways_is_stored_once(service: RunningService, tmp_path: Path) -> None:
    scan = write_scan(tmp_path / "thrice.las", 1_234_567)
    content = scan.read_bytes()
    name = base64.b64encode(b"thrice.las").decode()
    headers = {**PART, "Upload-Length": str(len(content)), "Upload-Metadata": f"filename {name}"}
    by_tus = service.post("/uploads", headers=headers, content=content).headers["tieline-file"]
    raw = {"Content-Type": "application/octet-stream", "Content-Disposition": 'attachment; filename="thrice.las"'}
    by_body = service.post("/files", headers=raw, content=content).json()["id"]
    by_form = service.upload(scan)["id"]
    sha256 = hashlib.sha256(content).hexdigest()
    assert [path.name for path in service.data.rglob("*") if path.is_file() and path.stat().st_size == 1_234_567] == [
        sha256
    ]
    for file in (by_tus, by_body):
        assert service.http.delete(f"/files/{file}").status_code == 204
    assert service.http.get(f"/files/{by_form}/content").content == content
    service.http.delete(f"/files/{by_form}")
    assert not (service.data / "blobs" / "files" / sha256).exists()


def test_twins_that_come_and_go_at_the_same_time_do_not_take_their_content_from_each_other(
    service: RunningService, tmp_path: Path
) -> None:
    scan = write_scan(tmp_path / "twin.las", 50_000)
    content = scan.read_bytes()

    def come_and_go(_number: int) -> list[int]:
        answers = []
        with httpx.Client(base_url=service.url, timeout=60.0 * patience()) as client:
            for _ in range(3):
                file = client.post("/files", files={"file": (scan.name, content)}).raise_for_status().json()["id"]
                answers.append(int(client.get(f"/files/{file}/content").content == content))
                answers.append(client.delete(f"/files/{file}").status_code)
        return answers

    with ThreadPoolExecutor(4) as clients:
        found = list(clients.map(come_and_go, range(4)))
    assert found == [[1, 204] * 3] * 4
    assert not (service.data / "blobs" / "files" / hashlib.sha256(content).hexdigest()).exists()
