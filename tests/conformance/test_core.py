"""Conformance class core of OGC API - Processes 1.0: landing page, conformance, processes, problems.

Named after the tests of `ets-ogcapi-processes10` and the abstract tests of 18-062r2, annex A.
"""

from typing import Any
from uuid import uuid4

import pytest

from tests.conformance.conftest import Server
from tests.conformance.official_schemas import assert_valid

OGC = "http://www.opengis.net/def/rel/ogc/1.0/"
EXCEPTIONS = "http://www.opengis.net/def/exceptions/ogcapi-processes-1/1.0/"
CLASS = "http://www.opengis.net/spec/ogcapi-processes-1/1.0/conf/"


def links_of(document: dict[str, Any], rel: str) -> list[str]:
    return [link["href"] for link in document["links"] if link["rel"] == rel]


def test_http_and_landingpage_op(server: Server) -> None:
    answer = server.get("/")
    assert (answer.status_code, answer.http_version) == (200, "HTTP/1.1")
    assert answer.headers["content-type"] == "application/json"


def test_landingpage_success(server: Server) -> None:
    page = server.get("/").json()
    assert_valid("landingPage", page)
    assert links_of(page, "service-desc")
    assert links_of(page, "service-doc")
    assert [server.get(each).status_code for each in links_of(page, OGC + "conformance")] == [200]
    assert [server.get(each).status_code for each in links_of(page, OGC + "processes")] == [200]
    assert [server.get(each).status_code for each in links_of(page, OGC + "job-list")] == [200]


def test_api_definition_op_and_success(server: Server) -> None:
    page = server.get("/").json()
    for rel in ("service-desc", "service-doc"):
        for link in (each for each in page["links"] if each["rel"] == rel):
            answer = server.get(link["href"], Accept="*/*")
            assert answer.status_code == 200
            kind = answer.headers["content-type"].replace(" ", "").removesuffix(";charset=utf-8")
            assert kind == link["type"] or kind == "application/json"


def test_conformance_op_and_success(server: Server) -> None:
    answer = server.get("/conformance")
    assert answer.status_code == 200
    assert_valid("confClasses", answer.json())
    declared = {name.removeprefix(CLASS) for name in answer.json()["conformsTo"]}
    assert {"core", "ogc-process-description", "json", "oas30", "job-list", "dismiss"} <= declared


def test_process_list_op_and_success(server: Server) -> None:
    answer = server.get("/processes")
    assert (answer.status_code, answer.headers["content-type"]) == (200, "application/json")
    assert_valid("processList", answer.json())
    assert "echo" in [process["id"] for process in answer.json()["processes"]]


def test_pl_links(server: Server) -> None:
    document = server.get("/processes").json()
    assert len(links_of(document, "self")) == 1
    for process in document["processes"]:
        assert_valid("processSummary", process)
        assert [server.get(each).json()["id"] for each in links_of(process, "self")] == [process["id"]]
        assert len(links_of(process, OGC + "execute")) == 1


def test_pl_limit_definition(server: Server) -> None:
    parameters = server.get("/openapi-3.0.json").json()["paths"]["/processes"]["get"]["parameters"]
    (limit,) = [each for each in parameters if each["name"] == "limit"]
    assert (limit["in"], limit["required"]) == ("query", False)
    assert (limit["schema"]["type"], limit["schema"]["minimum"]) == ("integer", 1)


@pytest.mark.parametrize("limit", [1, 2, 10, 10_000])
def test_pl_limit_response(server: Server, limit: int) -> None:
    every = server.get("/processes").json()["processes"]
    assert server.get(f"/processes?limit={limit}").json()["processes"] == every[:limit]


def test_pl_pages_hold_every_process_once(server: Server) -> None:
    every = [process["id"] for process in server.get("/processes").json()["processes"]]
    found, addresses = [], ["/processes?limit=1"]
    while addresses:
        page = server.get(addresses[0]).json()
        found += [process["id"] for process in page["processes"]]
        addresses = links_of(page, "next")
    assert found == every


@pytest.mark.parametrize("limit", ["0", "-1", "x", "", "1.5"])
def test_a_wrong_limit_is_a_bad_request(server: Server, limit: str) -> None:
    answer = server.get(f"/processes?limit={limit}")
    assert answer.status_code == 400
    assert_valid("exception", answer.json())


def test_process_op_and_success(server: Server) -> None:
    answer = server.get("/processes/echo")
    assert (answer.status_code, answer.headers["content-type"]) == (200, "application/json")
    assert_valid("process", answer.json())


def test_process_exception_no_such_process(server: Server) -> None:
    wrong = f"invalid-process-{uuid4()}"
    for answer in (server.get(f"/processes/{wrong}"), server.execute({"inputs": {}}, process=wrong)):
        assert answer.status_code == 404
        assert_valid("exception", answer.json())
        assert answer.json()["type"] == EXCEPTIONS + "no-such-process"
        assert answer.headers["content-type"] == "application/json"  # as the suite's Accept asks


@pytest.mark.parametrize("path", ["", "/results"])
def test_job_exception_no_such_job(server: Server, path: str) -> None:
    answer = server.get(f"/jobs/invalid-job-{uuid4()}{path}")
    assert answer.status_code == 404
    assert_valid("exception", answer.json())
    assert answer.json()["type"] == EXCEPTIONS + "no-such-job"
