"""Strips in files that hold several: told by point source and pauses; tiles of one flight share strips."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from algorithms.arrays import Array, Flags, Indices, Scalars
from algorithms.errors import InvalidInputError
from algorithms.strips.strip import LEAST_POINTS
from schemas.requests.adjust_strips_inputs import LONGEST_PAUSE_S, MOST_STRIPS
from service.formats.strips import StripRecords


@dataclass(frozen=True, eq=False)
class StripPart:
    """Points of one file that belong to one strip."""

    file: int
    numbers: Indices
    """(m,) of the file's records, in the order of their times."""


@dataclass(frozen=True, eq=False)
class DividedStrip:
    """A strip, and the points of files that it consists of."""

    name: str
    source: int | None
    """Its point source; None: all points of its files in its time."""
    parts: tuple[StripPart, ...]
    from_s: float = -np.inf
    """GPS time from which on points of its source belong to it [s]."""
    until_s: float = np.inf
    """GPS time before which they do [s]."""

    def owns(self, times_s: Scalars, sources: Array) -> Flags:
        """Return which points (n,) of its files belong to it, also such as take no part."""
        inside = (times_s >= self.from_s) & (times_s < self.until_s)
        return np.asarray(inside if self.source is None else inside & (sources == self.source))


def divided(
    files: Sequence[StripRecords], names: Sequence[str], one_strip: Sequence[bool]
) -> tuple[list[DividedStrip], list[str]]:
    """Divide files into strips by point source and pauses; say what was divided by pauses, and what is no strip.

    Parameters
    ----------
    files
        Points of each file.
    names
        Name of each file in the result.
    one_strip
        Whether each file is one strip whatever its points say.

    Raises
    ------
    InvalidInputError
        More strips than a job may have.
    """
    found: list[DividedStrip] = []
    remarks: list[str] = []
    for strip in _by_source(files, names, one_strip):
        pieces = [strip] if one_strip[strip.parts[0].file] else _cut_at_pauses(files, strip)
        if len(pieces) > 1 and strip.source is None:
            remarks.append(
                f"{strip.name}: its times pause {len(pieces) - 1} times for more than {LONGEST_PAUSE_S:.0f} s, so it "
                f"is taken for {len(pieces)} strips (`one_strip` says otherwise)"
            )
        for number, piece in enumerate(pieces, start=1):
            count, moments = sum(len(part.numbers) for part in piece.parts), _moments(files, piece)
            if (count < LEAST_POINTS or moments < 2) and (strip.source is not None or len(pieces) > 1):
                what = f"{strip.name}, part {number}" if strip.source is None else f"point source {strip.source}"
                remarks.append(
                    f"{what} has {count} points at {moments} different times, too few for a strip: it takes no part "
                    "and stays as it is"
                )
            else:
                found.append(piece)
    if len(found) > MOST_STRIPS:
        raise InvalidInputError(
            "strips", f"the points make {len(found)} strips by their point sources and times",
            f"a job has at most {MOST_STRIPS}; say `one_strip` where point sources are no strips",
        )  # fmt: skip
    return _named(found, names, [_is_tile(*each) for each in zip(files, one_strip, strict=True)]), remarks


def _is_tile(file: StripRecords, one_strip: bool) -> bool:
    return not one_strip and bool((file.point_sources != file.point_sources[0]).any())


def _by_source(
    files: Sequence[StripRecords], names: Sequence[str], one_strip: Sequence[bool]
) -> Iterator[DividedStrip]:
    """Yield whole files, or where any is a tile the points of each source in all files."""
    has_tiles = any(_is_tile(*each) for each in zip(files, one_strip, strict=True))
    parts: dict[int, list[StripPart]] = {}
    for number, file in enumerate(files):
        if one_strip[number] or not has_tiles:
            yield DividedStrip(names[number], None, (StripPart(number, np.arange(len(file.points))),))
            continue
        for source in np.unique(file.point_sources).tolist():
            parts.setdefault(source, []).append(StripPart(number, np.flatnonzero(file.point_sources == source)))
    for source, own in parts.items():
        yield DividedStrip(f"source-{source}", source, tuple(own))


def _cut_at_pauses(files: Sequence[StripRecords], strip: DividedStrip) -> list[DividedStrip]:
    """Cut a strip in the middle of pauses."""
    times = np.sort(_times(files, strip))
    pauses = np.flatnonzero(np.diff(times) > LONGEST_PAUSE_S)
    borders = [-np.inf, *(0.5 * (times[pauses] + times[pauses + 1])).tolist(), np.inf]
    pieces = []
    for from_s, until_s in pairwise(borders):
        cut = []
        for part in strip.parts:
            own = files[part.file].gps_time_s[part.numbers]
            inside = part.numbers[(own >= from_s) & (own < until_s)]
            if len(inside):
                cut.append(StripPart(part.file, inside))
        pieces.append(replace(strip, parts=tuple(cut), from_s=from_s, until_s=until_s))
    return pieces


def _named(strips: Sequence[DividedStrip], names: Sequence[str], is_tile: Sequence[bool]) -> list[DividedStrip]:
    """Name strips by their files and sources, parts of one name by their number, in the order of the files."""
    ordered = sorted(strips, key=lambda each: (each.parts[0].file, each.source or 0, each.from_s))
    plain = []
    for strip in ordered:
        file = strip.parts[0].file
        if len(strip.parts) > 1:
            plain.append(f"source-{strip.source}")
        else:
            plain.append(f"{names[file]}-{strip.source}" if is_tile[file] else names[file])
    seen: Counter[str] = Counter()
    found = []
    for strip, name in zip(ordered, plain, strict=True):
        seen[name] += 1
        found.append(replace(strip, name=f"{name}-part-{seen[name]}" if plain.count(name) > 1 else name))
    return found


def _times(files: Sequence[StripRecords], strip: DividedStrip) -> Scalars:
    return np.concatenate([files[part.file].gps_time_s[part.numbers] for part in strip.parts])


def _moments(files: Sequence[StripRecords], strip: DividedStrip) -> int:
    return len(np.unique(_times(files, strip)))
