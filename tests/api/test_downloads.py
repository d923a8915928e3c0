"""Downloads: ranges and conditions of RFC 9110."""

from datetime import UTC, datetime, timedelta
from email import message_from_bytes

import pytest

from service.dependencies import Adapters
from service.ports import Job, JobStatus
from service.routes.downloads import satisfiable_ranges
from tests.api.conftest import Client
from tests.doubles.memory import MemoryBlobStore

CONTENT = bytes(range(200))
NOW = datetime(2026, 1, 31, 12, tzinfo=UTC)
MADE = "Sat, 31 Jan 2026 12:00:03 GMT"


@pytest.fixture
def artifact(adapters: Adapters) -> str:
    """Give the address of a download of 200 bytes."""
    job = Job("job0", "echo", {}, JobStatus.ACCEPTED, NOW, updated=NOW)
    adapters.jobs.create_and_enqueue(job)
    adapters.jobs.start(job.id, NOW)
    adapters.jobs.succeed(job.id, NOW + timedelta(seconds=3))
    assert isinstance(adapters.blobs, MemoryBlobStore)
    adapters.blobs.write_bytes("jobs/job0/artifacts/lines.ply", CONTENT)
    adapters.blobs.write_bytes("jobs/job0/result.json", b'{"stringInput": "a"}')
    return "/jobs/job0/artifacts/lines.ply"


@pytest.mark.parametrize(
    ("asked", "expected"),
    [
        ("bytes=0-9", (0, 10)),
        ("bytes=190-", (190, 200)),
        ("bytes=-10", (190, 200)),
        ("bytes=-1000", (0, 200)),
        ("bytes=190-1000", (190, 200)),
        ("Bytes = 5-5", (5, 6)),
        ("bytes=500-600,3-4", (3, 5)),
    ],
)
def test_a_range_is_given(client: Client, artifact: str, asked: str, expected: tuple[int, int]) -> None:
    answer = client.get(artifact, headers={"Range": asked})
    first, end = expected
    assert (answer.status_code, answer.content) == (206, CONTENT[first:end])
    assert answer.headers["content-range"] == f"bytes {first}-{end - 1}/200"
    assert answer.headers["content-length"] == str(end - first)


def test_several_ranges_come_as_parts(client: Client, artifact: str) -> None:
    answer = client.get(artifact, headers={"Range": "bytes=0-1,100-101"})
    assert answer.status_code == 206
    kind = answer.headers["content-type"]
    assert kind.startswith("multipart/byteranges")
    whole = message_from_bytes(b"Content-Type: " + kind.encode() + b"\r\n\r\n" + answer.content)
    assert [part["Content-Range"] for part in whole.walk() if part is not whole] == [
        "bytes 0-1/200",
        "bytes 100-101/200",
    ]


@pytest.mark.parametrize("asked", ["bytes=200-", "bytes=500-600", "bytes=200-300,400-", "bytes=-0"])
def test_a_range_beyond_the_end_is_refused_with_the_length(client: Client, artifact: str, asked: str) -> None:
    answer = client.get(artifact, headers={"Range": asked})
    assert (answer.status_code, answer.headers["content-range"]) == (416, "bytes */200")
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.json()["status"] == 416


@pytest.mark.parametrize(
    "asked",
    ["", "bytes", "bytes=", "bytes=a-b", "bytes=5-2", "bytes=-", "lines=1-2", "bytes=1-2,x", "bytes=" + "0-0," * 200],
)
def test_what_is_no_range_is_ignored(client: Client, artifact: str, asked: str) -> None:
    answer = client.get(artifact, headers={"Range": asked})
    assert (answer.status_code, answer.content) == (200, CONTENT)


def test_a_range_is_given_only_of_what_the_client_has(client: Client, artifact: str) -> None:
    whole = client.get(artifact)
    for condition in (whole.headers["etag"], MADE):
        assert client.get(artifact, headers={"Range": "bytes=0-1", "If-Range": condition}).status_code == 206
    for condition in ('"other"', f"W/{whole.headers['etag']}", "Sat, 31 Jan 2026 12:00:04 GMT"):
        answer = client.get(artifact, headers={"Range": "bytes=0-1", "If-Range": condition})
        assert (answer.status_code, answer.content) == (200, CONTENT)


def test_head_tells_what_get_would_and_knows_no_ranges(client: Client, artifact: str) -> None:
    whole, head = client.get(artifact), client.request("HEAD", artifact, headers={"Range": "bytes=0-1"})
    assert (head.status_code, head.content) == (200, b"")
    for name in ("content-length", "content-type", "etag", "last-modified", "accept-ranges", "content-disposition"):
        assert head.headers[name] == whole.headers[name]
    assert (whole.headers["accept-ranges"], whole.headers["last-modified"]) == ("bytes", MADE)


def test_what_the_client_has_is_not_sent_again(client: Client, artifact: str) -> None:
    tag = client.get(artifact).headers["etag"]
    for known in (tag, f"W/{tag}", f'"other", {tag}', "*"):
        answer = client.get(artifact, headers={"If-None-Match": known})
        assert (answer.status_code, answer.content, answer.headers["etag"]) == (304, b"", tag)
    assert client.get(artifact, headers={"If-None-Match": '"other"'}).status_code == 200


def test_a_file_is_named_by_its_hash_wherever_it_lies(client: Client) -> None:
    document = client.get(f"/files/{client.upload(content=CONTENT)}").json()
    answer = client.get(f"/files/{document['id']}/content")
    assert answer.headers["etag"] == f'"{document["sha256"]}"'


def test_a_result_document_has_ranges_too(client: Client, artifact: str) -> None:
    answer = client.get(f"{artifact.partition('/artifacts')[0]}/results", headers={"Range": "bytes=0-0"})
    assert (answer.status_code, answer.content) == (206, b"{")


def test_nothing_of_an_empty_download_can_be_served() -> None:
    assert satisfiable_ranges("bytes=0-0", 0) == []
    assert satisfiable_ranges("bytes=-5", 0) == []


@pytest.mark.parametrize(
    "path", ["/", "/processes", "/jobs", "/files", "/conformance", "/healthz", "/openapi-3.0.json"]
)
def test_head_answers_wherever_get_does(client: Client, path: str) -> None:
    got, asked = client.get(path), client.request("HEAD", path)
    assert asked.status_code == got.status_code == 200
    assert asked.headers["content-type"] == got.headers["content-type"]
