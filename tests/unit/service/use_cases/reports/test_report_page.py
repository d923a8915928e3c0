"""The page that is signed: languages, hostile names, explanations where they stand, and the PDF of it."""

import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from algorithms.geometry.poses import PoseEstimate
from schemas.requests.report_options import ReportOptions
from schemas.results.registration_result import InputFile, Overlap, RegistrationDocument
from schemas.values.instruments import MeasuringInstrument
from service.names.messages.catalogue import all_messages, messages_in
from service.use_cases.reports import report_page as page_module
from service.use_cases.reports.report_head import instruments_in_words, measured_in_words
from service.use_cases.reports.report_page import PAGES, ReportFrame, report_page
from service.use_cases.reports.report_pdf import report_pdf
from service.use_cases.reports.result_lines import ScanLines
from tests.unit.service.use_cases.documents.test_pair_documents import MIXED, adjusted
from tests.unit.service.use_cases.reports.test_conclusion import document
from tests.unit.service.use_cases.steps.test_registration_report import two_lines

HOSTILE = "<script>alert(1)</script>\"'&{{ 7*7 }}"


def scans() -> dict[str, ScanLines]:
    surface = np.random.default_rng(1).uniform(-5.0, 5.0, (2000, 3))
    scan = ScanLines(two_lines(), np.zeros(3), np.zeros(3), surface, 0.1)
    return {"A": scan, "B": scan}


def rendered(found: RegistrationDocument, **options: Any) -> str:
    estimates = {"B": PoseEstimate(RigidTransform.identity(), 1e-8 * np.eye(6))}
    frame = ReportFrame(ReportOptions.model_validate(options), "j-1", "2026-11-25T13:50:11+00:00")
    return report_page(found, scans(), estimates, frame)


class Tags(HTMLParser):
    def __init__(self, page: str) -> None:
        super().__init__()
        self.names: list[str] = []
        self.attributes: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.names.append(tag)
        self.attributes += [name for name, _ in attrs]


def test_head_and_language_follow_the_request() -> None:
    german = rendered(document("met"), project="Umbau", client="Stadt", operator="Büro", lang="de")
    assert '<html lang="de">' in german
    assert all(word in german for word in ("Registrierungsbericht", "Umbau", "Stadt", "Büro", "Toleranz eingehalten"))
    english = rendered(document("met"))
    assert '<html lang="en">' in english
    assert "not stated" in english
    assert "2026-11-25 13:50 UTC" in english


def test_what_is_not_translated_is_said_and_marked_as_english() -> None:
    german = rendered(document("met"), lang="de")
    assert "nicht übersetzt" in german
    assert '<ul lang="en"><li>a reason</li>' in german


def test_hostile_names_are_text_and_nothing_else() -> None:
    found = document("met")
    hostile = found.pairs[0].model_copy(update={"reasons": [HOSTILE]})
    file = InputFile(
        station="A", file="f", name=HOSTILE, index=0, sha256="ab", instrument=MeasuringInstrument(make=HOSTILE)
    )
    inputs = found.provenance.model_copy(update={"inputs": [file]})
    page = rendered(
        found.model_copy(update={"pairs": [hostile], "provenance": inputs}),
        project=HOSTILE, client=HOSTILE, operator=HOSTILE, order=HOSTILE, remarks=HOSTILE,
    )  # fmt: skip
    tags = Tags(page)
    assert "script" not in tags.names
    assert not any(name.startswith("on") for name in tags.attributes)
    assert page.count("&lt;script&gt;alert(1)") >= 7
    assert "49" not in re.findall(r"&amp;(\d+)", page)


def test_the_page_has_no_inline_styles_which_a_strict_policy_would_refuse() -> None:
    assert "style" not in Tags(rendered(document("met"))).attributes


def test_no_message_of_the_pages_is_missing() -> None:
    """Keys that templates name outright exist; those that they build from codes are looked up with a way out."""
    for path in PAGES.glob("*.jinja"):
        text = path.read_text(encoding="utf-8")
        keys = re.findall(r'\bt\("([a-z0-9.-]+)"(?!\s*~)', text)
        keys += [f"table.{key.lstrip('#')}" for heads in re.findall(r"heads\(\[(.*?)\]\)", text)
                 for key in re.findall(r'"(#?[a-z0-9-]+)"', heads)]  # fmt: skip
        assert [key for key in keys if key not in all_messages()] == [], path.name


