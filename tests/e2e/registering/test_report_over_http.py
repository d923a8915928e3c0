"""The report as a client gets it: in the language asked for, with the order's tolerance, as a page and as PDF."""

from pathlib import Path

import pytest

from service.use_cases.reports.report_pdf import can_print
from tests.e2e.running.running_service import RunningService

ORDER = {
    "report": {"project": "Umbau <b>7</b>", "client": "Stadt", "operator": "Büro", "lang": "de"},
    "tolerance": {"std_m": 0.02, "std_gon": 0.5},
}


@pytest.fixture(scope="module")
def job(service: RunningService, house: list[Path]) -> str:
    files = [service.upload(path) for path in house]
    stations = [{"name": f"S{k}", "scan": {"file": file["id"]}} for k, file in enumerate(files, start=1)]
    done = service.execute("register", {"stations": stations, **ORDER})
    assert service.result(done)["status"] == "registered"
    return done


def test_the_page_is_in_the_language_of_the_request_and_loads_nothing(service: RunningService, job: str) -> None:
    answer = service.http.get(f"/jobs/{job}/artifacts/report.html")
    assert answer.headers["content-type"].startswith("text/html")
    assert "script-src" not in answer.headers["content-security-policy"]
    assert all(
        word in answer.text for word in ("Registrierungsbericht", "Schlussfolgerung", "Umbau &lt;b&gt;7&lt;/b&gt;")
    )
    assert job in answer.text


def test_the_order_stands_beside_what_was_reached(service: RunningService, job: str) -> None:
    check = service.result(job)["tolerance"]
    assert (check["std_m"], check["std_gon"], check["verdict"]) == (0.02, 0.5, "met")
    assert 0.0 < check["reached_std_m"] < 0.02
    assert check["stations"][0]["middle_std_m"] <= check["stations"][0]["std_m"]


@pytest.mark.skipif(not can_print(), reason="PlutoPrint has no wheel for this machine")
def test_the_report_is_there_as_pdf_with_its_size(service: RunningService, job: str) -> None:
    listed = {artifact["name"]: artifact for artifact in service.result(job)["artifacts"]}
    answer = service.http.get(f"/jobs/{job}/artifacts/report.pdf")
    assert answer.headers["content-type"] == "application/pdf"
    assert len(answer.content) == listed["report.pdf"]["bytes"]
    assert answer.content.startswith(b"%PDF-")
