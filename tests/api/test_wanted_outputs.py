"""Some outputs only, or raw ones (OGC API - Processes 1.0, 7.11.4 and 7.13)."""

import json
from email import message_from_bytes
from email.message import Message
from typing import Any

import httpx
import pytest

from service.dependencies import Adapters
from tests.api.conftest import Client
from tests.doubles.memory import MemoryBlobStore

INPUTS = {"stringInput": "Zoë", "doubleInput": 2.5, "arrayInput": [1, 2]}


def executed(client: Client, adapters: Adapters, *, asynchronous: bool, **request: Any) -> httpx.Response:
    """Give the answer to an execution, or to the question for the results of its job."""
    body = {"inputs": INPUTS, **request}
    headers = {"Prefer": "respond-async"} if asynchronous else {}
    answer = client.post("/processes/echo/execution", json=body, headers=headers)
    if not asynchronous:
        return answer
    job = answer.json()["jobID"]
    assert isinstance(adapters.blobs, MemoryBlobStore)
    stored = adapters.jobs.get(job)
    assert stored is not None
    adapters.blobs.write_bytes(f"jobs/{job}/result.json", json.dumps(stored.inputs).encode())
    adapters.jobs.start(job, stored.created)
    adapters.jobs.succeed(job, stored.created)
    return client.get(f"/jobs/{job}/results")


@pytest.fixture(params=[False, True], ids=["at once", "as a job"])
def asynchronous(request: pytest.FixtureRequest) -> bool:
    return bool(request.param)


def test_all_outputs_come_when_none_are_named(client: Client, adapters: Adapters, asynchronous: bool) -> None:
    for request in ({}, {"outputs": {}}, {"outputs": None}):
        answer = executed(client, adapters, asynchronous=asynchronous, **request)
        assert (answer.status_code, answer.json()) == (200, INPUTS)


def test_only_the_named_outputs_come(client: Client, adapters: Adapters, asynchronous: bool) -> None:
    answer = executed(client, adapters, asynchronous=asynchronous, outputs={"doubleInput": {}})
    assert answer.json() == {"doubleInput": 2.5}
    assert answer.headers["content-type"] == "application/json"


@pytest.mark.parametrize(
    ("name", "kind", "content"),
    [
        ("stringInput", "text/plain; charset=utf-8", "Zoë".encode()),
        ("doubleInput", "application/json", b"2.5"),
        ("arrayInput", "application/json", b"[1,2]"),
    ],
)
def test_a_raw_output_comes_bare(
    client: Client, adapters: Adapters, asynchronous: bool, name: str, kind: str, content: bytes
) -> None:
    answer = executed(client, adapters, asynchronous=asynchronous, outputs={name: {}}, response="raw")
    assert (answer.headers["content-type"], answer.content) == (kind, content)


def test_several_raw_outputs_are_parts_named_by_their_content_id(
    client: Client, adapters: Adapters, asynchronous: bool
) -> None:
    answer = executed(client, adapters, asynchronous=asynchronous, response="raw")
    kind = answer.headers["content-type"]
    assert kind.startswith("multipart/related; boundary=")
    message = message_from_bytes(b"Content-Type: " + kind.encode() + b"\r\n\r\n" + answer.content)
    assert {part["Content-ID"]: _value(part) for part in message.walk() if part is not message} == INPUTS


def test_an_output_without_a_value_is_no_content(client: Client, adapters: Adapters, asynchronous: bool) -> None:
    answer = executed(client, adapters, asynchronous=asynchronous, outputs={"booleanInput": {}}, response="raw")
    assert (answer.status_code, answer.content) == (204, b"")


def _value(part: Message) -> Any:
    content = part.get_payload(decode=True)
    assert isinstance(content, bytes)
    return content.decode() if part.get_content_type() == "text/plain" else json.loads(content)
