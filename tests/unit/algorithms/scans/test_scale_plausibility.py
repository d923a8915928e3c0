"""Coordinates that can hardly be metres are named; what may be metres is left in peace."""

import numpy as np
import pytest

from algorithms.scans.scale_plausibility import scale_warnings
from tests.unit.algorithms.scans.test_far_points import ROOM

SENSOR = None


def warnings_of(points: np.ndarray, sensor_m: np.ndarray | None = SENSOR) -> tuple[str, ...]:
    return scale_warnings(points, sensor_m, np.random.default_rng(0))


@pytest.mark.parametrize(("unit", "per_metre"), [("millimetres", 1000.0), ("centimetres", 100.0)])
def test_a_room_in_a_small_unit_is_named_with_the_unit_in_which_it_would_be_one(unit: str, per_metre: float) -> None:
    (warning,) = warnings_of(ROOM * per_metre)
    assert f"in {unit} it would measure 8 × 6 × 3 m" in warning.lower()
    assert "Nothing is converted" in warning


@pytest.mark.parametrize("degrees_per_metre", [1e-5, 1e-4 / 9.0])
def test_degrees_of_longitude_and_latitude_beside_heights_are_named(degrees_per_metre: float) -> None:
    points = ROOM * [degrees_per_metre, degrees_per_metre, 1.0] + [8.5, 47.4, 400.0]
    (warning,) = warnings_of(points)
    assert "may be degrees of longitude and latitude" in warning


def test_a_thin_pipe_is_no_thread() -> None:
    assert warnings_of(ROOM * [0.002, 0.002, 1.0]) == ()


def test_points_farther_from_a_known_instrument_than_any_scanner_reaches_are_named() -> None:
    angle = np.linspace(0.0, 2 * np.pi, 5000)
    ring = np.column_stack([2e4 * np.cos(angle), 2e4 * np.sin(angle), 10.0 * np.sin(40.0 * angle)])
    dense = np.concatenate([ring, ring + 0.1])
    assert "instrument" in warnings_of(dense, np.zeros(3))[0]


def _rough_hills() -> np.ndarray:
    rng = np.random.default_rng(4)
    x, y = rng.uniform(0, 3000, (2, 200_000))
    return np.column_stack([x, y, 1200.0 * np.abs(np.sin(x / 900.0)) + 30.0 * np.sin(y / 50.0)])


def _strip() -> np.ndarray:
    rng = np.random.default_rng(5)
    x = rng.uniform(0.0, 3e4, 100_000)
    return np.column_stack([x, rng.uniform(0, 400, 100_000), 5.0 * np.sin(x / 300.0)])


def _tunnel() -> np.ndarray:
    rng = np.random.default_rng(6)
    angle, along = rng.uniform(0, 2 * np.pi, 60_000), rng.uniform(-3e3, 3e3, 60_000)
    return np.column_stack([along, 4.0 * np.cos(angle), 4.0 * np.sin(angle)])


@pytest.mark.parametrize(
    "points",
    [ROOM, ROOM * 0.03, ROOM * 3.28, ROOM * 12.0, _strip(), _tunnel(), _rough_hills()],
    ids=["room", "part of 0.24 m", "room in feet", "hangar", "airborne strip", "tunnel of 6 km", "hills"],
)
def test_what_may_be_metres_is_left_in_peace(points: np.ndarray) -> None:
    assert warnings_of(points) == ()
