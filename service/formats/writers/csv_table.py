"""Tables as CSV: the one writer of all that carries names."""

import csv
import io
import re
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Any

from schemas.values.harmless_texts import FORMULA, HIDDEN

QUOTED = re.compile(r'[,"\r\n]|^#')
"""What needs quotes around its cell; a line that begins with # would be taken for a remark."""


def csv_text(columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Return a table as CSV: a line of names, then one a row; None is an empty cell, numbers keep all their digits.

    Texts that a spreadsheet would take for a formula get an apostrophe before it, by which spreadsheets take a cell for
    text, and breaks of lines are written out. `schemas.requests.point_tables` takes both back.
    """
    return _text_of(map(_cell, row) for row in (columns, *rows))


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
    joined = ({**by_name.get(row[first_key], {}), **row} for row in rows)
    lines = (columns, *([row.get(column, "") for column in columns] for row in joined))
    return _text_of(map(_quoted, line) for line in lines) if columns else first


def harmless(text: str) -> str:
    """Return a text of one line that no spreadsheet takes for a formula; signed numbers in it stay as they are."""
    return FORMULA.sub(r"\1\2'", HIDDEN.sub(_written_out, text))


def _written_out(found: re.Match[str]) -> str:
    return "".join(f"\\u{ord(sign):04x}" for sign in found[0])


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return repr(float(value))
    return _text_cell(value) if isinstance(value, str) else str(value)


@lru_cache(maxsize=10_000)
def _text_cell(text: str) -> str:
    """Return the cell of a text; the same names stand in many rows."""
    return _quoted(harmless(text))


def _quoted(cell: str) -> str:
    return '"{}"'.format(cell.replace('"', '""')) if QUOTED.search(cell) else cell


def _text_of(lines: Iterable[Iterable[str]]) -> str:
    return "".join(f"{','.join(line)}\n" for line in lines)
