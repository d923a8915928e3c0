"""Slices as normal distributions: derivatives, levelling, and the pose of a drawn street."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from algorithms.distributions.layer_registration import cell_sizes, match_layers
from algorithms.distributions.layers import LayerDistributions, Layers, distributions_of, score_in


def street(rng: np.random.Generator, *, turn_rad: float = 0.0, shift: tuple[float, float] = (0.0, 0.0)) -> Layers:
    """Two rows of fronts of unequal depth and a house across the end, in two slices, moved."""
    corners = [(-30, 6), (-12, 6), (-12, 8), (5, 8), (5, 5.5), (25, 5.5), (25, -7), (-3, -7), (-3, -5), (-30, -5)]
    points = []
    for (x0, y0), (x1, y1) in pairwise(corners):
        along = rng.uniform(0.0, 1.0, int(12 * np.hypot(x1 - x0, y1 - y0)))[:, None]
        points.append(np.array([x0, y0]) + along * np.array([x1 - x0, y1 - y0]))
    joined = np.concatenate(points) + rng.normal(0.0, 0.01, (sum(map(len, points)), 2))
    cosine, sine = np.cos(turn_rad), np.sin(turn_rad)
    moved = (joined - shift) @ np.array([[cosine, -sine], [sine, cosine]])
    return Layers(np.ascontiguousarray(moved), rng.integers(0, 2, len(moved)), 2)


def distributions(cell_m: float) -> LayerDistributions:
    return distributions_of(street(np.random.default_rng(1)), cell_m)


def test_gradient_and_hessian_are_those_of_differences() -> None:
    source = street(np.random.default_rng(2)).thinned(400)
    pose, at = np.array([0.31, -0.17, 0.02]), distributions(8.0)
    step = 1e-5
    here = score_in(at, source, pose)
    for k in range(3):
        # points that change their cell make the score jump: the cells of one pose are kept by a short step
        ahead, behind = (score_in(at, source, pose + sign * step * np.eye(3)[k]) for sign in (1.0, -1.0))
        assert (ahead.value - behind.value) / (2 * step) == pytest.approx(here.gradient[k], rel=1e-4, abs=1e-3)
        np.testing.assert_allclose(
            (ahead.gradient - behind.gradient) / (2 * step),
            here.hessian[k],
            rtol=1e-3,
            atol=1e-2 * abs(here.hessian).max(),
        )


def test_the_largest_cells_fall_to_the_smallest_in_equal_ratios() -> None:
    sizes = cell_sizes(250.0, 2.0, 8)
    assert len(sizes) == 8
    np.testing.assert_allclose(np.diff(np.log(sizes)), np.log(2.0 / 250.0) / 7)


def test_a_street_is_found_from_any_heading() -> None:
    target = street(np.random.default_rng(3))
    source = street(np.random.default_rng(4), turn_rad=2.0, shift=(7.0, -1.5))
    starts = np.array([[0.0, 0.0, heading] for heading in np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)])
    best = match_layers(target, source, cell_sizes(250.0, 2.0, 8), starts, 20.0)[0]
    np.testing.assert_allclose(best.pose[:2], [7.0, -1.5], atol=0.03)
    assert np.degrees(Rotation.from_euler("z", best.pose[2] - 2.0).magnitude()) < 0.1
