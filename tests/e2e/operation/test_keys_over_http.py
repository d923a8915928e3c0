"""Keys of a running service: made and revoked beside it, checked before a body is sent, followed through its log."""

import asyncio
import json
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import httpx
import pytest

from service.client import RefusedError, ServiceClient
from tests.e2e.running.running_service import RunningService, running_service, wait_until
from tests.measures.patience import patience

pytestmark = pytest.mark.service

WITHIN_S = 3.5
"""How long a revoked key may be taken: 3 s, and what a busy machine adds."""
GIGABYTE = 1_000_000_000


def command(service: RunningService, *arguments: str) -> str:
    """Run `tieline keys …` beside the service and give what it prints."""
    done = subprocess.run(
        [sys.executable, "-m", "service", "keys", *arguments, "--data-dir", str(service.data)],
        capture_output=True,
        text=True,
        check=True,
        timeout=60.0 * patience(),
    )
    return done.stdout.strip()


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningService]:
    """Give a service that is open until the first test makes a key."""
    with running_service(tmp_path_factory.mktemp("guarded")) as service:
        assert service.http.get("/jobs").status_code == 200
        yield service


@pytest.fixture(scope="module")
def admin(guarded: RunningService) -> str:
    return command(guarded, "create", "admin", "--scopes", "admin,read")


def new_key(service: RunningService, admin: str, name: str) -> tuple[str, str]:
    """Make a key over HTTP; give its address and its secret."""
    wait_until(lambda: asked(service).status_code == 401, WITHIN_S)
    answer = service.http.post("/keys", json={"name": name}, headers={"Authorization": f"Bearer {admin}"})
    assert answer.status_code == 201, answer.text
    return answer.headers["location"], answer.json()["key"]


@pytest.fixture(scope="module")
def alice(guarded: RunningService, admin: str) -> str:
    return new_key(guarded, admin, "alice")[1]


def revoke(service: RunningService, admin: str, place: str) -> None:
    answer = service.http.delete(place, headers={"Authorization": f"Bearer {admin}"})
    assert answer.status_code == 200, answer.text


def asked(service: RunningService, secret: str = "", path: str = "/jobs", **more: Any) -> httpx.Response:
    headers = {"Authorization": f"Bearer {secret}"} if secret else {}
    return service.http.get(path, headers=headers, **more)


def test_the_first_key_closes_a_running_service_within_three_seconds(guarded: RunningService, admin: str) -> None:
    wait_until(lambda: asked(guarded).status_code == 401, WITHIN_S)
    assert asked(guarded, admin).status_code == 200


def test_a_body_is_refused_before_any_of_it_is_sent(guarded: RunningService, alice: str) -> None:
    assert asked(guarded, alice).status_code == 200
    url = httpx.URL(guarded.url)
    head = (
        f"POST /files HTTP/1.1\r\nHost: {url.host}\r\nContent-Length: {GIGABYTE}\r\nExpect: 100-continue\r\n"
        'Content-Disposition: attachment; filename="a.xyz"\r\nContent-Type: application/octet-stream\r\n\r\n'
    )
    with socket.create_connection((url.host, url.port), timeout=10.0 * patience()) as connection:
        connection.sendall(head.encode())
        answer = connection.recv(4096)
    assert answer.startswith(b"HTTP/1.1 401 "), answer


def test_a_job_is_followed_from_its_request_to_its_computation(guarded: RunningService, alice: str) -> None:
    headers = {"Authorization": f"Bearer {alice}", "X-Request-ID": "survey-7", "Prefer": "respond-async"}
    answer = guarded.http.post("/processes/echo/execution", json={"inputs": {"stringInput": "a"}}, headers=headers)
    job = answer.json()["jobID"]
    wait_until(lambda: asked(guarded, alice, f"/jobs/{job}").json()["status"] == "successful", 60.0)
    lines = [json.loads(line) for line in guarded.log.splitlines() if line.startswith("{") and "survey-7" in line]
    told = {(line["event"], line["request_id"], line.get("job", job)) for line in lines}
    assert {("request", "survey-7", job), ("step done", "survey-7", job)} <= told


