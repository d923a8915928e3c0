"""A board's template in intensities."""

import numpy as np
from scipy import special

from algorithms.arrays import Array, Generator
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
    # two of them would be, without what ten parameters explain by chance
    assert taken == 0


def _crossing(rng: Generator, step_m: float, slope: float) -> tuple[Array, Array, Array, float]:
    """Draw a board: places, intensities with noise, the crossing, and its turn; brightness rises by a slope to its
    rim.
    """
    grid = np.arange(-0.5 * SIZE_M, 0.5 * SIZE_M, step_m) + rng.uniform(0.0, step_m)
    places = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    crossing, turn = rng.uniform(-0.02, 0.02, 2), float(rng.uniform(0.0, np.pi))
    normals = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    across = (places - crossing) @ normals
    picture = np.prod(special.erf(across / (np.sqrt(2.0) * 0.4 * step_m)), axis=1)
    values = (0.45 + 0.4 * picture) * (1.0 + slope * places[:, 0] / (0.5 * SIZE_M))
    inside = np.abs(across).max(axis=1) < 0.45 * SIZE_M
    return places[inside], (values * (1.0 + 0.03 * rng.normal(size=len(values))))[inside], crossing, turn


def test_a_crossing_is_as_certain_as_said_also_where_the_nearer_rim_is_brighter() -> None:
    rng = np.random.default_rng(4)
    squares = []
    for _ in range(60):
        step = float(rng.uniform(0.003, 0.01))
        places, values, crossing, turn = _crossing(rng, step, slope=0.04)
        fit = fit_crossing(places, values, (crossing + 0.002, turn + 0.04, 0.9), 0.5 * step, 0.25 * SIZE_M)
        assert fit is not None
        error = fit.place - crossing
        squares.append(float(error @ np.linalg.solve(fit.covariance, error)))
    # 2 +- 0.26 is one standard deviation of the mean of 60; without the slope in the model it is 12
    assert 1.3 < float(np.mean(squares)) < 2.7
