"""Axes of cylinders whose points are rounded: as far off as their covariance says."""

import numpy as np
import pytest

from algorithms.features.cylinders.cylinder_fitting import FittedCylinder, fit_cylinder
from algorithms.geometry.lines import bases_of
from algorithms.scans.coordinate_steps import CoordinateSteps

NOISE_M, LENGTH_M, POINTS, DRAWS = 0.001, 2.0, 3000, 40


def half_pipe(
    rng: np.random.Generator, radius_m: float, direction: np.ndarray, step_m: float
) -> tuple[FittedCylinder, np.ndarray]:
    """Fit the side of a pipe that an instrument sees, rounded; give the fit and its errors (a1, a2, b1, b2, radius)."""
    centre = rng.uniform(-1.0, 1.0, 3)
    basis = bases_of(direction[None])[0]
    angles = rng.uniform(-0.5 * np.pi, 0.5 * np.pi, POINTS)
    radii = radius_m + rng.normal(0.0, NOISE_M, POINTS)
    around = np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])
    along = rng.uniform(-0.5 * LENGTH_M, 0.5 * LENGTH_M, POINTS)
    points = np.round((centre + around @ basis.T + along[:, None] * direction) / step_m) * step_m
    steps = CoordinateSteps(np.full(3, step_m))
    noise = max(NOISE_M, steps.std_m)
    fit = fit_cylinder(points, centre.copy(), direction.copy(), radius_m, noise, steps)
    assert fit is not None
    shift = fit.anchor - centre
    shift -= direction * (shift @ direction)
    return fit, np.array(
        [*(fit.basis.T @ (fit.direction - direction)), *(fit.basis.T @ shift), fit.radius_m - radius_m]
    )


@pytest.mark.parametrize(
    ("radius_m", "direction", "step_m"),
    [
        (0.06, (0.0, 0.0, 1.0), 0.01),
        (0.06, (0.0, 0.0, 1.0), 0.003),
        (0.06, (0.19, 0.1, 0.98), 0.01),
        (0.06, (0.7, 0.7, 0.0), 0.01),
        (0.5, (0.0, 0.0, 1.0), 0.02),
    ],
)
def test_axes_of_rounded_pipes_are_as_good_as_they_say(
    radius_m: float, direction: tuple[float, float, float], step_m: float
) -> None:
    rng = np.random.default_rng(5)
    unit = np.array(direction) / np.linalg.norm(direction)
    drawn = [half_pipe(rng, radius_m, unit, step_m) for _ in range(DRAWS)]
    squares = np.mean([error**2 for _, error in drawn], axis=0)
    stated = np.mean([np.diag(fit.covariance) for fit, _ in drawn], axis=0)
    for part in (slice(0, 2), slice(2, 4), slice(4, 5)):  # direction, place, radius
        # strips of a sixth of a radius decide all, and how a robust fit weighs them is known to about a third
        assert squares[part].sum() < 1.5**2 * stated[part].sum()
    nees = [float(error @ np.linalg.solve(fit.covariance, error)) for fit, error in drawn]
    assert 3.0 < np.mean(nees) < 12.0


def test_a_step_that_is_fine_beside_the_noise_changes_little() -> None:
    rng = np.random.default_rng(6)
    unit = np.array([0.0, 0.0, 1.0])
    coarse, fine = (half_pipe(rng, 0.06, unit, step)[0] for step in (1e-4, 1e-6))
    np.testing.assert_allclose(np.sqrt(np.diag(coarse.covariance)), np.sqrt(np.diag(fine.covariance)), rtol=0.3)
