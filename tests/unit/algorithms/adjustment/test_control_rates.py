"""A dozen simulated networks with control; five hundred are among the benchmarks."""

import pytest

from tests.scenes.control_rates import control_rates


@pytest.mark.slow
def test_standard_deviations_hold_and_wrong_control_points_are_found() -> None:
    rates = control_rates(12, first_seed=1000)
    assert abs(rates.coverage - 0.95) < 0.06
    assert rates.controllable > 4
    assert rates.found >= 0.95 * rates.controllable
    assert rates.false <= 1