def test_the_command_line_client_brings_its_key(guarded: RunningService, alice: str, tmp_path: Path) -> None:
    scan = tmp_path / "a.xyz"
    scan.write_text("1.5 2.25 3.125\n4.5 0.25 6.125\n2.5 8.25 1.125\n9.5 1.25 2.875\n")
    with ServiceClient(guarded.url, key=alice) as client:
        assert client.upload(scan)["name"] == "a.xyz"
    with ServiceClient(guarded.url) as client, pytest.raises(RefusedError) as refused:
        client.dismiss("x")
    assert refused.value.status == 401


def test_a_revoked_key_is_taken_no_more_after_three_seconds(guarded: RunningService, alice: str) -> None:
    secret = command(guarded, "create", "bob")
    assert asked(guarded, secret).status_code == 200
    command(guarded, "revoke", "bob")
    wait_until(lambda: asked(guarded, secret).status_code == 401, WITHIN_S)
    assert asked(guarded, alice).status_code == 200


def test_an_upload_under_way_ends_when_its_key_is_revoked(guarded: RunningService, admin: str) -> None:
    place, secret = new_key(guarded, admin, "carol")
    url = httpx.URL(guarded.url)

    async def send() -> bytes:
        reader, writer = await asyncio.open_connection(url.host, url.port)
        head = (
            f"POST /files HTTP/1.1\r\nHost: {url.host}\r\nContent-Length: {GIGABYTE}\r\n"
            f'Authorization: Bearer {secret}\r\nContent-Disposition: attachment; filename="a.xyz"\r\n\r\n'
        )
        writer.write(head.encode())
        answer = asyncio.create_task(reader.read(4096))
        revoked = asyncio.create_task(asyncio.to_thread(revoke, guarded, admin, place))
        while not answer.done():
            writer.write(b"1 2 3\n")
            await asyncio.sleep(0.1)
        await revoked
        writer.close()
        return answer.result()

    answer = asyncio.run(asyncio.wait_for(send(), 30.0 * patience()))
    assert answer.startswith(b"HTTP/1.1 401 "), answer
    wait_until(lambda: not [name for name in guarded.stored() if "incoming" in name or "partial" in name], 10.0)


def test_no_event_is_told_three_seconds_after_the_key_is_revoked(guarded: RunningService, admin: str) -> None:
    place, secret = new_key(guarded, admin, "dave")
    headers = {"Authorization": f"Bearer {secret}", "Prefer": "respond-async"}
    body = {"inputs": {"stringInput": "a", "pause": 5}}
    job = guarded.http.post("/processes/echo/execution", json=body, headers=headers).json()["jobID"]
    told = []
    with httpx.stream("GET", f"{guarded.url}/jobs/{job}/events", headers=headers, timeout=60.0 * patience()) as stream:
        for line in stream.iter_lines():
            told.append(line)
            if len(told) == 1:
                revoke(guarded, admin, place)
    assert told
    assert "successful" not in "".join(told)
    assert "Exception in ASGI" not in guarded.log


def _serve(directory: Path, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    everything: Sequence[str] = [sys.executable, "-m", "service", "serve", "--port", "0", *arguments]
    return subprocess.run(
        [*everything, "--data-dir", str(directory)],
        capture_output=True,
        text=True,
        check=False,
        timeout=60.0 * patience(),
        env={"PATH": "/usr/bin:/bin", **environment},
    )


def test_strangers_are_not_served_without_keys(tmp_path: Path) -> None:
    done = _serve(tmp_path, "--host", "0.0.0.0")  # noqa: S104 - it refuses to
    assert done.returncode == 2
    assert "tieline keys create" in done.stderr
    assert "TIELINE_AUTH=off" in done.stderr
