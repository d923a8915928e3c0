"""The process `echo`: every kind of input of the OGC test suite comes back."""

from collections.abc import Callable
from typing import Any

import httpx
import pytest

from service.dependencies import Adapters
from tests.api.conftest import Client

POLYGON = {"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [1, 1], [0, 0]]]}
KINDS: dict[str, Any] = {
    "stringInput": "Value2",
    "measureInput": {"measurement": 10.3, "uom": "m", "reference": "https://ucum.org/ucum-essence.xml"},
    "dateInput": "2021-03-06T07:21:00",
    "doubleInput": 3.14159,
    "booleanInput": True,
    "arrayInput": [1, 2, 3, 4, 5, 6],
    "complexObjectInput": {"property1": "value1", "property5": True},
    "geometryInput": [{"value": "<gml:Point/>", "mediaType": "application/gml+xml; version=3.2"}, {"value": POLYGON}],
    "boundingBoxInput": {"bbox": [51.9, 7, 52, 7.1], "crs": "http://www.opengis.net/def/crs/OGC/1.3/CRS84"},
    "featureCollectionInput": {"type": "FeatureCollection", "features": []},
}


@pytest.mark.parametrize("name", KINDS)
def test_each_kind_of_input_comes_back(client: Client, name: str) -> None:
    answer = client.submit({name: KINDS[name]}, "echo")
    assert answer.status_code == 200
    assert answer.json() == {name: KINDS[name]}


@pytest.mark.parametrize("name", KINDS)
def test_each_kind_of_input_may_be_a_qualified_value(client: Client, name: str) -> None:
    answer = client.submit({name: {"value": KINDS[name], "mediaType": "application/json"}}, "echo")
    assert answer.json() == {name: KINDS[name]}


def test_on_request_echo_becomes_a_job_with_the_same_inputs(client: Client, adapters: Adapters) -> None:
    answer = client.post("/processes/echo/execution", json={"inputs": KINDS}, headers={"Prefer": "respond-async"})
    assert answer.status_code == 201
    assert answer.headers["preference-applied"] == "respond-async"
    job = adapters.jobs.get(answer.json()["jobID"])
    assert job is not None
    assert job.inputs == KINDS


def test_only_the_wanted_outputs_come_back(client: Client) -> None:
    body = {"inputs": KINDS, "outputs": {"stringInput": {}, "doubleInput": {"transmissionMode": "value"}}}
    assert set(client.post("/processes/echo/execution", json=body).json()) == {"stringInput", "doubleInput"}


def test_a_single_raw_text_comes_back_bare(client: Client) -> None:
    body = {"inputs": KINDS, "outputs": {"stringInput": {}}, "response": "raw"}
    answer = client.post("/processes/echo/execution", json=body)
    assert answer.text == "Value2"
    assert answer.headers["content-type"].startswith("text/plain")


def test_a_single_raw_object_comes_back_bare(client: Client) -> None:
    body = {"inputs": KINDS, "outputs": {"boundingBoxInput": {}}, "response": "raw"}
    assert client.post("/processes/echo/execution", json=body).json() == KINDS["boundingBoxInput"]


@pytest.mark.parametrize(
    "inputs", [{"measureInput": {"measurement": 1}}, {"featureCollectionInput": {"type": "wrong/type_1"}}]
)
def test_an_object_of_the_wrong_form_is_pointed_into(
    client: Client, pointers: Callable[[httpx.Response], list[str]], inputs: dict[str, Any]
) -> None:
    (name,) = inputs
    assert any(pointer.startswith(f"/inputs/{name}/") for pointer in pointers(client.submit(inputs, "echo")))


@pytest.mark.parametrize(
    ("inputs", "pointer"),
    [
        ({}, "/inputs"),
        ({"stringInput": 3}, "/inputs/stringInput"),
        ({"doubleInput": "3"}, "/inputs/doubleInput"),
        ({"dateInput": "yesterday"}, "/inputs/dateInput"),
        ({"booleanInput": 1}, "/inputs/booleanInput"),
        ({"arrayInput": {}}, "/inputs/arrayInput"),
        ({"boundingBoxInput": {"bbox": [1, 2, 3]}}, "/inputs/boundingBoxInput/bbox"),
        ({"measureInput": 3}, "/inputs/measureInput"),
        ({"complexObjectInput": [1]}, "/inputs/complexObjectInput"),
        ({"arrayInput": ["a"]}, "/inputs/arrayInput/0"),
        ({"pause": 31}, "/inputs/pause"),
        ({"pause": -1}, "/inputs/pause"),
    ],
)
def test_a_wrong_kind_is_pointed_at(
    client: Client, pointers: Callable[[httpx.Response], list[str]], inputs: dict[str, Any], pointer: str
) -> None:
    assert pointers(client.submit(inputs, "echo")) == [pointer]
