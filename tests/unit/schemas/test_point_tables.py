"""Lists of points are read as surveyors write them, or refused with the line."""

import json
from typing import Any

import pytest
from pydantic import ValidationError

from schemas.requests.find_targets_inputs import FindTargetsInputs
from schemas.requests.hybrid_network import NetworkObservations
from schemas.requests.point_tables import PointTable, points_of_table

TABLES = {
    "commas and a head": "name,x,y,z\nT1,1.5,2.25,-3\n",
    "decimal commas, semicolons": "Punkt;Rechtswert;Hochwert;Höhe\nT1;1,5;2,25;-3,0\n",
    "tabs, north first": "# national\nid\tNorth [m]\tEast [m]\tHeight [m]\nT1\t2.25\t1.5\t-3\n",
    "blanks without head": "T1   1.5  2.25   -3.0\r\n\r\n",
    "byte order mark, further columns": "\ufeffname;code;x;y;z\nT1;7;1.5;2.25;-3\n",
    "blanks and decimal commas": "T1 1,5 2,25 -3,0",
}


@pytest.mark.parametrize("text", TABLES.values(), ids=TABLES.keys())
def test_the_same_point_is_read_however_it_is_written(text: str) -> None:
    assert points_of_table(PointTable(csv=text)) == [{"name": "T1", "x": 1.5, "y": 2.25, "z": -3.0}]


def test_units_columns_and_standard_deviations_are_those_that_are_stated() -> None:
    table = PointTable(
        csv="1500 2250 -3000 7 T1 1 2 3", unit="mm", columns=["x", "y", "z", "-", "name", "std_x", "std_y", "std_z"]
    )
    point = points_of_table(table)[0]
    assert point == {"name": "T1", "x": 1.5, "y": 2.25, "z": -3.0, "std_m": pytest.approx([0.001, 0.002, 0.003])}


UNITS_IN_NAMES = {
    "millimetres": ("name,X[mm],Y[mm],Z[mm]\nT1,1500,2250,-3000\n", None),
    "behind an underscore": ("id;x_mm;y_mm;z_mm\nT1;1500;2250;-3000\n", None),
    "metres behind an underscore": ("id;x_m;y_m;z_m\nT1;1.5;2.25;-3\n", None),
    "heights apart": ("name,E [m],N [m],H [mm]\nT1,1.5,2.25,-3000\n", None),
    "deviations apart": (
        "Punkt;E;N;H;s_x [mm];s_y [mm];s_z [mm]\nT1;1.5;2.25;-3;2;2;3\n",
        [0.002, 0.002, 0.003],
    ),
    "deviations like the coordinates": ("name,X[mm],Y[mm],Z[mm],std\nT1,1500,2250,-3000,2\n", [0.002] * 3),
    "one deviation": ("name,x,y,z,std (mm)\nT1,1.5,2.25,-3,2\n", [0.002] * 3),
}


@pytest.mark.parametrize(("text", "std"), UNITS_IN_NAMES.values(), ids=UNITS_IN_NAMES.keys())
def test_units_in_the_names_of_columns_are_those_of_their_numbers(text: str, std: list[float] | None) -> None:
    (point,) = points_of_table(PointTable(csv=text))
    assert [point[axis] for axis in "xyz"] == pytest.approx([1.5, 2.25, -3.0])
    assert point.get("std_m") == (None if std is None else pytest.approx(std))


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("name,x[gon],y,z\nT1,1,2,3\n", "line 1: the unit 'gon' of the column 'x.gon.'"),
        ("name,x,y,z,std [furlong]\nT1,1,2,3,4\n", "'furlong'"),
    ],
)
def test_a_unit_that_is_not_known_is_refused_with_its_column(text: str, what: str) -> None:
    with pytest.raises(Exception, match=what.replace("'", ".")):
        points_of_table(PointTable(csv=text))


def test_a_unit_that_contradicts_the_stated_one_is_refused() -> None:
    with pytest.raises(Exception, match="`unit` says m"):
        points_of_table(PointTable(csv="name,x [mm],y,z\nT1,1,2,3\n", unit="m"))


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("name,x,y\nT1,1,2\n", "line 1"),
        ("name,x,y,height,z\nT1,1,2,3,4\n", "several columns hold z"),
        ("name,x,y,z\nT1,1,2,3\nT2,1,2\n", "line 3: 3 values, and 4 columns"),
        ("name;x;y;z\nT1;1.0;2,0;3\n", "line 2: y is '2,0'"),
        ("name,x,y,z\nT1,1,nan,3\n", "line 2: y is 'nan'"),
        ("name,x,y,z\n,1,2,3\n", "line 2: the name is empty"),
        ("# nothing\n", "no lines"),
    ],
)
def test_what_cannot_be_read_is_refused_with_its_line(text: str, what: str) -> None:
    with pytest.raises(Exception, match=what.replace("'", ".")):
        points_of_table(PointTable(csv=text))


def _inputs(names: Any) -> FindTargetsInputs:
    document = {
        "station": {"name": "A", "scan": {"file": "0" * 32}},
        "kinds": [{"kind": "sphere", "radius_m": 0.1}],
        "names": names,
    }
    return FindTargetsInputs.model_validate_json(json.dumps(document), strict=True)


def test_names_and_control_may_be_tables() -> None:
    names = _inputs({"csv": "name,x,y,z,std\nS1,1,2,3,0.004\n"}).names
    assert (names[0].name, names[0].z, names[0].std_m) == ("S1", 3.0, 0.004)
    table = {"csv": "name,x,y,z,std,use\nC1,1,2,3,0.004,control\nC2,1,2,4,0.004,check\n"}
    control = NetworkObservations.model_validate_json(json.dumps({"control": table}), strict=True).control
    assert [(each.point, each.use, each.std) for each in control] == [
        ("C1", "control", (0.004, 0.004, 0.004)),
        ("C2", "check", (0.004, 0.004, 0.004)),
    ]


def test_a_wrong_table_points_to_its_member() -> None:
    with pytest.raises(ValidationError) as caught:
        _inputs({"csv": "name,x,y,z\nS1,1,2\n"})
    assert caught.value.errors()[0]["loc"] == ("names",)
    with pytest.raises(ValidationError, match="csv"):
        _inputs({"csv": 5})
