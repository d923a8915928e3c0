"""What may be said of the columns of a table, and what it means."""

import pytest

from schemas.values.text_columns import checked_columns, roles_of


@pytest.mark.parametrize(
    ("stated", "shortest"),
    [
        ("row,col,x,y,z,i", "row,col,x,y,z,i"),
        ("x y z", "x,y,z"),
        (" X; Y ;Z;Red;Green;Blue ", "x,y,z,r,g,b"),
        ("-,Easting,Northing,Height", "-,x,y,z"),
        ("t,x,y,z,class", "-,x,y,z,-"),
    ],
)
def test_a_statement_is_kept_in_its_shortest_form(stated: str, shortest: str) -> None:
    assert checked_columns(stated) == shortest


def test_the_shortest_form_means_the_same_again() -> None:
    stated = checked_columns("row,ring,id,x,y,z,whatever,i,r,g,b")
    assert checked_columns(stated) == stated


@pytest.mark.parametrize(
    ("stated", "reason"),
    [
        ("a,b,c", "no column x"),
        ("x,y", "no column z"),
        ("x,x,y,z", r"columns 1 \('x'\) and 2 \('x'\) are both x"),
        ("x,,y,z", "without a name"),
        ("x,y,z,r,g", "needs r, g and b"),
        ("x,y,z" + ",a" * 200, "at most 100 columns"),
    ],
)
def test_a_statement_that_cannot_be_is_refused_with_the_reason(stated: str, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        checked_columns(stated)


def test_n_beside_y_is_a_number_and_no_northing() -> None:
    assert roles_of(["n", "x", "y", "z"]) == ["-", "x", "y", "z"]


def test_units_behind_names_count_for_nothing() -> None:
    assert roles_of(["X[mm]", "y (ft)", "z_m"]) == ["x", "y", "z"]
