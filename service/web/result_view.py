"""What a page says of a result: the verdict in words, then the figures of its tables."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from service.names.messages.catalogue import Language, Messages, messages_in

TONES = {"registered": "good", "partly-registered": "doubtful", "not-registered": "bad"}
STATES = ("accepted", "doubtful", "ambiguous", "degenerate", "rejected")
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
    figures = list(_figures(document, "", t))[:MOST_FIGURES]
    return ResultView("plain", t("pages.result.done"), (), figures)


def _registration(document: Mapping[str, Any], t: Messages) -> ResultView:
    status, stations = str(document.get("status")), document["stations"]
    placed = [each for each in stations if each.get("world_from_scan")]
    sentences = [t("pages.result.placed", placed=len(placed), all=len(stations))]
    counts = Counter(str(pair.get("status")) for pair in document.get("pairs", ()))
    known = [f"{counts[state]} {t.word('status', state)}" for state in STATES if counts[state]]
    if known:
        sentences.append(t("pages.result.links", links=", ".join(known)))
    largest = max((std for each in placed if (std := _largest_std(each)) is not None), default=None)
    if largest is not None:
        sentences.append(t("pages.result.largest_std", std=t.milli(largest, 2)))
    sound = status == "registered" and set(counts) <= {"accepted"}
    tone = "good" if sound else "doubtful" if status == "registered" else TONES.get(status, "bad")
    if tone != "good":
        sentences.append(t("pages.result.look"))
    return ResultView(tone, t.word("registration", status), sentences)


def _largest_std(station: Mapping[str, Any]) -> float | None:
    stds = station["world_from_scan"].get("std_at_centroid_m") or {}
    return max((value for value in stds.values() if isinstance(value, float)), default=None)


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
