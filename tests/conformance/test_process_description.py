"""Conformance class ogc-process-description of OGC API - Processes 1.0."""

from typing import Any

import pytest

from service.processes import OFFERED_PROCESSES
from tests.conformance.conftest import Server
from tests.conformance.official_schemas import assert_valid, faults

Document = dict[str, Any]


@pytest.fixture(params=OFFERED_PROCESSES)
def description(request: pytest.FixtureRequest, server: Server) -> Document:
    return dict(server.get(f"/processes/{request.param}").json())


def test_json_encoding(description: Document) -> None:
    assert_valid("process", description)


@pytest.mark.parametrize("direction", ["input", "output"])
def test_input_and_output_definitions(description: Document, direction: str) -> None:
    members = description[f"{direction}s"]
    assert members
    assert {name: found for name, each in members.items() if (found := faults(f"{direction}Description", each))} == {}


@pytest.mark.parametrize("direction", ["inputs", "outputs"])
def test_mixed_types_are_told_by_one_of(server: Server, direction: str) -> None:
    members = server.get("/processes/echo").json()[direction]
    assert [kind["type"] for kind in members["geometryInput"]["schema"]["oneOf"]] == ["object", "array", "string"]


def test_inputs_that_may_be_left_out_say_so(server: Server) -> None:
    inputs = server.get("/processes/register").json()["inputs"]
    assert inputs["stations"]["minOccurs"] == 1
    assert {each["minOccurs"] for name, each in inputs.items() if name != "stations"} == {0}
