"""Landing page, conformance, processes, health, documents of errors."""

import json

import pytest

from service.dependencies import Adapters
from service.settings import Settings
from tests.api.conftest import Client, FakeSteps
from tests.doubles.application import create_app
from tests.doubles.memory import MemoryBlobStore, MemoryFileStore, MemoryJobLog, MemoryJobStore, MemoryQueue

CORE = "http://www.opengis.net/spec/ogcapi-processes-1/1.0/conf/core"


def test_landing_page_links_to_everything_a_client_needs(client: Client) -> None:
    relations = {link["rel"].rpartition("/")[2] for link in client.get("/").json()["links"]}
    assert relations >= {"self", "service-desc", "service-doc", "conformance", "processes", "job-list"}


def test_every_link_of_the_landing_page_leads_somewhere(client: Client) -> None:
    answers = [client.get(link["href"]) for link in client.get("/").json()["links"]]
    assert {answer.status_code for answer in answers} == {200}


def test_browsers_get_a_page(client: Client) -> None:
    answer = client.get("/", headers={"Accept": "text/html,application/xhtml+xml,application/xml;q=0.9,*/*;q=0.8"})
    assert answer.headers["content-type"].startswith("text/html")


def test_links_follow_the_public_url(adapters: Adapters, settings: Settings) -> None:
    behind_proxy = Client(create_app(settings.model_copy(update={"public_url": "https://scans.example/api"}), adapters))
    assert behind_proxy.get("/").json()["links"][0]["href"] == "https://scans.example/api/"


def test_conformance_declares_core_and_no_class_that_is_not_built(client: Client) -> None:
    classes = client.get("/conformance").json()["conformsTo"]
    assert CORE in classes
    assert not [name for name in classes if name.endswith("html")]


def test_processes_are_listed_with_how_they_may_run(client: Client) -> None:
    options = {p["id"]: p["jobControlOptions"] for p in client.get("/processes").json()["processes"]}
    assert options == {
        "register": ["async-execute", "dismiss"],
        "extract-lines": ["async-execute", "dismiss"],
        "detect-edges": ["async-execute", "dismiss"],
        "find-targets": ["async-execute", "dismiss"],
        "transform": ["async-execute", "dismiss"],
        "clean": ["async-execute", "dismiss"],
        "colour": ["async-execute", "dismiss"],
        "compare": ["async-execute", "dismiss"],
        "mesh": ["async-execute", "dismiss"],
        "model-planes": ["async-execute", "dismiss"],
        "roofs": ["async-execute", "dismiss"],
        "terrain": ["async-execute", "dismiss"],
        "drainage": ["async-execute", "dismiss"],
        "adjust-strips": ["async-execute", "dismiss"],
        "adjust": ["async-execute", "dismiss"],
        "calibrate-camera": ["async-execute", "dismiss"],
        "calibrate-mount": ["async-execute", "dismiss"],
        "orient": ["async-execute", "dismiss"],
        "simulate": ["async-execute", "dismiss"],
        "echo": ["sync-execute", "async-execute", "dismiss"],
    }


@pytest.mark.parametrize("process", ["register", "extract-lines", "detect-edges", "echo"])
def test_a_description_has_a_schema_for_every_input_and_output(client: Client, process: str) -> None:
    description = client.get(f"/processes/{process}").json()
    described = [*description["inputs"].values(), *description["outputs"].values()]
    assert described
    assert all(each["schema"] for each in described)


def test_schemas_stand_alone(client: Client) -> None:
    assert "$ref" not in json.dumps(client.get("/processes/register").json())


def test_unknown_process_is_named_as_the_standard_says(client: Client) -> None:
    answer = client.get("/processes/ransac")
    assert answer.status_code == 404
    assert answer.json()["type"] == "http://www.opengis.net/def/exceptions/ogcapi-processes-1/1.0/no-such-process"


def test_executing_an_unknown_process_is_not_found(client: Client) -> None:
    answer = client.submit({}, process="ransac")
    assert answer.status_code == 404
    assert answer.json()["type"].endswith("no-such-process")


def test_unknown_path_is_a_problem_document(client: Client) -> None:
    answer = client.get("/nowhere")
    assert answer.status_code == 404
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.json()["instance"] == "/nowhere"


def test_wrong_method_is_a_problem_document_that_says_what_is_allowed(client: Client) -> None:
    answer = client.request("PUT", "/jobs")
    assert answer.status_code == 405
    assert answer.headers["content-type"] == "application/problem+json"
    assert "GET" in answer.headers["allow"]


def test_clients_that_accept_only_json_get_problems_as_json(client: Client) -> None:
    answer = client.get("/jobs/none", headers={"Accept": "application/json"})
    assert answer.headers["content-type"] == "application/json"
    assert answer.json()["status"] == 404


def test_clients_that_accept_anything_get_problem_json(client: Client) -> None:
    answer = client.get("/jobs/none", headers={"Accept": "application/json, */*;q=0.1"})
    assert answer.headers["content-type"] == "application/problem+json"


def test_openapi_never_promises_422(client: Client) -> None:
    document = client.get("/openapi.json").json()
    assert document["openapi"].startswith("3.1")
    assert "422" not in {
        code for path in document["paths"].values() for op in path.values() for code in op["responses"]
    }


def test_openapi_has_every_definition_it_refers_to(client: Client) -> None:
    text = client.get("/openapi.json").text
    known = json.loads(text)["components"]["schemas"].keys()
    referred = {piece.partition('"')[0] for piece in text.split('"#/components/schemas/')[1:]}
    assert referred <= known


def test_service_is_ready_with_a_worker(client: Client) -> None:
    answer = client.get("/readyz")
    assert answer.status_code == 200
    checks = answer.json()["checks"]
    assert checks.pop("open3d", {"ok": False})["ok"] is False  # named only where a library is missing
    assert all(check["ok"] for check in checks.values())


def test_service_without_workers_is_alive_but_not_ready(settings: Settings) -> None:
    blobs = MemoryBlobStore()
    adapters = Adapters(
        MemoryJobStore(), MemoryFileStore(), blobs, MemoryQueue(workers=0), FakeSteps(blobs), MemoryJobLog()
    )
    lonely = Client(create_app(settings, adapters))
    assert lonely.get("/healthz").status_code == 200
    assert lonely.get("/readyz").status_code == 503


def test_readiness_check_leaves_nothing_behind(client: Client, adapters: Adapters) -> None:
    client.get("/readyz")
    assert not adapters.blobs.keys("probes/")


def test_unexpected_errors_tell_no_details(client: Client, adapters: Adapters, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_job_id: str) -> None:
        raise RuntimeError("a secret path")

    monkeypatch.setattr(adapters.jobs, "get", fail)
    answer = client.get("/jobs/some")
    assert answer.status_code == 500
    assert answer.headers["content-type"] == "application/problem+json"
    assert "secret" not in answer.text
