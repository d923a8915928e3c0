"""The object store: what contract tests of all stores do not cover."""

import hashlib
import json
import re
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path

import httpx
import obstore
import pytest
from botocore.auth import S3SigV4Auth
from botocore.awsrequest import AWSRequest
from botocore.credentials import Credentials

from service.adapters.files.object_files import ObjectFiles, ObjectStoreAddress
from service.adapters.files.object_uploads import EMPTY, Signer
from service.errors import StorageError
from service.settings import Settings
from tests.servers.object_server import ObjectServer, object_server

pytestmark = pytest.mark.service

CONTENT = b"1 2 3\n" * 1000
SHA256 = hashlib.sha256(CONTENT).hexdigest()


@pytest.fixture(autouse=True)
def _credentials(objects: ObjectServer, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in objects.credentials.items():
        monkeypatch.setenv(name, value)


@pytest.fixture
def place(objects: ObjectServer) -> str:
    return objects.new_place()


def machine(place: str, directory: Path) -> ObjectFiles:
    return ObjectFiles(Settings(data_dir=directory, storage_url=place))


STREAMING = """
import asyncio, hashlib, json, resource, sys
from pathlib import Path
from service.adapters.files.object_files import ObjectFiles
from service.settings import Settings

async def chunks(count):
    for _ in range(count):
        yield bytes(1 << 20)

here, there = (ObjectFiles(Settings(data_dir=Path(sys.argv[2]) / n, storage_url=sys.argv[1])) for n in ("a", "b"))
peaks = []
for count in (10, 150):
    size, digest = asyncio.run(here.write_stream(f"jobs/1/{count}", chunks(count), 1 << 40))
    with there.local_path(f"jobs/1/{count}").open("rb") as file:
        same = digest == hashlib.file_digest(file, "sha256").hexdigest()
    peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
print(json.dumps([*peaks, same]))
"""


def test_an_address_says_where_the_store_is() -> None:
    address = ObjectStoreAddress.parsed("s3://bucket/a/b?endpoint=https://host:9000&region=eu-1&addressing=virtual")
    assert address == ObjectStoreAddress("bucket", "a/b", "https://host:9000", "eu-1", "virtual")


@pytest.mark.parametrize("url", ["s3:///folder", "gs://bucket", "s3://bucket?secret=1"])
def test_an_address_that_is_none_is_refused(url: str) -> None:
    with pytest.raises(StorageError):
        ObjectStoreAddress.parsed(url)


def test_what_one_machine_stores_another_reads(place: str, tmp_path: Path) -> None:
    here, there = machine(place, tmp_path / "here"), machine(place, tmp_path / "there")
    here.write_bytes("incoming/a", CONTENT)
    here.move("incoming/a", f"files/{SHA256}")
    assert there.local_path(f"files/{SHA256}").read_bytes() == CONTENT


def test_what_is_removed_on_one_machine_is_not_found_on_another_that_has_a_copy(place: str, tmp_path: Path) -> None:
    here, there = machine(place, tmp_path / "here"), machine(place, tmp_path / "there")
    here.write_bytes("jobs/1/result.json", b"{}")
    there.local_path("jobs/1/result.json")
    here.delete_prefix("jobs/1/")
    with pytest.raises(FileNotFoundError):
        there.local_path("jobs/1/result.json")


def test_what_is_replaced_is_read_anew(place: str, tmp_path: Path) -> None:
    here, there = machine(place, tmp_path / "here"), machine(place, tmp_path / "there")
    read = []
    for content in (b"old", b"new"):
        here.write_bytes("jobs/1/result.json", content)
        read.append(there.local_path("jobs/1/result.json").read_bytes())
    assert read == [b"old", b"new"]


def test_a_content_that_is_stored_is_not_sent_again(place: str, tmp_path: Path) -> None:
    blobs = machine(place, tmp_path)
    written = []
    for key in ("incoming/a", "incoming/b"):
        blobs.write_bytes(key, CONTENT)
        blobs.prepare_move(key, f"files/{SHA256}")
        written.append(obstore.head(blobs._store, f"files/{SHA256}")["last_modified"])
        blobs.move(key, f"files/{SHA256}")
    assert (written[0], blobs.keys("")) == (written[1], [f"files/{SHA256}"])


def test_a_damaged_content_is_not_handed_out(place: str, tmp_path: Path) -> None:
    blobs = machine(place, tmp_path)
    obstore.put(blobs._store, f"files/{SHA256}", b"9" + CONTENT[1:])
    with pytest.raises(StorageError, match="damaged"):
        blobs.local_path(f"files/{SHA256}")


def test_uploads_that_were_not_finished_are_removed_in_time_and_those_of_others_stay(
    place: str, objects: ObjectServer, tmp_path: Path
) -> None:
    blobs = machine(place, tmp_path)
    bucket = f"{objects.endpoint}/{ObjectStoreAddress.parsed(place).bucket}"
    for key in ("some/folder/files/half", "elsewhere/half"):
        httpx.post(f"{bucket}/{key}?uploads").raise_for_status()
    # to this server, all uploads began in 2010
    removed = [blobs.remove_abandoned(datetime(year, 1, 1, tzinfo=UTC)) for year in (2009, 2012)]
    left = re.findall("<Key>(.*?)</Key>", httpx.get(f"{bucket}?uploads").text)
    assert (removed, left) == ([0, 1], ["elsewhere/half"])


def test_requests_are_signed_as_amazon_s_own_library_signs_them() -> None:
    url = "https://host:9000/bucket/some/folder/half%20done"
    theirs = AWSRequest("DELETE", f"{url}?uploadId=a%2Fb", headers={"x-amz-content-sha256": EMPTY})
    S3SigV4Auth(Credentials("id", "secret", "token"), "s3", "eu-1").add_auth(theirs)
    moment = datetime.strptime(theirs.context["timestamp"], "%Y%m%dT%H%M%SZ").replace(tzinfo=UTC)
    ours = Signer("id", "secret", "token", "eu-1").signed("DELETE", url, {"uploadId": "a/b"}, moment)
    assert ours.headers["authorization"] == theirs.headers["Authorization"]


def test_a_store_that_cannot_be_reached_is_the_service_s_fault(tmp_path: Path) -> None:
    with object_server() as server:
        blobs = machine(server.new_place(), tmp_path)
        blobs.write_bytes("jobs/1/a", b"")
    with pytest.raises(StorageError, match="cannot be used"):
        blobs.exists("jobs/1/a")


def test_a_large_stream_and_its_copy_take_little_memory(place: str, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", STREAMING, place, str(tmp_path)], capture_output=True, text=True, check=True
    )
    small, large, same = json.loads(done.stdout)
    assert same
    # parts on their way: 3 of 8 MB and those of the library; a piece of 16 MB on the way back
    assert large - small < 70_000, "kB more for 150 MB than for 10 MB"
