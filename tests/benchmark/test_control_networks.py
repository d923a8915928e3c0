"""Five hundred simulated networks with control: standard deviations hold, and wrong control points are found."""

import pytest

from tests.scenes.control_rates import control_rates

pytestmark = pytest.mark.benchmark


def test_five_hundred_networks_with_control() -> None:
    rates = control_rates(500)
    print(rates)
    assert abs(rates.coverage - 0.95) < 0.02
    assert abs(rates.nees - 1.0) < 0.05
    assert rates.controllable > 250
    assert rates.found >= 0.95 * rates.controllable
    assert rates.false <= 0.02 * 500
