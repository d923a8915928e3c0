"""Requests that are made to cost much, or to confuse: each is refused, quickly, with what is wrong."""

import json
import threading
import time
from collections.abc import Iterator
from typing import Any

import httpx
import pytest

from service.routes.request_bodies import MOST_PARTS
from service.use_cases.inputs.validate_request import MOST_FAULTS, MOST_MEMBERS
from tests.api.conftest import Client

LONGEST_CPU_S = 5.0
"""Of this process, which is client and service at once."""


@pytest.fixture(autouse=True)
def _quickly() -> Iterator[None]:
    begun = time.process_time()
    yield
    assert time.process_time() - begun < LONGEST_CPU_S


def execute(client: Client, body: bytes, process: str = "register", **headers: str) -> httpx.Response:
    return client.post(f"/processes/{process}/execution", content=body, headers=headers)


def refused(answer: httpx.Response, status: int = 400) -> dict[str, Any]:
    assert answer.status_code == status, answer.text[:500]
    assert answer.headers["content-type"] == "application/problem+json"
    assert len(answer.content) < 1_000_000
    return dict(answer.json())


JSON_BOMBS = {
    "deep arrays": b"[" * 5_000_000,
    "deep objects": b'{"a":' * 1_000_000,
    "a number of a million digits": b'{"inputs": ' + b"1" * 1_000_000 + b"}",
    "a huge exponent": b'{"inputs": 1e' + b"9" * 100_000 + b"}",
    "infinity": b'{"inputs": Infinity}',
    "minus infinity": b'{"inputs": -Infinity}',
    "NaN": b'{"inputs": {"stations": NaN}}',
    "a lone surrogate": b'{"inputs": "\\ud800"}',
    "bytes that are no UTF-8": b'{"inputs": "\xff\xfe"}',
    "UTF-16": '{"inputs": {}}'.encode("utf-16"),
    "a byte order mark": b'\xef\xbb\xbf{"inputs": {}}',
    "two documents": b'{"inputs": {}}{"inputs": {}}',
    "a comment": b'{"inputs": {}} // none',
    "zero bytes": bytes(1000),
    "three million stations": b'{"inputs": {"stations": [' + b"{}," * 3_000_000 + b"{}]}}",
    "many unknown fields": b"{" + b",".join(b'"%d":0' % number for number in range(300_000)) + b"}",
    "three million empty lists": b'{"inputs": {"stations": [' + b"[]," * 3_000_000 + b"[]]}}",
    "lists of lists of lists": b'{"inputs": ' + b"[" + b",".join([b"[[[[]]]]"] * 900_000) + b"]}",
    "lists in a form that fits": b'{"inputs": {"stations": [' + b"[[0]]," * 60_000 + b"[]]}}",
    "33 levels": b'{"inputs": ' + b"[" * 32 + b"]" * 32 + b"}",
    "a field of nine megabytes": b'{"inputs": {"' + b"n" * 9_000_000 + b'": 0}}',
    "a name of nine megabytes": b'{"inputs": {"stations": [{"name": "' + b"n" * 9_000_000 + b'"}]}}',
    "a method of nine megabytes": b'{"inputs": {"method": {"method": "' + b"n" * 9_000_000 + b'"}}}',
    "many long fields": b'{"inputs": {' + b",".join(b'"%d%s":0' % (k, b"n" * 9000) for k in range(900)) + b"}}",
    "a million equal fields": b"{" + b'"inputs":0,' * 800_000 + b'"inputs":{}}',
}


@pytest.mark.parametrize("which", JSON_BOMBS)
def test_a_bomb_of_json_is_refused(client: Client, which: str) -> None:
    assert refused(execute(client, JSON_BOMBS[which]))["errors"]


def test_as_deep_as_allowed_is_read(client: Client) -> None:
    body = b'{"inputs": {"featureCollectionInput": {"type": "FeatureCollection", "features": [{"a": %s}]}}}'
    allowed = body % (b"[" * 27 + b"]" * 27)
    assert execute(client, allowed, "echo").status_code == 200
    assert "nested" in refused(execute(client, body % (b"[" * 28 + b"]" * 28), "echo"))["detail"]


