"""The description of the interface as generators of clients read it: named parts, short names, words everywhere."""

import re
from collections.abc import Iterator
from typing import Any

import pytest
from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from service.processes import PROCESSES
from service.routes.described_processes import conflicting, process_components
from tests.api.conftest import Client

Document = dict[str, Any]
COMPONENTS = "#/components/schemas/"


def references(node: Any) -> Iterator[str]:
    if isinstance(node, dict):
        if isinstance(node.get("$ref"), str):
            yield node["$ref"]
        for each in node.values():
            yield from references(each)
    elif isinstance(node, list):
        for each in node:
            yield from references(each)


def test_every_reference_leads_to_a_component(description: Document) -> None:
    named = {COMPONENTS + name for name in description["components"]["schemas"]}
    assert {each for each in references(description) if each.startswith(COMPONENTS)} - named == set()


@pytest.mark.parametrize("process", PROCESSES, ids=lambda process: process.id)
def test_request_and_result_of_every_process_are_components(description: Document, process: Any) -> None:
    schemas = description["components"]["schemas"]
    for name, choice in ((process.request_model.__name__, "Execute"), (process.outputs.__name__, "Results")):
        assert {"$ref": COMPONENTS + name} in schemas[choice]["anyOf"]
        assert schemas[name]["properties"]
    request = schemas[process.request_model.__name__]
    assert request["properties"]["inputs"]["$ref"] == COMPONENTS + process.inputs.__name__


def test_parts_that_several_share_are_there_once(description: Document) -> None:
    schemas = description["components"]["schemas"]
    lines, edges = schemas["ExtractLinesInputs"]["properties"], schemas["DetectEdgesInputs"]["properties"]
    assert lines["station"]["$ref"] == COMPONENTS + "Station"
    assert edges["photo"]["$ref"] == COMPONENTS + "PhotoReference"
    assert schemas["StationResult"]["properties"]["world_from_scan"]["anyOf"][0]["$ref"] == COMPONENTS + "Pose"


def test_one_name_means_one_thing(client: Client) -> None:
    app: FastAPI = client._app
    of_the_framework = get_openapi(title="", version="", routes=app.routes)["components"]["schemas"]
    assert list(conflicting(of_the_framework, process_components(PROCESSES))) == []


def test_names_of_components_are_words_and_their_titles(description: Document) -> None:
    for name, schema in description["components"]["schemas"].items():
        assert re.fullmatch(r"([A-Z][a-z0-9]*)+", name), name
        assert schema["title"] == name


def test_every_property_is_described(description: Document) -> None:
    schemas = description["components"]["schemas"]

    def words(member: Document) -> str:
        named = member.get("$ref", "").removeprefix(COMPONENTS)
        return str(member.get("description") or schemas.get(named, {}).get("description") or "")

    silent = [
        f"{name}.{member}"
        for name, schema in schemas.items()
        for member, document in schema.get("properties", {}).items()
        if not words(document)
    ]
    assert silent == []


def test_operations_have_short_names_of_their_own(description: Document) -> None:
    names = [operation["operationId"] for path in description["paths"].values() for operation in path.values()]
    assert len(set(names)) == len(names)
    assert [name for name in names if not re.fullmatch(r"[a-z]+(_[a-z]+){0,2}", name)] == []
