"""The head of a report: instruments and dates as the files state them, settings as they were used."""

from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from schemas.results.registration_result import InputFile
from schemas.values.instruments import MeasuringInstrument
from service.names.messages.catalogue import Messages

MOST_INSTRUMENTS, MOST_NAMES = 6, 30
LONGEST_VALUE = 160


def instruments_in_words(inputs: Sequence[InputFile], messages: Messages) -> list[str]:
    """Name each instrument once: make, model, serial number, and where several were used at which stations."""
    stations: dict[tuple[str, ...], list[str]] = {}
    for each in inputs:
        if each.instrument is not None and (key := _identity(each.instrument)):
            stations.setdefault(key, []).append(each.station)
    scans = sum(each.kind == "scan" for each in inputs)
    lines = []
    for (make, model, serial), names in list(stations.items())[:MOST_INSTRUMENTS]:
        text = " ".join(word for word in (make, model) if word)
        if serial:
            number = messages("head.serial", serial=serial)
            text = f"{text}, {number}" if text else number
        if len(names) < scans:
            more = messages("conclusion.and-more", count=len(names) - MOST_NAMES) if len(names) > MOST_NAMES else ""
            text += f" ({messages('head.at-stations', names=', '.join(names[:MOST_NAMES]) + more)})"
        lines.append(text)
    return lines


def measured_in_words(inputs: Sequence[InputFile], messages: Messages) -> str | None:
    """Give the span of time in which was measured, else the days on which the files were written; None: unknown."""
    known = [each.instrument for each in inputs if each.instrument is not None]
    begun = [time for each in known for time in (each.measured_from, each.measured_to) if time]
    if begun:
        return _span([_minute(time) for time in (min(begun), max(begun))], messages)
    written = sorted(each.file_date for each in known if each.file_date)
    if written:
        return messages("head.files-written", days=_span([written[0], written[-1]], messages))
    return None


def time_in_words(created: str | None) -> str | None:
    """Write a time to the minute, UTC; None where it is unknown."""
    return None if not created else _minute(created)


def settings_in_rows(method: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Flatten the options of a method to names with dots and values."""
    return [(name, _short(value)) for name, value in _flat(method, "")]


def _identity(stated: MeasuringInstrument) -> tuple[str, str, str] | None:
    found = (stated.make or "", stated.model or "", stated.serial or "")
    return found if any(found) else None


def _span(ends: Sequence[str], messages: Messages) -> str:
    first, last = ends
    return first if first == last else messages("head.span", first=first, last=last)


def _minute(time: str) -> str:
    try:
        parsed = datetime.fromisoformat(time)
    except ValueError:
        return time[:40]
    aware = parsed if parsed.tzinfo is not None else parsed.replace(tzinfo=UTC)
    return aware.astimezone(UTC).strftime("%Y-%m-%d %H:%M UTC")


def _flat(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for key, each in value.items():
            yield from _flat(each, f"{name}.{key}" if name else str(key))
    else:
        yield name, value


def _short(value: Any) -> str:
    text = "–" if value is None else str(value)
    return text if len(text) <= LONGEST_VALUE else text[: LONGEST_VALUE - 1] + "…"
