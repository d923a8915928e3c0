"""Points as lines of numbers: PTS and XYZ."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np

from algorithms.arrays import Array
from algorithms.progress import Progress
from service.formats.intensities import FULL_SCALES, LARGEST_PTS, LEAST_PTS, unit_intensities
from service.formats.writers.base import PointPiece, StationCloud, Written
from service.formats.writers.placed import PlacedClouds, in_world, placed, scalar_of
from service.formats.writers.whole_files import whole_file

LINES_AT_ONCE = 100_000
COORDINATE = "%.5f"
"""Hundredths of a millimetre."""
NUMBERS = {"f4": "%.6g", "f8": "%.16g"}
"""How numbers of a kind are printed; times of 10 digits before the point keep microseconds."""
NO_POSES = "the points are in the world frame: a table of points has no place for poses and grids"
STRETCHED = "intensities were brought to -2048 … 2047, as PTS has them"


@final
@dataclass(frozen=True)
class XyzWriter:
    """Write a table with a line of column names: coordinates, intensity, colours, further numbers."""

    name: str = "xyz"
    ending: str = ".xyz"
    media_type: str = "text/plain"

    def write(self, path: Path, clouds: Sequence[StationCloud], progress: Progress) -> Written:
        """Write stations into one file in the world frame."""
        everything = placed(clouds, with_stations=len(clouds) > 1)
        names = ["x", "y", "z"]
        line = [COORDINATE] * 3
        if everything.has_intensity:
            names, line = [*names, "intensity"], [*line, "%.9g"]
        if everything.has_color:
            names, line = [*names, "red", "green", "blue"], [*line, "%d", "%d", "%d"]
        for scalar in everything.scalars:
            names, line = [*names, scalar.name], [*line, NUMBERS.get(scalar.kind, "%d")]
        with whole_file(path) as partial, partial.open("w", encoding="ascii", newline="\n") as stream:
            stream.write("//" + " ".join(names) + "\n")
            for _, cloud, piece in everything.pieces(progress):
                columns = _columns(everything, cloud, piece)
                columns += [scalar_of(piece, scalar) for scalar in everything.scalars]
                for lines in text_lines(columns, " ".join(line)):
                    stream.write(lines)
        return Written(everything.points, (NO_POSES,))


@final
@dataclass(frozen=True)
class PtsWriter:
    """Write PTS: per station the number of its points, then x y z, intensity and colours."""

    name: str = "pts"
    ending: str = ".pts"
    media_type: str = "text/plain"

    def write(self, path: Path, clouds: Sequence[StationCloud], progress: Progress) -> Written:
        """Write stations into one file, one block each, in the world frame."""
        everything = placed(clouds)
        line = " ".join([COORDINATE] * 3 + ["%d"] * (1 if not everything.has_color else 4))
        begun = -1
        with whole_file(path) as partial, partial.open("w", encoding="ascii", newline="\n") as stream:
            for number, cloud, piece in everything.pieces(progress):
                if number != begun and cloud.facts is not None:
                    stream.write(f"{cloud.facts.points}\n")
                    begun = number
                columns = _columns(everything, cloud, piece, always_intensity=True)
                columns[3] = _pts_intensity(cloud, piece)
                for lines in text_lines(columns, line):
                    stream.write(lines)
        notes = [NO_POSES, *([STRETCHED] if everything.has_intensity else []), *_coarse(everything.clouds)]
        return Written(everything.points, (*notes, *no_columns("PTS", everything)))


def no_columns(what: str, clouds: PlacedClouds) -> tuple[str, ...]:
    """Say which further numbers of the points a format loses."""
    names = ", ".join(scalar.name for scalar in clouds.scalars)
    return (f"{what} has no columns for further numbers ({names}); E57, PLY, PCD, XYZ and LAZ have",) if names else ()


def text_lines(columns: Sequence[Array], line: str) -> Sequence[str]:
    """Give a table as text, some lines at a time.

    Parameters
    ----------
    columns
        (n,) numbers each.
    line
        How a line is printed, for the operator `%`.
    """
    texts = []
    for start in range(0, len(columns[0]), LINES_AT_ONCE):
        block = np.column_stack([np.asarray(c[start : start + LINES_AT_ONCE], dtype=np.float64) for c in columns])
        texts.append((line + "\n") * len(block) % tuple(block.ravel().tolist()))
    return texts


def _columns(
    clouds: PlacedClouds, cloud: StationCloud, piece: PointPiece, *, always_intensity: bool = False
) -> list[Array]:
    columns: list[Array] = list(in_world(cloud, piece, np.zeros(3)).T)
    if clouds.has_intensity or always_intensity:
        columns.append(np.zeros(len(piece)) if piece.intensity is None else piece.intensity)
    if clouds.has_color:
        columns += list(np.zeros((3, len(piece))) if piece.color is None else piece.color.T)
    return columns


def _pts_intensity(cloud: StationCloud, piece: PointPiece) -> Array:
    limits = None if cloud.facts is None else cloud.facts.intensity_limits
    if piece.intensity is None or limits is None:
        return np.zeros(len(piece))
    shares = unit_intensities(piece.intensity, limits, cloud.intensity_scale)
    return np.asarray(np.rint(LEAST_PTS + (LARGEST_PTS - LEAST_PTS) * shares))


def _coarse(clouds: Sequence[StationCloud]) -> Iterator[str]:
    """Describe where the 12 bits of PTS leave fewer steps of intensities than 8 bits have."""
    for cloud in clouds:
        limits = None if cloud.facts is None else cloud.facts.intensity_limits
        if cloud.intensity_scale is None or limits is None or limits[1] <= 0.0:
            continue
        steps = (LARGEST_PTS - LEAST_PTS) * limits[1] / cloud.intensity_scale
        if steps < min(limits[1], FULL_SCALES[1]):
            yield (
                f"{cloud.name}: intensities up to {limits[1]:.6g} of {cloud.intensity_scale:.0f} have only "
                f"{math.ceil(steps)} steps in PTS"
            )
