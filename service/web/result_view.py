"""What a page says of a result: the verdict in words, then the figures of its tables."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from schemas.results.registration_result import RegistrationDocument
from service.names.messages.catalogue import Language, Messages, messages_in
from service.names.pair_statuses import IN_PLACE, STATUSES
from service.use_cases.reports.conclusion import conclusion

TONES = {"registered": "good", "partly-registered": "doubtful", "not-registered": "bad"}
MOST_FIGURES = 40


@dataclass(frozen=True)
class ResultView:
    """What is said first."""

    tone: str
    """good, doubtful, bad or plain."""
    headline: str
    """The verdict in a few words."""
    sentences: Sequence[str]
    """What stands behind it."""
    figures: Sequence[tuple[str, str]] = ()
    """Of results that have no tables of their own: names and values."""


def result_view(process_id: str, document: Mapping[str, Any], language: Language) -> ResultView:
    """Say in words what came out.

    Parameters
    ----------
    process_id
        What made it.
    document
        The result.
    language
        Of the words.
    """
    t = messages_in(language)
    if process_id == "register" and isinstance(document.get("stations"), list):
        return _registration(document, t)
    if process_id == "register" and isinstance(document.get("counts"), Mapping):
        return _large_network(document, t)
    figures = list(_figures(document, "", t))[:MOST_FIGURES]
    return ResultView("plain", t("pages.result.done"), (), figures)


def _registration(document: Mapping[str, Any], t: Messages) -> ResultView:
    status = str(document.get("status"))
    states = Counter(str(pair.get("status")) for pair in document.get("pairs", ()))
    sound = status == "registered" and set(states) <= set(IN_PLACE)
    tone = "good" if sound else "doubtful" if status == "registered" else TONES.get(status, "bad")
    sentences = _conclusion(document, states, t)
    if tone != "good":
        sentences.append(t("pages.result.look"))
    return ResultView(tone, t.word("registration", status), sentences)


def _large_network(document: Mapping[str, Any], t: Messages) -> ResultView:
    """Say what the lists of a large network come to: a pair that sees too little in common is no fault there."""
    status, counts = str(document.get("status")), document["counts"]
    stations, pairs = counts["stations"], counts["pairs"]
    placed = sum(number for state, number in stations.items() if state != "unregistered")
    known = ", ".join(f"{pairs[state]} {t.word('status', state)}" for state in STATUSES if pairs.get(state))
    sentences = [
        t("pages.result.placed", placed=placed, all=sum(stations.values())),
        t("pages.result.links", links=known or "–"),
        t("pages.result.loops", loops=counts["loops"], open=counts["open_loops"]),
    ]
    return ResultView(TONES.get(status, "bad"), t.word("registration", status), sentences)


def _conclusion(document: Mapping[str, Any], states: Mapping[str, int], t: Messages) -> list[str]:
    """Say what the report says; of a document of an older version, what is sure to be in it."""
    try:
        return conclusion(RegistrationDocument.model_validate(document), t)
    except ValidationError:
        stations = document["stations"]
        placed = sum(bool(each.get("world_from_scan")) for each in stations)
        known = ", ".join(f"{states[state]} {t.word('status', state)}" for state in STATUSES if states.get(state))
        return [t("pages.result.placed", placed=placed, all=len(stations)), t("pages.result.links", links=known or "–")]


def _figures(document: Mapping[str, Any], above: str, t: Messages) -> Sequence[tuple[str, str]]:
    """List the single values of a document, two levels deep; lists are counted."""
    found: list[tuple[str, str]] = []
    for name, value in document.items():
        label = f"{above}{name}"
        if name in {"provenance", "artifacts"}:
            continue
        if isinstance(value, Mapping) and not above:
            found += _figures(value, f"{name}: ", t)
        elif isinstance(value, bool | str):
            found.append((label, str(value)[:300]))
        elif isinstance(value, int):
            found.append((label, str(value)))
        elif isinstance(value, float):
            found.append((label, f"{value:.6g}"))
        elif isinstance(value, list):
            found.append((label, t("pages.result.entries", count=len(value))))
    return found
