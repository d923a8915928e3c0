"""Polynomials in time correct strips, and their derivatives are right."""

import numpy as np
import pytest

from algorithms.simulation.strip_flights import Flight, FlownStrip, Landscape, PlantedErrors, fly
from algorithms.strips.corrections import Correction, Degrees

DEGREES = Degrees(2, 1)
SIZES = np.array([0.3] * 3 + [0.1] * 6 + [1e-3] * 3 + [5e-4] * 3)


@pytest.fixture(scope="module")
def planted() -> PlantedErrors:
    rng = np.random.default_rng(5)
    return PlantedErrors(DEGREES, rng.normal(0.0, SIZES, (2, len(SIZES))), np.array([1e-3, -2e-3, 1.5e-3]))


@pytest.fixture(scope="module")
def flown(planted: PlantedErrors) -> list[FlownStrip]:
    lines = Flight.block(1, 150.0, cross=1)
    flight = Flight(lines, lines_per_s=20.0, points_per_line=60, range_std_m=0.0, angle_std_rad=0.0)
    return fly(flight, Landscape(), planted, 1)


@pytest.mark.parametrize("number", [0, 1])
def test_what_was_planted_makes_a_strip_right(flown: list[FlownStrip], planted: PlantedErrors, number: int) -> None:
    strip = flown[number].strip
    correction = Correction(strip.path, DEGREES, planted.coefficients[number], planted.boresight_rad)
    wrong = np.abs(strip.points - flown[number].true_points).max()
    left = np.abs(correction.applied(strip.points, strip.times_s) - flown[number].true_points).max()
    # the axes of the strip follow from its reported path, which wavers a little
    assert left < 0.005 < 0.3 < wrong


@pytest.mark.parametrize("with_path", [True, False])
def test_derivatives_are_those_of_differences(
    flown: list[FlownStrip], planted: PlantedErrors, *, with_path: bool
) -> None:
    strip = flown[0].strip
    if not with_path:
        strip = type(strip)(strip.name, strip.points, strip.times_s)
    points, times = strip.points[::300], strip.times_s[::300]
    along = np.random.default_rng(0).normal(size=points.shape)
    values = np.concatenate([planted.coefficients[0], planted.boresight_rad])
    count = DEGREES.count

    def moved(step: np.ndarray) -> np.ndarray:
        given = values + step
        correction = Correction(strip.path, DEGREES, given[:count], given[count:])
        return np.einsum("ni,ni->n", correction.applied(points, times), along)

    own, turn = Correction(strip.path, DEGREES, values[:count], values[count:]).derivatives(points, times, along)
    for k, expected in enumerate(np.hstack([own, turn]).T):
        step = 1e-6 * np.eye(count + 3)[k]
        np.testing.assert_allclose((moved(step) - moved(-step)) / 2e-6, expected, rtol=1e-6, atol=1e-5)


def test_a_trajectory_without_angles_flies_ahead(flown: list[FlownStrip]) -> None:
    path = flown[0].strip.trajectory
    bare = type(path)(path.times_s, path.positions_m)
    # forward is where it goes; up is up
    assert (bare.bodies[:, :, 0] @ [1.0, 0.0, 0.0] > 0.99).all()
    np.testing.assert_allclose(bare.bodies[:, 2, 2], 1.0)
