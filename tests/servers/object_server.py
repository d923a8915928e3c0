"""An object store of one's own for tests: a server that speaks S3, in this process, on a free port."""

import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from secrets import token_hex

import httpx
import pytest
from moto.server import ThreadedMotoServer

CREDENTIALS = {"AWS_ACCESS_KEY_ID": "tieline", "AWS_SECRET_ACCESS_KEY": "secret", "AWS_DEFAULT_REGION": "us-east-1"}


class ObjectServer:
    """The server; what it keeps goes with it."""

    def __init__(self) -> None:
        self._server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
        logging.getLogger("werkzeug").setLevel(logging.ERROR)
        self._server.start()
        host, port = self._server.get_host_and_port()
        self.endpoint = f"http://{host}:{port}"

    def new_place(self) -> str:
        """Make a bucket; give the address of a folder in it, as the service's settings take it."""
        bucket = f"tieline-{token_hex(4)}"
        httpx.put(f"{self.endpoint}/{bucket}", timeout=60.0).raise_for_status()  # the first loads the server
        return f"s3://{bucket}/some/folder?endpoint={self.endpoint}"

    @property
    def credentials(self) -> Mapping[str, str]:
        """Give the variables by which clients are let in."""
        return CREDENTIALS

    def stop(self) -> None:
        self._server.stop()


@contextmanager
def object_server() -> Iterator[ObjectServer]:
    server = ObjectServer()
    try:
        yield server
    finally:
        server.stop()


@pytest.fixture(scope="session")
def objects() -> Iterator[ObjectServer]:
    """Run one server for all tests that do not stop it."""
    with object_server() as server:
        yield server
