"""The paragraph that is signed: it says kept only where the verdict says so, in either language."""

from typing import Any

import pytest

from schemas.results.network import LoopClosure
from schemas.results.registration_result import Provenance, RegistrationDocument, Station
from schemas.results.tolerance_check import StationPrecision, ToleranceCheck, ToleranceReason
from service.names.messages.catalogue import LANGUAGES, Language, messages_in
from service.use_cases.documents.pose_documents import fixed_pose_document
from service.use_cases.reports.conclusion import conclusion, tolerance_headline
from tests.unit.service.use_cases.documents.test_tolerance_documents import network
from tests.unit.service.use_cases.steps.test_registration_report import motion, pair

KEPT = {"en": "is kept", "de": "ist eingehalten"}
HEADLINE_KEPT = {"en": "tolerance kept", "de": "Toleranz eingehalten"}


def document(verdict: str, pair_status: str = "accepted", *reasons: tuple[str, str]) -> RegistrationDocument:
    registered = pair_status == "accepted"
    pose = fixed_pose_document("B") if registered else None
    std = {"met": 0.001, "not-met": 0.004}.get(verdict, 0.002) if registered else None
    check = ToleranceCheck(
        std_m=None if verdict == "none" else 0.003,
        std_gon=None,
        reached_std_m=std,
        reached_std_gon=None,
        verdict=verdict,
        reasons=[ToleranceReason(code=code, name=name) for code, name in reasons],
        stations=[
            StationPrecision(
                station="B",
                std_m=std,
                middle_std_m=std,
                std_gon=0.001 if registered else None,
                within=None if std is None else verdict != "not-met",
            )
        ],
    )
    return RegistrationDocument(
        status="registered" if registered else "not-registered",
        stations=[
            Station(name="A", status="fixed", world_from_scan=fixed_pose_document("A")),
            Station(name="B", status="registered" if registered else "unregistered", world_from_scan=pose),
        ],
        pairs=[pair("A", "B", motion(1.0, 10.0), pair_status)],
        tolerance=check,
        features=[],
        comparison=None,
        comparison_summary=None,
        artifacts=[],
        provenance=Provenance(software="s", method={"method": "auto"}, seed=0, inputs=[], timings_s={}),
    )


def said(found: RegistrationDocument, language: Language) -> str:
    return " ".join(conclusion(found, messages_in(language)))


CASES: list[tuple[str, str, list[tuple[str, str]]]] = [
    ("not-met", "accepted", [("beyond", "B")]),
    ("not-determined", "ambiguous", [("no-pose", "B")]),
    ("not-determined", "rejected", [("no-pose", "B")]),
    ("not-determined", "doubtful", [("no-pose", "B")]),
    ("not-determined", "degenerate", [("no-pose", "B")]),
    ("not-confirmed", "accepted", [("confirmed", "B → A")]),
    ("none", "accepted", []),
]


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_kept_tolerance_is_called_kept_with_what_was_ordered_and_reached(language: Language) -> None:
    text = said(document("met"), language)
    assert KEPT[language] in text
    assert "3 mm" in text
    assert messages_in(language).number(1.0, 2) in text
    assert tolerance_headline(document("met").tolerance, messages_in(language)) == HEADLINE_KEPT[language]


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize(("verdict", "status", "reasons"), CASES)
def test_nothing_else_is_called_kept(
    language: Language, verdict: str, status: str, reasons: list[tuple[str, str]]
) -> None:
    found = document(verdict, status, *reasons)
    assert f"{KEPT[language]}." not in said(found, language)
    assert tolerance_headline(found.tolerance, messages_in(language)) != HEADLINE_KEPT[language]


@pytest.mark.parametrize("language", LANGUAGES)
def test_an_exceeded_tolerance_is_told_with_station_and_figure(language: Language) -> None:
    text = said(document("not-met", "accepted", ("beyond", "B")), language)
    assert {"en": "NOT kept", "de": "NICHT eingehalten"}[language] in text
    assert f"B ({messages_in(language).number(4.0, 2)} mm" in text


@pytest.mark.parametrize("status", ["ambiguous", "rejected", "doubtful", "degenerate"])
def test_a_job_without_pose_says_so_and_why_and_gives_no_figure(status: str) -> None:
    text = said(document("not-determined", status, ("no-pose", "B")), "en")
    assert "No station could be registered" in text
    words = {
        "ambiguous": "more than one way",
        "rejected": "no pose was found",
        "doubtful": "not enough to accept",
        "degenerate": "a motion remains free",
    }
    assert words[status] in text
    assert "standard deviation of position" not in text


def test_two_stations_have_no_loop_and_the_conclusion_says_so() -> None:
    assert "No loop of registrations and no control point" in said(document("met"), "en")


def test_an_older_document_without_tolerance_is_not_judged() -> None:
    found: Any = document("met").model_copy(update={"tolerance": None})
    assert "No tolerance was stated" in said(found, "en")


@pytest.mark.parametrize(("passed", "words"), [
    ([True], "The 1 loop of registrations closes"),
    ([True, True], "All 2 loops of registrations close"),
    ([True, False], "Of 2 loops of registrations 1 do not close"),
])  # fmt: skip
def test_loops_are_told_as_they_close(passed: list[bool], words: str) -> None:
    loops = [
        LoopClosure(stations=["A", "B"], rotation_gon=0.0, translation_m=0.0, statistic=1.0, critical=2.0, passed=each)
        for each in passed
    ]
    found = document("met").model_copy(update={"network": network("used").model_copy(update={"loops": loops})})
    assert words in said(found, "en")


@pytest.mark.parametrize("language", LANGUAGES)
def test_stations_that_targets_contradict_are_named(language: Language) -> None:
    found = document("met")
    first, second = found.stations
    doubted = found.model_copy(update={"stations": [first, second.model_copy(update={"reason": "contradicted"})]})
    word = {"en": "contradict", "de": "widersprechen"}[language]
    assert word in said(doubted, language)
    assert word not in said(found, language)
