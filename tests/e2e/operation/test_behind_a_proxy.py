"""Two API processes with nothing in common but database and object store, behind the proxy of `docker/compose.yaml`."""

import os
import shutil
import socket
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import httpx
import psutil
import pytest

from tests.e2e.files.broken_uploads import begun, finished, start_sender, write_scan
from tests.e2e.running.running_service import RunningService, wait_until
from tests.measures.patience import patience
from tests.servers.object_server import ObjectServer
from tests.servers.postgres_server import postgres_server

pytestmark = [
    pytest.mark.service,
    pytest.mark.skipif(shutil.which("caddy") is None, reason="the proxy, caddy, is not installed"),
]
CADDYFILE = Path(__file__).parents[3] / "docker" / "Caddyfile"


@dataclass
class Proxied:
    proxy: RunningService
    """The service as clients see it."""
    apis: Sequence[RunningService]


def free_port() -> int:
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return int(listener.getsockname()[1])


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, objects: ObjectServer) -> Iterator[Proxied]:
    home = tmp_path_factory.mktemp("proxied")
    with postgres_server() as server:
        settings = {"SLOTS": "1", "DATABASE_URL": server.new_database(), "STORAGE_URL": objects.new_place()}
        environment = {**objects.credentials, "FORWARDED_ALLOW_IPS": "127.0.0.1"}
        apis = [
            RunningService(home / name, {**settings, "WORKERS": workers}, environment=environment)
            for name, workers in (("here", "1"), ("there", "0"))
        ]
        for api in apis:
            api.start()
        port = free_port()
        variables = {
            "PROXY_SITE": f":{port}",
            "PROXY_APIS": " ".join(api.url.removeprefix("http://") for api in apis),
            "PROXY_HEALTH": str(free_port()),
            "XDG_DATA_HOME": str(home / "caddy"),
            "XDG_CONFIG_HOME": str(home / "caddy"),
        }
        with (home / "caddy.log").open("wb") as log:
            caddy = subprocess.Popen(
                ["caddy", "run", "--config", str(CADDYFILE), "--adapter", "caddyfile"],
                env={**os.environ, **variables},
                stderr=log,
            )
        proxy = RunningService(apis[0].home, url=f"http://127.0.0.1:{port}")
        proxy.http = httpx.Client(base_url=proxy.url, timeout=600.0)
        try:
            wait_until(lambda: answers(proxy), 60.0)
            yield Proxied(proxy, apis)
        finally:
            proxy.http.close()
            caddy.terminate()
            caddy.wait(20.0 * patience())
            for api in apis:
                api.stop()


def answers(proxy: RunningService) -> bool:
    with suppress(httpx.TransportError):
        return proxy.http.get("/readyz").status_code == httpx.codes.OK
    return False


def test_links_name_the_proxy(service: Proxied) -> None:
    links = service.proxy.http.get("/").json()["links"]
    assert {httpx.URL(link["href"]).port for link in links} == {httpx.URL(service.proxy.url).port}


def test_requests_are_answered_while_an_api_process_is_killed(service: Proxied) -> None:
    job = service.proxy.execute("echo", {"stringInput": "anybody"}, Prefer="respond-async")
    assert service.proxy.result(job) == {"stringInput": "anybody"}
    killed = [psutil.Process(api.pid) for api in service.apis[1].apis()]
    for api in killed:
        api.kill()
    statuses = {service.proxy.http.get(f"/jobs/{job}").status_code for _ in range(100)}
    # one that was under way may break; the next goes to the other process
    assert statuses <= {200, 502}
    wait_until(lambda: service.apis[1].apis() != [])
    assert service.proxy.http.get(f"/jobs/{job}").status_code == 200


def test_events_pass_at_once(service: Proxied) -> None:
    job = service.proxy.execute("echo", {"stringInput": "wait", "pause": 2}, Prefer="respond-async")
    with service.proxy.http.stream("GET", f"/jobs/{job}/events") as events:
        kinds = [line for line in events.iter_lines() if line.startswith("event:")]
    assert kinds[0] == "event: status"
    assert len(kinds) > 1


def test_an_upload_in_pieces_goes_on_where_it_began(service: Proxied, tmp_path: Path) -> None:
    path = write_scan(tmp_path / "scan.las", 30 << 20)
    upload = begun(service.proxy, path)
    assert start_sender(service.proxy, upload, path, "tuspy").wait(120.0 * patience()) == 0
    assert finished(service.proxy, upload)["bytes"] == path.stat().st_size
