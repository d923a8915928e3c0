"""A board's template in intensities."""

import numpy as np

from algorithms.targets.board_template import fit_crossing, searched_crossing
from algorithms.targets.boards import LEAST_AGREEMENT

SIZE_M = 0.15


def test_twenty_points_of_noise_are_no_crossing_by_chance() -> None:
    rng = np.random.default_rng(6)
    taken = 0
    for _ in range(40):
        places = rng.uniform(-0.4 * SIZE_M, 0.4 * SIZE_M, (20, 2))
        values = rng.normal(1.0, 0.3, 20)
        fit = fit_crossing(places, values, searched_crossing(places, values, SIZE_M), 0.01, 0.25 * SIZE_M)
        taken += fit is not None and fit.agreement > LEAST_AGREEMENT
    # two of them would be, without what eight parameters explain by chance
    assert taken == 0
