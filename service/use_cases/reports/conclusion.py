"""The result in one paragraph: what was registered, how well, whether that is as ordered, and what checks it."""

from collections.abc import Iterator, Sequence

from schemas.results.registration_result import Pair, RegistrationDocument
from schemas.results.tolerance_check import StationPrecision, ToleranceCheck
from service.names.messages.catalogue import Messages
from service.names.pair_statuses import STATUSES
from service.use_cases.reports.figures import PairFigures

MOST_NAMES = 8
"""Longer lists of names are cut, with a count of the rest."""
OFTEN = 5.0
"""From so many times the standard deviation on, the rms beside it is explained."""


def conclusion(document: RegistrationDocument, messages: Messages) -> list[str]:
    """Give the sentences of the conclusion, in order."""
    return [
        *_outcome(document, messages),
        *_answers(document, messages),
        *_precision(document, messages),
        *_tolerance(document, messages),
        *_checks(document, messages),
    ]


def tolerance_headline(check: ToleranceCheck | None, messages: Messages) -> str:
    """Give the verdict on the tolerance in a few words."""
    return messages(f"tolerance.{'none' if check is None else check.verdict}")


def ordered(check: ToleranceCheck, messages: Messages) -> str:
    """Write what was ordered."""
    return _figures(check.std_m, check.std_gon, messages, exact=True)


def rms_explained(pairs: Sequence[PairFigures], messages: Messages) -> str | None:
    """Describe why the rms of surfaces may be many times the standard deviation of a pose; None where it is not.

    Links that carry nothing are passed over: of a wrong pose a large rms is no wonder.
    """
    ratios = [
        (pair.rms_m / pair.std_worst_m, pair.rms_m, pair.std_worst_m)
        for pair in pairs
        if pair.carries and pair.rms_m and pair.std_worst_m
    ]
    ratio, rms_m, std_m = max(ratios, default=(0.0, 0.0, 0.0))
    if ratio <= OFTEN:
        return None
    return messages("explained.rms", rms=messages.milli(rms_m, 1), std=messages.milli(std_m, 2))


def _outcome(document: RegistrationDocument, messages: Messages) -> Iterator[str]:
    stations = document.stations
    first = stations[0].name
    registered = [station.name for station in stations[1:] if station.world_from_scan is not None]
    missing = [station.name for station in stations if station.status == "unregistered"]
    if not missing:
        yield messages.counted(
            "conclusion.registered", len(registered), names=_names(registered, messages), first=first
        )
    elif registered:
        yield messages("conclusion.partly", count=len(registered) + 1, all=len(stations), first=first)
        yield messages.counted("conclusion.missing", len(missing), names=_names(missing, messages))
    else:
        yield messages("conclusion.nothing", first=first)
    if missing and document.pairs:
        without = set(missing)
        best = min((p for p in document.pairs if {p.target, p.source} & without), key=_promise, default=None)
        if best is not None:
            yield messages(f"conclusion.pair.{best.status}", target=best.target, source=best.source)
    doubtful = [link for link in document.network.links if link.state == "confirmed"] if document.network else []
    if doubtful:
        names = [f"{link.source} → {link.target}" for link in doubtful]
        yield messages("conclusion.confirmed", names=_names(names, messages))
    contradicted = [station.name for station in stations if station.status == "registered" and station.reason]
    if contradicted:
        yield messages("conclusion.contradicted", names=_names(contradicted, messages))


def _answers(document: RegistrationDocument, messages: Messages) -> Iterator[str]:
    """Answer of two stations whether the place is right, what is determined, and how well it is known.

    Of more stations, name the pairs in place that are less precise than asked.
    """
    if len(document.stations) > 2:
        coarse = [f"{pair.source} → {pair.target}" for pair in document.pairs if pair.status == "coarse"]
        if coarse:
            yield messages("conclusion.coarse", names=_names(coarse, messages))
        return
    pair = next((pair for pair in document.pairs if pair.target_from_source is not None), None)
    if pair is None:
        return
    if pair.place is not None:
        yield messages("conclusion.place", probability=messages.share(pair.place.probability, 0))
    if pair.determined is not None:
        kind = "free" if pair.determined.free else "all"
        yield messages(f"conclusion.determined.{kind}", rank=pair.determined.rank, free="; ".join(pair.determined.free))
    if (known := pair.precision) is not None:
        yield messages(
            f"conclusion.known.{'kept' if known.kept else 'exceeded'}",
            std=messages.milli(known.far_std_m, decimals_for(known.far_std_m)),
            far=messages.number(known.far_m, 0),
            asked=messages.milli(known.tolerance_m, 1),
        )