def test_a_passed_over_global_test_is_explained_where_it_stands() -> None:
    found = document("met")
    pair = adjusted(MIXED)
    assert pair.adjustment is not None
    assert pair.adjustment.global_test is not None
    failed = pair.adjustment.global_test.model_copy(update={"side": "too-large", "passed": False})
    adjustment = pair.adjustment.model_copy(update={"global_test": failed, "sigma0": 1.7, "variance_factor": 2.89})
    pair = pair.model_copy(update={"status": "accepted", "adjustment": adjustment})
    page = rendered(found.model_copy(update={"pairs": [pair]}))
    assert "Global test too large, and yet accepted" in page
    assert "1.70 times as large" in page
    assert "multiplied by 2.89" in page


def test_a_large_rms_beside_a_small_standard_deviation_is_explained() -> None:
    overlap = Overlap(fraction_0_5m=0.6, fraction_0_1m=0.5, rms_m=0.0095, free_space_violations=0.0)
    found = document("met")
    pairs = [found.pairs[0].model_copy(update={"overlap": overlap})]
    page = rendered(found.model_copy(update={"pairs": pairs}))
    assert re.search(r"An rms of 9\.5 mm beside a standard deviation of 1\.\d\d mm is no contradiction", page)
    few = [found.pairs[0].model_copy(update={"overlap": overlap.model_copy(update={"rms_m": 0.002})})]
    assert "is no contradiction" not in rendered(found.model_copy(update={"pairs": few}))
    wrong = [pairs[0].model_copy(update={"status": "rejected"})]
    assert "is no contradiction" not in rendered(found.model_copy(update={"pairs": wrong}))


def test_tables_have_smallest_detectable_errors_and_long_ones_are_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    found = document("met").model_copy(update={"pairs": [adjusted(MIXED)]})
    monkeypatch.setattr(page_module, "FEWEST_ROWS", 2)
    monkeypatch.setattr(page_module, "ALL_ROWS", 2)
    page = rendered(found)
    assert "MDB offset, mm" in page
    assert f"The first 2 of {len(adjusted(MIXED).correspondences)}" in page


def test_pictures_are_in_the_page_and_only_of_registered_stations() -> None:
    assert rendered(document("met")).count("data:image/png;base64,") == 2
    assert "data:image" not in rendered(document("not-determined", "rejected", ("no-pose", "B")))


@pytest.mark.parametrize("status", ["doubtful", "ambiguous", "degenerate", "rejected"])
def test_a_report_without_any_pose_is_a_report_all_the_same(status: str) -> None:
    page = rendered(document("not-determined", status, ("no-pose", "B")), lang="de")
    assert "Kein Standpunkt konnte" in page
    assert "nicht beurteilbar" in page


def test_instruments_are_named_once_and_the_span_of_time_is_that_of_all() -> None:
    def scan(station: str, serial: str, begun: str, ended: str) -> InputFile:
        stated = MeasuringInstrument(
            make="RIEGL", model="VZ", serial=serial, measured_from=f"2026-11-{begun}Z", measured_to=f"2026-11-{ended}Z"
        )
        return InputFile(station=station, file="f", index=0, sha256="ab", instrument=stated)

    inputs = [
        scan("A", "S1", "20T09:00:00", "20T09:05:00"),
        scan("B", "S1", "20T10:00:00", "20T10:05:00"),
        scan("C", "S2", "21T08:00:00", "21T08:05:00"),
    ]
    words = messages_in("en")
    assert instruments_in_words(inputs, words) == [
        "RIEGL VZ, serial number S1 (stations A, B)",
        "RIEGL VZ, serial number S2 (stations C)",
    ]
    assert measured_in_words(inputs, words) == "2026-11-20 09:00 UTC to 2026-11-21 08:05 UTC"
    assert measured_in_words([], words) is None


def test_the_pdf_is_the_page_on_paper_with_its_own_fonts() -> None:
    page = rendered(document("met"), project="Umbau", lang="de")
    data = report_pdf(page, messages_in("de"), footer='Umbau "} body{display:none}', created="2026-11-25T13:50:11Z")
    assert data.startswith(b"%PDF-")
    assert data.rstrip().endswith(b"%%EOF")
    assert b"DejaVuSansCondensed" in data
    again = report_pdf(page, messages_in("de"), footer='Umbau "} body{display:none}', created="2026-11-25T13:50:11Z")
    assert len(again) == len(data)


def test_the_pdf_fetches_nothing(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    secret = tmp_path / "secret.svg"
    secret.write_text("<svg xmlns='http://www.w3.org/2000/svg' width='9' height='9'><text>secret</text></svg>")
    page = f"<html><body><p>text</p><img src='{secret.as_uri()}'><img src='http://127.0.0.1:9/a.png'></body></html>"
    report_pdf(page, messages_in("en"), footer="", created=None)
    said = capfd.readouterr().err
    assert "Couldn't connect" not in said
    assert said.count("a report refers to") >= 2 or said.count("WARNING") >= 2
