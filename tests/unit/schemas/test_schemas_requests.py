"""Request models: what they take from the numerics, and what they refuse."""

from dataclasses import dataclass, field
from typing import Annotated

import pytest
from annotated_types import Gt
from pydantic import TypeAdapter, ValidationError

from schemas.requests.method_options import options_model
from schemas.values.rigid_matrix import RigidMatrix


@dataclass(frozen=True)
class Inner:
    """What counts."""

    limit: int = 3
    """Most of them."""


@dataclass(frozen=True)
class Outer:
    """How it is done."""

    tolerance_m: Annotated[float, Gt(0.0)] = 0.5
    """Largest distance [m]."""
    inner: Inner = field(default_factory=lambda: Inner(limit=7))
    """Parts."""


def test_options_take_over_defaults_docstrings_and_bounds() -> None:
    schema = options_model(Outer, "outer").model_json_schema()["properties"]
    assert schema["tolerance_m"]["default"] == 0.5
    assert schema["tolerance_m"]["description"] == "Largest distance [m]."
    assert schema["tolerance_m"]["exclusiveMinimum"] == 0.0


def test_nested_options_keep_the_default_of_the_outer_ones() -> None:
    assert options_model(Outer)().model_dump() == {"tolerance_m": 0.5, "inner": {"limit": 7}}


def test_nested_options_can_be_given_in_part() -> None:
    assert options_model(Outer)(inner={"limit": 1}).model_dump()["inner"] == {"limit": 1}


@pytest.mark.parametrize("options", [{"tolerance_m": 0.0}, {"speed": 1}, {"inner": {"speed": 1}}, {"method": "other"}])
def test_options_out_of_bounds_or_unknown_are_refused(options: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        options_model(Outer, "outer")(**options)


QUARTER_TURN = [[0.0, -1.0, 0.0, 5.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]


def test_a_rigid_motion_is_taken_as_it_stands() -> None:
    assert TypeAdapter(RigidMatrix).validate_python(QUARTER_TURN) == QUARTER_TURN


def test_a_rotation_with_rounded_digits_is_taken() -> None:
    rounded = [[0.7071, -0.7071, 0.0, 0.0], [0.7071, 0.7071, 0.0, 0.0], *QUARTER_TURN[2:]]
    assert TypeAdapter(RigidMatrix).validate_python(rounded) == rounded


@pytest.mark.parametrize("factor", [0.99, 1.01, 0.0, 1e200, float("nan")])
def test_a_matrix_with_a_scale_is_no_rigid_motion(factor: float) -> None:
    scaled = [[factor * value for value in row[:3]] + row[3:] for row in QUARTER_TURN[:3]] + QUARTER_TURN[3:]
    with pytest.raises(ValidationError):
        TypeAdapter(RigidMatrix).validate_python(scaled)
