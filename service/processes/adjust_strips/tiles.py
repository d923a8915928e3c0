"""Strips in files that hold several: their points are told by point source, and tiles of one flight share strips."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, Indices
from algorithms.errors import InvalidInputError
from algorithms.strips.strip import LEAST_POINTS
from schemas.requests.adjust_strips_inputs import MOST_STRIPS
from service.formats.strips import StripRecords

LONGEST_PAUSE_S = 120.0
"""Points of one source further apart in time are of two strips: an aircraft turns in less [s]."""


@dataclass(frozen=True, eq=False)
class StripPart:
    """Points of one file that belong to one strip."""

    file: int
    numbers: Indices
    """(m,) of the file's records."""


@dataclass(frozen=True, eq=False)
class DividedStrip:
    """A strip, and the points of files that it consists of."""

    name: str
    source: int | None
    """Its point source; None: it is a whole file."""
    parts: tuple[StripPart, ...]


def divided(
    files: Sequence[StripRecords], names: Sequence[str], one_strip: Sequence[bool]
) -> tuple[list[DividedStrip], list[str]]:
    """Divide files into strips, and say which point sources are too few points to be one.

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
    sources = [np.unique(each.point_sources) for each in files]
    is_tile = [len(own) > 1 and not whole for own, whole in zip(sources, one_strip, strict=True)]
    if not any(is_tile):
        whole_files = [
            DividedStrip(name, None, (StripPart(k, np.arange(len(each.points))),))
            for k, (name, each) in enumerate(zip(names, files, strict=True))
        ]
        return whole_files, []
    found, remarks = [], []
    for strip in _in_order(_of_tiles(files, names, sources, is_tile, one_strip)):
        numbers = [len(part.numbers) for part in strip.parts]
        if strip.source is not None and (sum(numbers) < LEAST_POINTS or _moments(files, strip) < 2):
            remarks.append(
                f"point source {strip.source} has {sum(numbers)} points at {_moments(files, strip)} different times, "
                "too few for a strip: it takes no part and stays as it is"
            )
        else:
            found.append(strip)
    if len(found) > MOST_STRIPS:
        raise InvalidInputError(
            "strips", f"the points name {len(found)} point sources", f"a job has at most {MOST_STRIPS} strips; "
            "say `one_strip` where point sources are no strips",
        )  # fmt: skip
    return found, remarks


def _of_tiles(
    files: Sequence[StripRecords],
    names: Sequence[str],
    sources: Sequence[Array],
    is_tile: Sequence[bool],
    one_strip: Sequence[bool],
) -> Iterator[DividedStrip]:
    """Yield strips of files of which at least one is a tile: points of one source are one strip in all of them."""
    parts: dict[int, list[StripPart]] = {}
    for number, (file, own) in enumerate(zip(files, sources, strict=True)):
        if one_strip[number]:
            yield DividedStrip(names[number], None, (StripPart(number, np.arange(len(file.points))),))
            continue
        for source in own.tolist():
            parts.setdefault(source, []).append(StripPart(number, np.flatnonzero(file.point_sources == source)))
    for source, of_source in parts.items():
        for joined in _joined(files, of_source):
            first = joined[0].file
            if len(joined) == 1 and not is_tile[first]:
                yield DividedStrip(names[first], None, tuple(joined))
            else:
                name = f"{names[first]}-{source}" if len(joined) == 1 else f"source-{source}"
                yield DividedStrip(name, source, tuple(joined))


def _joined(files: Sequence[StripRecords], parts: Sequence[StripPart]) -> list[list[StripPart]]:
    """Put parts of one source together whose times follow each other."""
    spans = {id(part): files[part.file].gps_time_s[part.numbers[[0, -1]]] for part in parts}
    groups: list[list[StripPart]] = []
    last_s = -np.inf
    for part in sorted(parts, key=lambda each: float(spans[id(each)][0])):
        first, last = (float(value) for value in spans[id(part)])
        if not groups or first - last_s > LONGEST_PAUSE_S:
            groups.append([])
        groups[-1].append(part)
        last_s = max(last, last_s)
    return groups


def _in_order(strips: Iterator[DividedStrip]) -> list[DividedStrip]:
    return sorted(strips, key=lambda each: (min(part.file for part in each.parts), each.source or 0, each.name))


def _moments(files: Sequence[StripRecords], strip: DividedStrip) -> int:
    return len(np.unique(np.concatenate([files[part.file].gps_time_s[part.numbers] for part in strip.parts])))
