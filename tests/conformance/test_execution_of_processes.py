"""Conformance class core: jobs and executions, as the class Jobs of `ets-ogcapi-processes10` tests them."""

import json
from email import message_from_bytes
from typing import Any

import pytest

from tests.conformance.conftest import Server
from tests.conformance.official_schemas import assert_valid
from tests.conformance.suite_inputs import BOX, TEXT, array_input, formatted_inputs, request, usual_inputs

Document = dict[str, Any]
NOT_READY = "http://www.opengis.net/def/exceptions/ogcapi-processes-1/1.0/result-not-ready"
RESULTS = "http://www.opengis.net/def/rel/ogc/1.0/results"


def usual(echo: Document, *outputs: str, **more: Any) -> Document:
    return request(echo, usual_inputs(echo), *outputs, **more)


def link(document: Document, rel: str) -> str:
    (found,) = [each["href"] for each in document["links"] if each["rel"] == rel]
    return str(found)


def test_the_suite_finds_an_input_that_it_can_send(echo: Document) -> None:
    assert usual_inputs(echo)["stringInput"] == TEXT
    assert usual_inputs(echo)["boundingBoxInput"] == BOX


def test_job_creation_auto_execution_mode(server: Server, echo: Document) -> None:
    answer = server.execute(usual(echo), Prefer="respond-async")
    assert answer.status_code == 201
    assert answer.headers["preference-applied"] == "respond-async"


def test_job_creation_auto_execution_mode_only_asynchronous(server: Server) -> None:
    answer = server.execute({"inputs": {}}, process="register", Prefer="respond-sync")
    assert answer.status_code == 400  # bad inputs, and not a refusal of the preference


@pytest.mark.parametrize("preference", [{}, {"Prefer": "respond-sync"}, {"Prefer": "wait=5"}])
def test_job_creation_default_execution_mode(server: Server, echo: Document, preference: dict[str, str]) -> None:
    assert server.execute(usual(echo), **preference).status_code == 200


def test_job_creation_default_outputs(server: Server, echo: Document) -> None:
    answer = server.execute({"inputs": usual_inputs(echo)})
    assert answer.status_code == 200
    assert set(answer.json()) == set(usual_inputs(echo))


def test_job_creation_input_array(server: Server, echo: Document) -> None:
    inputs = usual_inputs(echo) | array_input(echo)
    assert server.execute(request(echo, inputs)).status_code == 200


def test_job_creation_input_inline_bbox(server: Server, echo: Document) -> None:
    box = {"bbox": [51.9, 7, 52, 7.1], "crs": "http://www.opengis.net/def/crs/OGC/1.3/CRS84"}
    answer = server.execute(request(echo, usual_inputs(echo) | {"boundingBoxInput": box}))
    assert answer.status_code == 200
    assert answer.json()["boundingBoxInput"] == box


def test_job_creation_input_inline_object_and_mixed(server: Server, echo: Document) -> None:
    answer = server.execute(usual(echo))
    assert answer.status_code == 200
    assert answer.json()["stringInput"] == TEXT


def test_job_creation_input_validation(server: Server, echo: Document) -> None:
    wrong = formatted_inputs(echo)
    assert wrong, "the suite would skip this test"
    for name in wrong:
        answer = server.execute(request(echo, usual_inputs(echo) | {name: {"type": "wrong/type_1"}}))
        assert answer.status_code == 400
        assert answer.headers["content-type"] == "application/json"
        assert_valid("exception", answer.json())
        assert any(fault["pointer"].startswith(f"/inputs/{name}") for fault in answer.json()["errors"])


def test_job_creation_op_and_success_async(server: Server, echo: Document) -> None:
    answer = server.execute(usual(echo), Prefer="wait=1, Respond-Async ; x")
    assert answer.status_code == 201
    assert_valid("statusInfo", answer.json())
    status = server.get(answer.headers["location"])
    assert status.status_code == 200
    assert_valid("statusInfo", status.json())
    assert status.json()["jobID"] == answer.json()["jobID"]


def test_job_creation_sync_document(server: Server, echo: Document) -> None:
    answer = server.execute(usual(echo, response="document"))
    assert (answer.status_code, answer.headers["content-type"]) == (200, "application/json")


def test_job_creation_sync_raw_value_one(server: Server, echo: Document) -> None:
    answer = server.execute(usual(echo, "stringInput", response="raw"))
    assert (answer.status_code, answer.text) == (200, TEXT)


def parts_of(kind: str, content: bytes) -> dict[str, str]:
    message = message_from_bytes(b"Content-Type: " + kind.encode() + b"\r\n\r\n" + content)
    return {part["Content-ID"]: str(part.get_payload()) for part in message.walk() if part is not message}


def test_job_creation_sync_raw_value_multi(server: Server, echo: Document) -> None:
    answer = server.execute(usual(echo, response="raw"))
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith("multipart/related")
    parts = parts_of(answer.headers["content-type"], answer.content)
    assert set(parts) == set(usual_inputs(echo))
    assert parts["stringInput"] == TEXT


def test_references_are_not_offered_and_refused(server: Server, echo: Document) -> None:
    assert echo["outputTransmission"] == ["value"]
    answer = server.execute(
        {"inputs": usual_inputs(echo), "outputs": {"stringInput": {"transmissionMode": "reference"}}}
    )
    assert answer.status_code == 400


def test_job_results_failed_is_a_problem(server: Server) -> None:
    answer = server.execute({"invalid-execute-request": "true)"})
    assert answer.status_code == 400
    assert_valid("exception", answer.json())


def test_job_results_exception_results_not_ready(server: Server, echo: Document) -> None:
    job = server.job(request(echo, {"stringInput": TEXT, "pause": 5}, "stringInput", response="raw"))
    answer = server.get(f"/jobs/{job.json()['jobID']}/results")
    assert answer.status_code == 404
    assert answer.json()["type"] == NOT_READY
    assert_valid("exception", answer.json())
    assert server.delete(f"/jobs/{job.json()['jobID']}").status_code == 200


def test_a_job_that_is_not_finished_says_where_to_ask_again(server: Server, echo: Document) -> None:
    status = server.job(request(echo, {"stringInput": TEXT, "pause": 5})).json()
    again = server.get(link(status, "monitor"))
    assert again.headers["content-type"] == "application/json"
    assert_valid("statusInfo", again.json())
    server.delete(f"/jobs/{status['jobID']}")


def test_job_results_async_document(server: Server, echo: Document) -> None:
    status = server.finished(usual(echo, response="document"))
    assert_valid("statusInfo", status)
    answer = server.get(link(status, RESULTS))
    assert (answer.status_code, answer.headers["content-type"]) == (200, "application/json")
    assert answer.json() == server.execute(usual(echo)).json()


def test_job_results_async_raw_value_one(server: Server, echo: Document) -> None:
    status = server.finished(usual(echo, "stringInput", response="raw"))
    assert server.get(link(status, RESULTS)).text == TEXT


def test_job_results_async_raw_value_multi(server: Server, echo: Document) -> None:
    answer = server.get(link(server.finished(usual(echo, response="raw")), RESULTS))
    parts = parts_of(answer.headers["content-type"], answer.content)
    assert set(parts) == set(usual_inputs(echo))
    assert json.loads(parts["boundingBoxInput"]) == BOX
