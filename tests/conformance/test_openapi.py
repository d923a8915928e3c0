"""Conformance classes oas30 and json of OGC API - Processes 1.0: the description of the interface, and what it says."""

from typing import Any

import pytest
from openapi_spec_validator import OpenAPIV30SpecValidator, OpenAPIV31SpecValidator

from tests.conformance.conftest import Server

Document = dict[str, Any]
OF_THE_STANDARD = {
    "/": {"get"},
    "/conformance": {"get"},
    "/processes": {"get"},
    "/processes/{process_id}": {"get"},
    "/processes/{process_id}/execution": {"post"},
    "/jobs": {"get"},
    "/jobs/{job_id}": {"get", "delete"},
    "/jobs/{job_id}/results": {"get"},
}


@pytest.fixture
def description(server: Server) -> Document:
    return dict(server.get("/openapi-3.0.json").json())


def test_definition_in_openapi_30_is_linked(server: Server) -> None:
    kinds = {link["type"]: link["href"] for link in server.get("/").json()["links"] if link["rel"] == "service-desc"}
    answer = server.get(kinds["application/vnd.oai.openapi+json;version=3.0"])
    assert answer.status_code == 200
    assert answer.json()["openapi"] == "3.0.3"
    assert answer.headers["content-type"] == "application/vnd.oai.openapi+json;version=3.0"


def test_definition_is_valid_openapi_30(description: Document) -> None:
    assert [str(fault)[:300] for fault in OpenAPIV30SpecValidator(description).iter_errors()] == []


def test_definition_is_valid_openapi_31(server: Server) -> None:
    document = server.get("/openapi.json").json()
    assert [str(fault)[:300] for fault in OpenAPIV31SpecValidator(document).iter_errors()] == []


def test_completeness(description: Document) -> None:
    for path, methods in OF_THE_STANDARD.items():
        assert methods <= set(description["paths"][path])


def test_exception_codes(description: Document) -> None:
    for path in OF_THE_STANDARD:
        for operation in description["paths"][path].values():
            if path not in {"/", "/conformance"}:
                assert "application/problem+json" in operation["responses"]["4XX"]["content"]


def test_security_is_described_where_keys_are_needed(description: Document) -> None:
    schemes = description["components"].get("securitySchemes", {})
    assert all(each["type"] in {"http", "apiKey", "oauth2", "openIdConnect"} for each in schemes.values())


@pytest.mark.parametrize("path", ["/", "/conformance", "/processes", "/processes/echo", "/jobs"])
def test_json_is_what_comes(server: Server, path: str) -> None:
    answer = server.get(path)
    assert answer.headers["content-type"] == "application/json"
    assert isinstance(answer.json(), dict)