def _promise(pair: Pair) -> int:
    return STATUSES.index(pair.status) if pair.status in STATUSES else len(STATUSES)


def _precision(document: RegistrationDocument, messages: Messages) -> Iterator[str]:
    check = document.tolerance
    known = [each for each in check.stations if each.std_m is not None] if check else []
    if not known:
        return
    worst = max(known, key=lambda each: each.std_m or 0.0)
    turned = max(known, key=lambda each: each.std_gon or 0.0)
    yield messages(
        "conclusion.precision",
        first=document.stations[0].name,
        std=messages.milli(worst.std_m, decimals_for(worst.std_m)),
        station=worst.station,
        middle=messages.milli(worst.middle_std_m, decimals_for(worst.middle_std_m)),
        turn=messages.milli(turned.std_gon, decimals_for(turned.std_gon)),
        turned=turned.station,
    )


def _tolerance(document: RegistrationDocument, messages: Messages) -> Iterator[str]:
    check = document.tolerance
    if check is None or check.verdict == "none":
        yield messages("conclusion.tolerance.none")
        return
    beyond = [each for each in check.stations if each.within is False]
    told = [_reached(each, messages) for each in beyond[:MOST_NAMES]]
    more = len(beyond) - len(told)
    yield messages(
        f"conclusion.tolerance.{check.verdict}",
        ordered=ordered(check, messages),
        names=_names([reason.name for reason in check.reasons if reason.code != "beyond"], messages),
        beyond="; ".join(told) + (messages("conclusion.and-more", count=more) if more else ""),
    )
    open_ones = [reason.name for reason in check.reasons if reason.code in {"no-pose", "no-figure"}]
    if check.verdict == "not-met" and open_ones:
        yield messages("conclusion.tolerance.also-open", names=_names(open_ones, messages))


def _reached(station: StationPrecision, messages: Messages) -> str:
    return f"{station.station} ({_figures(station.std_m, station.std_gon, messages)})"


def _figures(std_m: float | None, std_gon: float | None, messages: Messages, *, exact: bool = False) -> str:
    """Write millimetres and milligon; `exact`: as they were stated, without zeros behind."""
    parts = []
    for value, unit in ((std_m, "mm"), (std_gon, "mgon")):
        if value is not None:
            text = messages.milli(value, 3 if exact else decimals_for(value))
            parts.append(f"{text.rstrip('0').rstrip('.,') if exact else text} {unit}")
    return ", ".join(parts)


def decimals_for(value: float | None) -> int:
    """Choose decimals of thousandths, so that a small standard deviation does not become zero."""
    return 2 if value is None or value >= 1e-4 else 3


def _checks(document: RegistrationDocument, messages: Messages) -> Iterator[str]:
    network = document.network
    placed = [station for station in document.stations[1:] if station.world_from_scan is not None]
    if not placed:
        return
    if network is None or not network.loops:
        yield messages("conclusion.no-loops")
    else:
        failed = sum(not loop.passed for loop in network.loops)
        if failed:
            yield messages("conclusion.loops-fail", count=len(network.loops), failed=failed)
        else:
            yield messages.counted("conclusion.loops-close", len(network.loops))
        alone = [f"{link.source} → {link.target}" for link in network.links if link.state == "uncontrolled"]
        if alone:
            yield messages("conclusion.uncontrolled", names=_names(alone, messages))
    yield messages("conclusion.not-contained")


def _names(names: Sequence[str], messages: Messages) -> str:
    unique = list(dict.fromkeys(names))
    text = ", ".join(unique[:MOST_NAMES])
    return text + (messages("conclusion.and-more", count=len(unique) - MOST_NAMES) if len(unique) > MOST_NAMES else "")