def test_others_are_answered_while_a_document_is_parsed(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[bool] = []

    def parsed(_body: bytes, _pointer: str = "") -> Any:
        seen.append(threading.current_thread() is threading.main_thread())
        return {"inputs": {"stringInput": "a"}}

    monkeypatch.setattr("service.use_cases.jobs.read_request.parse_json", parsed)
    assert execute(client, b"{}", "echo").status_code == 200
    assert seen == [False]


def test_more_json_than_a_request_may_have_is_too_large(client: Client) -> None:
    refused(execute(client, b'{"inputs": {"stringInput": "' + b"a" * 10_000_001 + b'"}}', "echo"), 413)


@pytest.mark.parametrize("number", [MOST_FAULTS + 1, MOST_MEMBERS])
def test_very_many_faults_are_counted_and_not_listed(client: Client, number: int) -> None:
    body = json.dumps({"inputs": {"arrayInput": ["a"] * number}}).encode()
    problem = refused(execute(client, body, "echo"))
    assert problem["errors"] == [{"pointer": "", "detail": f"{number} fields of the request are wrong"}]


def test_as_many_faults_as_can_be_listed_are(client: Client) -> None:
    body = json.dumps({"inputs": {"arrayInput": ["a"] * MOST_FAULTS}}).encode()
    assert len(refused(execute(client, body, "echo"))["errors"]) == MOST_FAULTS


def test_the_longest_list_that_there_is_use_for_is_read(client: Client) -> None:
    body = json.dumps({"inputs": {"arrayInput": list(range(MOST_MEMBERS))}}).encode()
    assert execute(client, body, "echo").status_code == 200


@pytest.mark.parametrize("kind", ["text/xml", "application/json; charset=utf-7", "", "x" * 5000, "\x00"])
def test_what_a_json_body_calls_itself_does_not_matter(client: Client, kind: str) -> None:
    answer = execute(client, b'{"inputs": {"stringInput": "a"}}', "echo", **{"Content-Type": kind})
    assert answer.json() == {"stringInput": "a"}


@pytest.mark.parametrize("accept", ["", "image/png", "*/*;q=0", "application/json;q=x", "," * 5000])
def test_whatever_a_client_accepts_it_is_answered(client: Client, accept: str) -> None:
    answer = client.get("/jobs", headers={"Accept": accept})
    assert (answer.status_code, answer.headers["content-type"]) == (200, "application/json")


def test_a_flood_of_headers_does_no_harm(client: Client) -> None:
    headers = [(f"X-{number}", "v" * 50) for number in range(5000)] + [("Prefer", "respond-async, " * 2000)]
    answer = client.post("/processes/echo/execution", json={"inputs": {"stringInput": "a"}}, headers=headers)
    assert answer.status_code == 201


def form_of(part: bytes, number: int) -> bytes:
    return b"".join(b"--x\r\n" + part + b"\r\n" for _ in range(number)) + b"--x--\r\n"


FIELD = b'Content-Disposition: form-data; name="note"\r\n\r\na'
EMPTY_FILE = b'Content-Disposition: form-data; name="file"; filename="a.ply"\r\n\r\n'
FORMS = {
    "twenty thousand fields": form_of(FIELD, 20_000),
    "twenty thousand empty files": form_of(EMPTY_FILE, 20_000),
    "a part of twenty thousand headers": b"--x\r\n"
    + b"".join(b"h%d: v\r\n" % k for k in range(100_000))
    + b"\r\na\r\n--x--\r\n",
    "a header of five megabytes": b"--x\r\nContent-Disposition: " + b"a" * 5_000_000 + b"\r\n\r\na\r\n--x--\r\n",
    "a name of a megabyte": form_of(b'Content-Disposition: form-data; name="' + b"n" * 1_000_000 + b'"\r\n\r\na', 1),
    "only boundaries": b"--x\r\n" * 20_000,
    "an end and no begin": b"--x--\r\n",
    "nothing but line ends": b"\r\n" * 200_000,
}


@pytest.mark.parametrize("path", ["/files", "/registrations"])
@pytest.mark.parametrize("which", FORMS)
def test_a_hostile_form_is_refused(client: Client, path: str, which: str) -> None:
    answer = client.post(path, content=FORMS[which], headers={"Content-Type": "multipart/form-data; boundary=x"})
    assert answer.status_code in {400, 413}, answer.text[:300]
    assert answer.headers["content-type"] == "application/problem+json"
    assert client.get("/files").json()["numberMatched"] == 0


def test_more_small_files_than_a_form_may_have_leave_nothing(client: Client) -> None:
    whole = form_of(EMPTY_FILE + b"1 2 3", MOST_PARTS + 1)
    answer = client.post("/files", content=whole, headers={"Content-Type": "multipart/form-data; boundary=x"})
    assert "parts" in refused(answer)["detail"]
    assert client.get("/files").json()["numberMatched"] == 0


PATHS = (
    "/jobs/..%2f..%2fetc%2fpasswd",
    "/jobs/%2e%2e/%2e%2e/etc/passwd",
    "/jobs/none/artifacts/..%2f..%2f..%2fetc%2fpasswd",
    "/jobs/none/artifacts/%00",
    "/files/..%5c..%5cetc%5cpasswd",
    "/files/%F0%9F%94%A5",
    "/files/" + "a" * 20_000,
    "/uploads/..%2fx",
    "/processes/..%2fecho",
    "/processes/%ED%A0%80",
    "//etc/passwd",
    "/jobs/%",
    "/%2e%2e/%2e%2e/etc/passwd",
)


@pytest.mark.parametrize("path", PATHS)
def test_a_path_leads_nowhere_but_to_resources(client: Client, path: str) -> None:
    assert "root:" not in refused(client.get(path), 404)["detail"]
