"""No spreadsheet takes a cell of a table for a formula, and numbers are numbers."""

import csv
import io

import pytest
from hypothesis import given
from hypothesis import strategies as st

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


HARD = "=+-@'\" ,;|\t\n\r\\u0aé1#\u200f\u200b\ufeff\x00\x85\u2028\u3000\uff1d<>"


@given(st.lists(st.text(alphabet=HARD, min_size=1, max_size=12) | st.text(min_size=1), min_size=1, max_size=8))
def test_whatever_points_are_called_no_cell_is_a_formula_and_their_names_come_back(names: list[str]) -> None:
    text = csv_text(["name", "x", "y", "z"], [[name, 1.5, -2.5, 3.5] for name in names])
    cells = [row[0] for row in csv.reader(io.StringIO(text))][1:]
    assert not [cell for cell in cells if cell.strip("\u200b\u200f\ufeff").startswith(("=", "@", "\uff1d"))]
    assert len(text.splitlines()) == len(names) + 1
    assert [point["name"] for point in points_of_table(PointTable(csv=text))] == names


def test_a_name_that_begins_like_a_remark_is_none() -> None:
    text = csv_text(["name", "x", "y", "z"], [["#12", 1.0, 2.0, 3.0]])
    assert text.splitlines()[1] == '"#12",1.0,2.0,3.0'
    assert [point["name"] for point in points_of_table(PointTable(csv=text))] == ["#12"]


def test_breaks_of_lines_are_written_out_and_signs_of_direction_stay() -> None:
    assert harmless("a\tb\nc") == r"a\u0009b\u000ac"
    assert harmless(r"a\u0009b") == r"a\u005cu0009b"
    assert harmless("\u200fאב") == "\u200fאב"
    assert harmless("\u200f=1") == "'\u200f=1"
