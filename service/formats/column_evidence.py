"""Which columns of a table without names are coordinates, by what stands in them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array

FEW_LINES = 4
"""With fewer lines nothing can be told of a column."""
SOME_LINES = 20
ENOUGH_LINES = 100
"""With fewer lines a column says little by what it does not hold."""
MOSTLY = 0.8
WIDEST_CODE = 256
"""Numbers of rings, rows of a scanner's block, classes and colours stay below it."""
LARGEST_DIRECTION = 1.0001


class UnclearColumnsError(Exception):
    """Say why it cannot be told which columns are coordinates."""


@dataclass(frozen=True)
class ColumnEvidence:
    """What a sample of lines shows of one column."""

    low: float
    high: float
    is_word: bool
    is_whole: bool
    """Every number is a whole one."""
    is_counting: bool
    """Every line differs from the one before by the same step."""
    is_rising: bool
    """From line to line it always rises (a whole number may stay), or always falls."""
    is_cycling: bool
    """Whole numbers, most of which differ from the one before by the same step."""

    @property
    def is_index(self) -> bool:
        """Tell whether it looks like numbers of points, rows, columns, rings or times, and not like a coordinate."""
        return self.is_counting or (self.is_whole and self.low < self.high and (self.is_rising or self.is_cycling))

    @property
    def is_fraction(self) -> bool:
        """Tell whether it holds numbers that are not whole."""
        return not (self.is_word or self.is_whole)

    def in_words(self) -> str:
        """Describe it for people."""
        if self.is_word:
            return "words"
        kind = "whole numbers" if self.is_whole else "fractions"
        if self.is_counting:
            kind += ", counting"
        elif self.is_rising and self.low < self.high:
            kind += ", always rising or falling"
        elif self.is_cycling:
            kind += ", mostly counting"
        return f"{self.low:.10g} to {self.high:.10g} ({kind})"


def column_evidence(blocks: Sequence[Array]) -> list[ColumnEvidence]:
    """Look at the columns of some lines.

    Parameters
    ----------
    blocks
        (n, columns) numbers of consecutive lines each, in the order of the file; infinite where there is a word.
    """
    return [_of_column([block[:, at] for block in blocks]) for at in range(blocks[0].shape[1])]


def coordinate_column(columns: Sequence[ColumnEvidence], lines: int) -> int:
    """Give the number, from 0, of the first of three columns that are coordinates.

    A column of whole numbers, or one that counts, before columns of fractions is no coordinate.

    Parameters
    ----------
    columns
        What is known of each.
    lines
        Lines of the sample.

    Raises
    ------
    UnclearColumnsError
        It cannot be told.
    """
    if len(columns) < 3:
        raise UnclearColumnsError("there are fewer than three columns")
    if lines < FEW_LINES:
        return 0
    first = next((at for at, column in enumerate(columns) if _may_be_coordinate(column)), len(columns))
    three = columns[first : first + 3]
    if len(three) == 3 and all(column.is_fraction for column in three):
        _require_clear(columns, first)
        return first
    if first == 0:
        if any(column.is_word for column in three):
            raise UnclearColumnsError("words stand between the numbers")
        _require_no_code_between(columns)
        return 0
    if any(column.is_word for column in columns[:3]):
        raise UnclearColumnsError("words stand in the first columns")
    if any(column.is_index for column in columns[:3]):
        raise UnclearColumnsError("the first columns look like numbers of points, rows, columns, rings or times")
    if len(columns) > 3 and lines >= ENOUGH_LINES and not _look_alike(columns[:3]):
        raise UnclearColumnsError("whole numbers stand in the first columns")
    return 0


def _may_be_coordinate(column: ColumnEvidence) -> bool:
    return column.is_fraction and not column.is_counting


def _require_clear(columns: Sequence[ColumnEvidence], first: int) -> None:
    """Refuse what could be read in two ways."""
    after = columns[first + 3 : first + 4]
    if columns[first].is_rising and after and after[0].is_fraction:
        raise UnclearColumnsError(
            f"column {first + 1} always rises or falls, as times do, and three columns of fractions follow"
        )
    leading = [column for column in columns[:first] if not column.is_word]
    if len(leading) < 3:
        return
    small = all(max(abs(each.low), abs(each.high)) <= LARGEST_DIRECTION for each in columns[first : first + 3])
    if small or (first == 3 and _look_alike(leading)):
        raise UnclearColumnsError(
            "three columns of whole numbers and three of fractions: coordinates may be the ones or the others"
        )


def _require_no_code_between(columns: Sequence[ColumnEvidence]) -> None:
    """Refuse a column of whole numbers among the first three where a fourth has fractions."""
    if len(columns) < 4 or not columns[3].is_fraction:
        return
    for at, column in enumerate(columns[:3]):
        if column.is_whole and column.low < column.high:
            raise UnclearColumnsError(f"column {at + 1} holds whole numbers only, the ones around it fractions")


def _look_alike(columns: Sequence[ColumnEvidence]) -> bool:
    """Tell whether whole numbers may well be coordinates in small units."""
    return all(column.high - column.low > WIDEST_CODE and not column.is_index for column in columns)


def _of_column(parts: Sequence[Array]) -> ColumnEvidence:
    everything = np.concatenate(parts)
    values = everything[np.isfinite(everything)]
    is_word = bool(2 * np.count_nonzero(np.isinf(everything)) > len(everything))
    if is_word or len(values) == 0:
        unknown = {"is_whole": False, "is_counting": False, "is_rising": False, "is_cycling": False}
        return ColumnEvidence(np.nan, np.nan, is_word=is_word, **unknown)
    within = np.concatenate([np.diff(part) for part in parts])
    across = np.diff(everything)
    is_whole = bool((values == np.round(values)).all())
    step = float(np.median(within)) if len(within) else 0.0
    equal = np.abs(within - step) <= (0.0 if is_whole else 0.02 * abs(step))
    moving = within[within != 0.0]
    usual = _most_frequent(moving) if is_whole and len(moving) else 0.0
    return ColumnEvidence(
        low=float(values.min()),
        high=float(values.max()),
        is_word=False,
        is_whole=is_whole,
        is_counting=len(within) >= FEW_LINES - 1 and step != 0.0 and bool(equal.all()),
        is_rising=_is_rising(across, is_whole=is_whole),
        is_cycling=len(within) >= SOME_LINES and usual != 0.0 and bool(np.mean(within == usual) >= MOSTLY),
    )


def _is_rising(steps: Array, *, is_whole: bool) -> bool:
    """Tell whether numbers always rise or always fall; whole numbers may stay where there are many."""
    if len(steps) < FEW_LINES - 1:
        return False
    if (steps > 0.0).all() or (steps < 0.0).all():
        return True
    return is_whole and len(steps) >= SOME_LINES and bool((steps >= 0.0).all() or (steps <= 0.0).all())


def _most_frequent(values: Array) -> float:
    found, counts = np.unique(values, return_counts=True)
    return float(found[np.argmax(counts)])
