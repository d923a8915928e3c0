"""No spreadsheet takes a cell of a table for a formula, and numbers are numbers."""

import csv
import io

import pytest

from schemas.requests.point_tables import PointTable, points_of_table
from service.formats.writers.csv_table import csv_text, harmless

FORMULAS = [
    "=1+1",
    "@SUM(A1)",
    "+cmd|' /C calc'!A0",
    "-2+3+cmd|' /C calc'!A0",
    "\t=1",
    "\r=1",
    " =1",
    "\uff1d1+1",
    "\uff0b1",
    "\uff0d1",
    "\uff20A1",
    "\ufeff=1",
    "\u200b=1",
    "\x00=1",
]


@pytest.mark.parametrize("name", FORMULAS)
def test_a_name_that_looks_like_a_formula_is_marked_as_text(name: str) -> None:
    (row,) = list(csv.reader(io.StringIO(csv_text(["name"], [[name]])).readlines()[1:]))
    assert row[0].lstrip(" ").startswith("'")


@pytest.mark.parametrize("between", [",", ";", "|"])
def test_a_formula_behind_what_divides_cells_elsewhere_is_marked_too(between: str) -> None:
    assert harmless(f"a{between}=1+1") == f"a{between}'=1+1"
    assert harmless(f"a{between} =1+1") == f"a{between} '=1+1"


@pytest.mark.parametrize(
    "text", ["P1", "1.5", "-1.5", "+3", "-1e-05", "a - b", "a; b", "-inf", "x=1", "2; -3.0", "2;-3.0", "-.5"]
)
def test_plain_texts_and_numbers_stay_as_they_are(text: str) -> None:
    assert harmless(text) == text


def test_numbers_keep_all_their_digits_and_nothing_is_empty() -> None:
    assert csv_text(["a", "b", "c"], [[-0.1 - 0.2, None, 7]]) == "a,b,c\n-0.30000000000000004,,7\n"


def test_a_table_of_points_is_read_back_with_the_names_that_were_written() -> None:
    names = ["=1+1", "'=1+1", "''=1+1", "'P5", "' =1+1", "'' =1+1", "' ' =1", "-P1", "+P2", "@P3", "P4"]
    text = csv_text(["name", "x", "y", "z"], [[name, 1.0, 2.0, 3.0] for name in names])
    assert [point["name"] for point in points_of_table(PointTable(csv=text))] == names
