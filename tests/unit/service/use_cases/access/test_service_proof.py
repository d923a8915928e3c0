"""`tieline register` sends scans and keys only to a service that proves to be its user's."""

import json
import os
import stat
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import httpx
import pytest
from rich.console import Console

from service import launcher
from service.client import ServiceClient
from service.errors import InvalidRequestError
from service.register_command import chosen_service
from service.settings import Settings
from service.use_cases.access.service_proof import (
    CHALLENGE_HEADER,
    LOCK,
    PROOF_HEADER,
    new_challenge,
    new_secret,
    proof_of,
    secret_of,
)


class Listener:
    """Somebody who answers like a service, and writes down what he was sent."""

    def __init__(self, headers: dict[str, str] | None = None) -> None:
        heard = self.heard = list[tuple[str, dict[str, str]]]()

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                heard.append((f"{self.command} {self.path}", dict(self.headers)))
                self.send_response(200)
                for name, value in (headers or {}).items():
                    self.send_header(name, value)
                self.end_headers()
                self.wfile.write(json.dumps({"title": "Tieline"}).encode())

            do_POST = do_GET  # noqa: N815

            def log_message(self, *_: object) -> None: ...

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.port = self.server.server_port
        threading.Thread(target=self.server.serve_forever, daemon=True).start()


@pytest.fixture
def listener() -> Iterator[Listener]:
    made = Listener({PROOF_HEADER: "0" * 64})
    yield made
    made.server.shutdown()
    made.server.server_close()


def test_a_stranger_at_the_usual_address_gets_neither_scans_nor_key(
    listener: Listener, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / LOCK).write_bytes(new_secret())
    for name, value in {"PORT": str(listener.port), "DATA_DIR": str(tmp_path), "KEY": "tl_a_secret"}.items():
        monkeypatch.setenv(f"TIELINE_{name}", value)
    with (
        pytest.raises(InvalidRequestError, match=f"--url http://127.0.0.1:{listener.port}"),
        chosen_service(None, Console(quiet=True)),
    ):
        pass
    assert {what for what, _ in listener.heard} == {"GET /"}
    assert "tl_a_secret" not in str(listener.heard)


def test_an_answer_fetched_at_another_port_proves_nothing() -> None:
    secret, challenge = new_secret(), new_challenge()
    assert proof_of(secret, challenge, 8765) != proof_of(secret, challenge, 8766)
    assert proof_of(secret, challenge, 8765) != proof_of(new_secret(), challenge, 8765)


@pytest.mark.parametrize(("port", "proved"), [(8765, True), (8766, False)])
def test_who_knows_the_secret_is_believed_at_its_own_port(port: int, proved: bool) -> None:
    secret = new_secret()

    def answer(request: httpx.Request) -> httpx.Response:
        return httpx.Response(200, headers={PROOF_HEADER: proof_of(secret, request.headers[CHALLENGE_HEADER], port)})

    with ServiceClient("http://127.0.0.1:8765", httpx.MockTransport(answer), key="tl_a_secret") as client:
        assert client.proves(secret) is proved
        assert not client.proves(None)


def test_a_data_directory_and_its_secret_are_its_owners(tmp_path: Path) -> None:
    before = os.umask(0o022)
    try:
        settings = Settings(data_dir=tmp_path / "data")
        settings.data_dir.mkdir(mode=0o755)
        launcher.keep_private(settings)
        with launcher._only_one(settings):
            secret = secret_of(settings.data_dir)
            made = settings.data_dir / "made-later"
            made.touch()
            modes = [stat.S_IMODE(path.stat().st_mode) for path in (settings.data_dir, settings.data_dir / LOCK, made)]
    finally:
        os.umask(before)
    assert secret is not None
    assert modes == [0o700, 0o600, 0o600]


def test_a_lock_without_a_secret_proves_nothing(tmp_path: Path) -> None:
    assert secret_of(tmp_path) is None
    (tmp_path / LOCK).touch()
    assert secret_of(tmp_path) is None
