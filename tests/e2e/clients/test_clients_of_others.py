"""Clients of others drive a registration: discovery, description, execution, status, result, list, dismissal.

None of them uploads files; what they register is uploaded beforehand.
"""

import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from tests.e2e.running.running_service import RunningService, wait_until

pytestmark = pytest.mark.service

PATIENCE_S = 240.0
"""A registration takes seconds, on a machine that does nothing else."""
FINAL = {"successful", "failed", "dismissed"}


@pytest.fixture(scope="module")
def inputs(service: RunningService, house: Sequence[Path]) -> dict[str, Any]:
    """Upload two scans, and give the inputs of their registration."""
    files = [service.upload(path)["id"] for path in house]
    return {"stations": [{"name": name, "scan": {"file": file}} for name, file in zip("AB", files, strict=True)]}


@pytest.fixture
def waiting_job(service: RunningService) -> Iterator[str]:
    """Give a job that lasts until it is dismissed."""
    job = service.execute("echo", {"stringInput": "a", "pause": 30}, Prefer="respond-async")
    yield job
    service.http.delete(f"/jobs/{job}")


def is_registered(result: Any) -> bool:
    return result["status"] == "registered" and [each["status"] for each in result["pairs"]] == ["accepted"]


def test_owslib_registers(service: RunningService, inputs: dict[str, Any]) -> None:
    from owslib.ogcapi.processes import Processes

    client = Processes(service.url)
    assert client.api()["openapi"] == "3.0.3"
    assert any(name.endswith("conf/core") for name in client.conformance()["conformsTo"])
    assert "register" in [process["id"] for process in client.processes()]
    assert client.process("register")["inputs"]["stations"]["minOccurs"] == 1
    # what is not asynchronous it asks for with `respond-sync`, which no standard knows
    job = client.execute("register", inputs=inputs, async_=False)
    assert job["status"] == "accepted"
    assert client.response_headers["Location"].endswith(job["jobID"])
    # it has no methods for jobs, but one for any path
    path = f"jobs/{job['jobID']}"
    wait_until(lambda: client._request(path=path)["status"] in FINAL, PATIENCE_S, every_s=0.2)
    assert is_registered(client._request(path=f"{path}/results"))
    assert client._request(path="jobs", kwargs={"processID": "register"})["jobs"]


def test_owslib_runs_echo_at_once(service: RunningService) -> None:
    from owslib.ogcapi.processes import Processes

    assert Processes(service.url).execute("echo", inputs={"stringInput": "a"}) == {"stringInput": "a"}


def test_cuiman_registers(service: RunningService, inputs: dict[str, Any], waiting_job: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of libraries that it imports
        from cuiman import Client
        from gavicore.models import ProcessRequest
    client = Client(api_url=service.url)
    try:
        assert client.get_capabilities().links
        assert client.get_conformance().conformsTo
        assert "register" in [process.id for process in client.get_processes().processes]
        description = client.get_process("register")
        assert description.inputs is not None
        assert "stations" in description.inputs
        job = client.execute_process("register", ProcessRequest(inputs=inputs))
        assert job.status.value == "accepted"
        wait_until(lambda: client.get_job(job.jobID).status.value in FINAL, PATIENCE_S, every_s=0.2)
        result = client.get_job_results(job.jobID).model_dump()
        assert is_registered(result.get("root", result))
        assert job.jobID in [each.jobID for each in client.get_jobs().jobs]
        assert client.dismiss_job(waiting_job).status.value == "dismissed"
    finally:
        client.close()


def test_the_client_of_eoepca_registers(service: RunningService, inputs: dict[str, Any], waiting_job: str) -> None:
    from ogc_api_processes_client import Configuration
    from ogc_api_processes_client.api_client_wrapper import ApiClientWrapper

    client = ApiClientWrapper(Configuration(host=service.url))
    assert client.get_landing_page().links
    assert client.get_conformance_classes().conforms_to
    assert "register" in [process.id for process in client.get_processes().processes]
    assert client.get_process_description("register").id == "register"
    job = client.execute_simple("register", {"inputs": inputs}, _headers={"Prefer": "respond-async"})
    wait_until(lambda: client.get_status(job.job_id).status.value in FINAL, PATIENCE_S, every_s=0.2)
    assert client.get_status(job.job_id).status.value == "successful"
    assert job.job_id in [each.job_id for each in client.get_jobs().jobs]
    assert client.dismiss(waiting_job).status.value == "dismissed"
