"""Least squares: the optimum, and variances that few residuals tell."""

import numpy as np
import pytest

from algorithms.arrays import Array
from algorithms.targets.damped_fit import damped_fit, residual_covariance


def test_the_sum_of_squares_is_least_at_the_solution() -> None:
    t = np.linspace(0.0, 2.0, 30)
    values = 3.0 * np.exp(-0.7 * t)

    def model(x: Array) -> tuple[Array, Array]:
        decay = np.exp(-x[1] * t)
        return x[0] * decay - values, np.column_stack([decay, -x[0] * t * decay])

    fit = damped_fit(model, np.array([1.0, 0.1]), most_evaluations=50)
    assert fit.solution == pytest.approx([3.0, 0.7], abs=1e-7)
    np.testing.assert_allclose(fit.jacobian, model(fit.solution)[1])


def test_a_parameter_that_few_measurements_tell_scatters_no_more_than_its_variance_says() -> None:
    rng = np.random.default_rng(3)
    # six of fifty measurements tell the second parameter
    design = np.column_stack([np.ones(50), np.where(np.arange(50) < 6, 1.0, 0.0)])
    gain = design @ np.linalg.inv(design.T @ design)
    squares = []
    for errors in rng.normal(size=(2000, 50)):
        shift = gain.T @ errors
        squares.append(shift**2 / np.diag(residual_covariance(design, gain, errors - design @ shift)))
    first, second = np.mean(squares, axis=0)
    # HC3 is cautious where the leverage is high, by a sixth here; without degrees of freedom the second would be 1.25
    assert first == pytest.approx(1.0, abs=0.1)
    assert 0.65 < second < 1.0
