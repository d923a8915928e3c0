"""One running service that may fetch from, and tell, servers of this machine: for all tests of either."""

from collections.abc import Iterator

import pytest

from tests.e2e.running.file_server import FileServer, serving_files
from tests.e2e.running.running_service import RunningService
from tests.servers.object_server import ObjectServer

SECRET = "whsec_" + "MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw"


@pytest.fixture(scope="session")
def elsewhere() -> Iterator[FileServer]:
    with serving_files() as server:
        yield server


@pytest.fixture(scope="session")
def bucket(objects: ObjectServer) -> str:
    """Give a folder in an object store, as the settings take it."""
    return objects.new_place()


@pytest.fixture(scope="session")
def reaching(
    tmp_path_factory: pytest.TempPathFactory, elsewhere: FileServer, bucket: str, objects: ObjectServer
) -> Iterator[RunningService]:
    settings = {
        "SLOTS": "2",
        "MAX_ATTEMPTS": "5",
        "MAX_FILE_BYTES": "50000000",
        "ALLOWED_SOURCES": f"{elsewhere.url}/, {bucket}",
        "ALLOW_PRIVATE_SOURCES": "true",
        "ALLOW_PRIVATE_CALLBACKS": "true",
        "CALLBACK_PORTS": "",
        "CALLBACK_SECRET": SECRET,
        "CALLBACK_BACK_OFF_S": "0.5",
        "CALLBACK_ATTEMPTS": "4",
        "CALLBACK_INTERVAL_S": "0.5",
    }
    service = RunningService(tmp_path_factory.mktemp("reaching"), settings, objects.credentials)
    service.start()
    yield service
    service.stop()
