"""What a file says of the instrument that measured a scan, and when: for people, never for computations."""

import math
from dataclasses import asdict, dataclass
from datetime import UTC, date, datetime, timedelta
from typing import Any

LONGEST_TEXT = 80
GPS_EPOCH = datetime(1980, 1, 6, tzinfo=UTC)
LEAP_SECONDS = (
    (datetime(2017, 1, 1, tzinfo=UTC), 18), (datetime(2015, 7, 1, tzinfo=UTC), 17),
    (datetime(2012, 7, 1, tzinfo=UTC), 16), (datetime(2009, 1, 1, tzinfo=UTC), 15),
    (datetime(2006, 1, 1, tzinfo=UTC), 14), (datetime(1999, 1, 1, tzinfo=UTC), 13),
)  # fmt: skip
"""From when on GPS time is so many seconds ahead of UTC (IERS Bulletin C)."""
FIRST_SCANNERS, LATEST = datetime(1995, 1, 1, tzinfo=UTC), datetime(2100, 1, 1, tzinfo=UTC)
"""Times outside are no times of a terrestrial scan: writers that know none put zeros."""
NO_SYSTEMS = frozenset(("MERGE", "MODIFICATION", "EXTRACTION", "OTHER", "UNKNOWN", "NONE", "N/A", "LAZ"))
"""What LAS files have instead of a system when they were made of others (LAS 1.4, table 3), and words for nothing."""


@dataclass(frozen=True)
class Instrument:
    """As the file states it, checked by nobody; None: it does not say."""

    make: str | None = None
    model: str | None = None
    serial: str | None = None
    measured_from: str | None = None
    """Beginning of the measurement, UTC, ISO 8601."""
    measured_to: str | None = None
    """Its end."""
    file_date: str | None = None
    """When the file was written, as a date; of formats that state no time of measurement."""

    def to_json(self) -> dict[str, Any]:
        """Give the members as plain JSON values."""
        return asdict(self)


def stated_instrument(stated: Instrument) -> Instrument | None:
    """Give what was stated; None where it is nothing."""
    return stated if any(value is not None for value in asdict(stated).values()) else None


def stated_text(text: Any) -> str | None:
    """Clean a word of a file: printable characters, of bounded length; None where nothing remains."""
    kept = "".join(c for c in str(text) if c.isprintable() and not "\ud800" <= c <= "\udfff").strip()[:LONGEST_TEXT]
    return kept.strip() or None


def system_of_las(text: Any) -> str | None:
    """Give the instrument that a LAS file names; None where it says that it was made of other files."""
    word = stated_text(text)
    return None if word is None or word.upper() in NO_SYSTEMS else word


def time_of_gps(seconds: float) -> str | None:
    """Turn seconds since the epoch of GPS into UTC to the second; None where that is no time of a scan."""
    if not math.isfinite(seconds) or not 0.0 < seconds < 4e9:
        return None
    time = GPS_EPOCH + timedelta(seconds=seconds)
    leap = next((count for since, count in LEAP_SECONDS if time - timedelta(seconds=count) >= since), 0)
    time -= timedelta(seconds=leap)
    return time.strftime("%Y-%m-%dT%H:%M:%SZ") if FIRST_SCANNERS <= time < LATEST else None


def day_of(day: date | None) -> str | None:
    """Write the date of a file; None where it is none of a scan."""
    return None if day is None or not FIRST_SCANNERS.year <= day.year < LATEST.year else day.isoformat()
