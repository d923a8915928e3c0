"""Conformance classes job-list and dismiss of OGC API - Processes 1.0."""

from typing import Any

import pytest

from tests.conformance.conftest import Server
from tests.conformance.official_schemas import assert_valid

Document = dict[str, Any]
BODY = {"inputs": {"stringInput": "a"}}


@pytest.fixture
def parameters(server: Server) -> dict[str, Document]:
    described = server.get("/openapi-3.0.json").json()["paths"]["/jobs"]["get"]["parameters"]
    return {each["name"]: each for each in described if each["in"] == "query"}


def test_job_list_op_success_and_links(server: Server) -> None:
    server.job(BODY)
    answer = server.get("/jobs")
    assert (answer.status_code, answer.headers["content-type"]) == (200, "application/json")
    assert_valid("jobList", answer.json())
    assert answer.json()["jobs"]
    assert [link["rel"] for link in answer.json()["links"]].count("self") == 1


def test_process_id_mandatory(server: Server) -> None:
    server.job(BODY)
    assert {job["processID"] for job in server.get("/jobs").json()["jobs"]} == {"echo"}


@pytest.mark.parametrize("name", ["type", "processID", "status"])
def test_list_parameters_are_defined(parameters: dict[str, Document], name: str) -> None:
    assert not parameters[name]["required"]
    assert parameters[name]["schema"]["type"] == "array"
    assert parameters[name]["schema"]["items"] == {"type": "string"}


@pytest.mark.parametrize(("name", "kind"), [("datetime", "string"), ("minDuration", "integer"), ("limit", "integer")])
def test_single_parameters_are_defined(parameters: dict[str, Document], name: str, kind: str) -> None:
    assert not parameters[name]["required"]
    assert parameters[name]["schema"]["type"] == kind


@pytest.mark.parametrize("limit", [1, 2])
def test_limit_response(server: Server, limit: int) -> None:
    for _ in range(3):
        server.job(BODY)
    page = server.get(f"/jobs?limit={limit}").json()
    assert len(page["jobs"]) == limit
    assert [link["rel"] for link in page["links"]] == ["self", "next"]


@pytest.mark.parametrize(
    "query",
    ["status=accepted,running,successful", "processID=echo", "type=process", "datetime=2020-01-01T00:00:00Z/"],
)
def test_filters_let_through_what_matches(server: Server, query: str) -> None:
    job = server.job(BODY).json()["jobID"]
    assert job in [each["jobID"] for each in server.get(f"/jobs?{query}").json()["jobs"]]


@pytest.mark.parametrize("query", ["status=failed", "processID=register", "datetime=../2020-01-01T00:00:00Z"])
def test_filters_hold_back_what_does_not_match(server: Server, query: str) -> None:
    job = server.job(BODY).json()["jobID"]
    assert job not in [each["jobID"] for each in server.get(f"/jobs?{query}").json()["jobs"]]


def test_durations_are_those_of_jobs_that_have_begun(server: Server) -> None:
    job = server.finished(BODY)["jobID"]
    assert job in [each["jobID"] for each in server.get("/jobs?maxDuration=600&limit=1000").json()["jobs"]]
    assert job not in [each["jobID"] for each in server.get("/jobs?minDuration=600&limit=1000").json()["jobs"]]


def test_job_dismiss_op_and_success(server: Server) -> None:
    job = server.job({"inputs": {"stringInput": "a", "pause": 20}}).json()["jobID"]
    answer = server.delete(f"/jobs/{job}")
    assert answer.status_code == 200
    assert_valid("statusInfo", answer.json())
    assert (answer.json()["jobID"], answer.json()["status"]) == (job, "dismissed")


def test_a_finished_job_is_removed(server: Server) -> None:
    job = server.finished(BODY)["jobID"]
    assert server.delete(f"/jobs/{job}").json()["status"] == "dismissed"
    assert server.get(f"/jobs/{job}").status_code == 404
