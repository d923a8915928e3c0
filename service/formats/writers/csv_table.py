"""Tables as CSV: the one writer of all that carries names."""

import csv
import io
import re
from collections.abc import Iterable, Sequence
from typing import Any

FORMULA = re.compile(
    r"(^|[,;|])(\s*)(?=('['\s]*)?[=+\-@\uFF1D\uFF0B\uFF0D\uFF20])(?![+-]\s?([\d.]+([eE][+-]?\d+)?|inf)\s*($|[,;|]))"
)
"""Where a spreadsheet would begin to read a formula: at the start of a cell, or behind what may divide cells. Where an
apostrophe stands before it already it gets another one, so that both are told apart when they are read again."""
UNSEEN = re.compile(r"[\x00-\x1f\x7f\u200b-\u200f\u2028-\u202e\u2060\ufeff]+")
"""Breaks of lines, and signs that nobody sees, behind which a formula could hide."""


def csv_text(columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Return a table as CSV: a line of names, then one a row; None is an empty cell, numbers keep all their digits.

    Texts that a spreadsheet would take for a formula get an apostrophe before it, by which spreadsheets take a cell for
    text. `schemas.requests.point_tables` takes it away again.
    """
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow([harmless(column) for column in columns])
    table.writerows([_cell(value) for value in row] for row in rows)
    return text.getvalue()


def joined_tables(first: str, second: str, first_key: str, second_key: str) -> str:
    """Return the rows of a table with the columns of another one behind theirs, by the names that stand in both.

    Parameters
    ----------
    first, second
        Tables as `csv_text` writes them; a column that both have stays as the first has it.
    first_key, second_key
        Column of the name in each, which is that of one row.
    """
    rows, others = (list(csv.DictReader(io.StringIO(text))) for text in (first, second))
    by_name = {row[second_key]: row for row in others}
    columns = list(dict.fromkeys([*rows[0], *others[0]])) if rows and others else []
    text = io.StringIO()
    table = csv.DictWriter(text, columns, restval="", lineterminator="\n")
    table.writeheader()
    table.writerows({**by_name.get(row[first_key], {}), **row} for row in rows)
    return text.getvalue() if columns else first


def harmless(text: str) -> str:
    """Return a text of one line that no spreadsheet takes for a formula; signed numbers in it stay as they are."""
    return FORMULA.sub(r"\1\2'", UNSEEN.sub(" ", text))


def _cell(value: Any) -> Any:
    if value is None:
        return ""
    if isinstance(value, float):
        return repr(float(value))
    return harmless(value) if isinstance(value, str) else value
