"""Known places on surfaces that are no planes."""

import numpy as np
import pytest

from algorithms.strips.control import ControlPatch
from algorithms.strips.homologous import PointCells
from algorithms.strips.strip import Strip

RADIUS_M, NOISE_M = 4.0, 0.02
BOWL = np.array([0.004, 0.001, 0.002])
"""Of u², u v and v² [1/m]."""


def strip_over_a_bowl(seed: int, *, crowns: float = 0.0) -> Strip:
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-8.0, 8.0, (2, 600))
    z = BOWL @ [x * x, x * y, y * y] + 0.1 * x + rng.normal(0.0, NOISE_M, len(x))
    z += (rng.random(len(x)) < crowns) * rng.uniform(1.0, 5.0, len(x))
    return Strip("bowl", np.column_stack([x, y, z]), np.linspace(0.0, 1.0, len(x)))


def moved(seed: int, crowns: float) -> tuple[float, float]:
    known = ControlPatch("height", np.zeros((1, 3)), np.full((1, 3), 1e-6))
    strips = [strip_over_a_bowl(2 * seed, crowns=crowns), strip_over_a_bowl(2 * seed + 1, crowns=crowns)]
    cells = [PointCells.of(strip.points, RADIUS_M) for strip in strips]
    frame = np.eye(3)
    places, stds = known.on_plane(frame, strips, cells, RADIUS_M)
    return float(places[0, 2]), float(stds[0, 2])


@pytest.mark.parametrize("crowns", [0.0, 0.1])
def test_a_height_in_a_bowl_is_compared_with_the_plane_above_its_middle(crowns: float) -> None:
    truth = (BOWL[0] + BOWL[2]) * RADIUS_M**2 / 4.0
    heights, stds = np.array([moved(seed, crowns) for seed in range(60)]).T
    assert abs(heights.mean() - truth) < 0.001
    # points far off are left out by three deviations: those that stay scatter a little less than all
    assert 0.8 < ((heights - truth) ** 2 / stds**2).mean() < 1.5


def test_four_known_points_make_their_own_plane() -> None:
    corners = np.array([[-5.0, -5.0, 0.0], [5.0, -5.0, 0.0], [5.0, 5.0, 0.0], [-5.0, 5.0, 0.0]])
    known = ControlPatch("roof", corners, np.full((4, 3), 0.01))
    strip = strip_over_a_bowl(0)
    places, stds = known.on_plane(np.eye(3), [strip], [PointCells.of(strip.points, RADIUS_M)], RADIUS_M)
    assert np.array_equal(places, corners)
    assert np.array_equal(stds, known.std_m)
