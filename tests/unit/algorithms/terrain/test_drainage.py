"""Rain, hollows, lines and derivatives on surfaces of which the answer is known."""

import numpy as np
import pytest

from algorithms.deviations.rasters import Grid
from algorithms.terrain.drainage.derivatives import derivatives
from algorithms.terrain.drainage.hollows import hollow_paths, hollows_of
from algorithms.terrain.drainage.rain import rain_on, runoff_of_rounds
from algorithms.terrain.drainage.structure_lines import ridges, valleys

PLANE = np.array([[90, 88, 86, 84, 82], [87, 85, 83, 81, 79], [84, 82, 80, 78, 76], [81, 79, 77, 75, 73],
                  [78, 76, 74, 72, 70]], dtype=np.float64)  # fmt: skip
FIRST = np.array([[0.0, 0.4, 0.4, 0.4, 0.4], [0.6, 1, 1, 1, 1], [0.6, 1, 1, 1, 1], [0.6, 1, 1, 1, 1],
                  [0.6, 1, 1, 1, 1]])  # fmt: skip
SECOND = np.array([[0.0, 0.4, 0.6, 0.6, 0.6], [0.6, 1.5, 1.6, 1.6, 1.6], [1.0, 1.8, 2, 2, 2], [1.0, 1.8, 2, 2, 2],
                   [1.0, 1.8, 2, 2, 2]])  # fmt: skip
"""As printed, but 1.5 where 1.2 is printed: 0.4 · 1.6 + 0.6 · 1.4 = 1.48."""
EQUILIBRIUM = np.array([[0.0, 0.4, 0.6, 0.6, 0.6], [0.6, 1.5, 1.9, 2.1, 2.2], [1.0, 2.3, 3.1, 3.5, 3.8],
                        [1.2, 2.8, 4.0, 4.7, 5.1], [1.3, 3.2, 4.7, 5.7, 6.4]])  # fmt: skip
"""As printed, but 0.6 where 0.7 is printed: 0.4 + 0.4² + 0.4³ + 0.4⁴ = 0.6496."""


def test_the_sources_plane_gives_its_printed_tables() -> None:
    rain = rain_on(PLANE)
    tables = runoff_of_rounds(rain, 9)
    for table, printed in ((tables[0], FIRST), (tables[1], SECOND), (tables[7], EQUILIBRIUM)):
        np.testing.assert_array_equal(table.round(1), printed)
    np.testing.assert_array_equal(tables[8], tables[7])  # the eighth round is the equilibrium
    np.testing.assert_allclose(rain.runoff, tables[7], rtol=1e-12)


def test_all_rain_leaves_at_the_border() -> None:
    heights = np.random.default_rng(1).normal(size=(30, 40))
    rain = rain_on(heights)
    lost = (1.0 - rain.shares.sum(axis=1)) * (rain.runoff.ravel() + 1.0)
    assert lost.sum() == pytest.approx(heights.size, rel=1e-12)
    border = np.ones((30, 40), dtype=np.bool_)
    border[1:-1, 1:-1] = False
    assert (np.abs(lost[~border.ravel()]) < 1e-9).all()


def bowl(grid: Grid) -> np.ndarray:
    """Give a slope with a hollow of 1 m depth about, and another one farther down."""
    x, y = grid.centres().T
    z = 20.0 - 0.2 * x + 0.1 * np.abs(y - 10.0)
    for centre in (12.0, 28.0):
        z -= 2.0 * np.exp(-0.5 * ((x - centre) ** 2 + (y - 10.0) ** 2) / 2.0**2)
    return z.reshape(grid.shape)


def test_hollows_fill_to_the_lowest_point_of_their_rim() -> None:
    grid = Grid(0.0, 0.0, 0.5, 41, 80)
    heights = bowl(grid)
    rain = rain_on(heights)
    hollows, labels = hollows_of(heights, rain, grid.cell_m)
    deep = [each for each in hollows if each.rim_m - each.bottom_m > 0.3]
    assert len(deep) == 2
    for each in deep:
        water = rain.filled_m[labels == labels.ravel()[each.bottom]]
        np.testing.assert_allclose(water, each.rim_m)
        assert each.volume_m3 > 0.0
    paths = hollow_paths(hollows, labels, rain, grid)
    longest = max(paths, key=len)
    heights_along = longest[:, 2]
    assert (np.diff(heights_along) <= 0.0).all()
    np.testing.assert_allclose(longest[[0, -1], 0], [12.0, 28.0], atol=1.0)


def test_a_v_shaped_valley_is_one_line_along_its_bottom_and_a_roof_one_ridge() -> None:
    grid = Grid(0.0, 0.0, 1.0, 41, 60)
    x, y = grid.centres().T
    heights = (0.5 * np.abs(y - 20.5) - 0.05 * x).reshape(grid.shape)
    (valley,) = valleys(heights, rain_on(heights), grid, 200.0, 20.0)
    np.testing.assert_allclose(valley.points[:, 1], 20.5)
    np.testing.assert_allclose(valley.points[:, 2], -0.05 * valley.points[:, 0], atol=1e-12)
    assert valley.catchment_m2 > 0.8 * 41 * 60
    (ridge,) = ridges(-heights, grid, 200.0, 20.0)
    np.testing.assert_allclose(ridge.points[:, 1], 20.5)
    np.testing.assert_allclose(ridge.points[:, 2], 0.05 * ridge.points[:, 0], atol=1e-12)


def test_derivatives_of_a_quadratic_surface_are_exact() -> None:
    grid = Grid(-5.0, -5.0, 0.5, 20, 20)
    x, y = (axis.reshape(grid.shape) for axis in grid.centres().T)
    found = derivatives(0.1 * x**2 + 0.05 * x * y - 0.02 * y**2 + 0.3 * x - 0.2 * y, grid.cell_m)
    p, q = 0.2 * x + 0.05 * y + 0.3, 0.05 * x - 0.04 * y - 0.2
    inner = (slice(1, -1), slice(1, -1))
    np.testing.assert_allclose(found.slope_rad[inner], np.arctan(np.hypot(p, q))[inner], atol=1e-12)
    np.testing.assert_allclose(np.exp(1j * found.aspect_rad[inner]), ((-q - 1j * p) / np.hypot(p, q))[inner], atol=1e-9)
    assert np.isnan(found.slope_rad[0]).all()


def test_a_sphere_has_its_curvature_and_a_cone_that_of_its_contour_lines() -> None:
    grid = Grid(-5.0, -5.0, 0.1, 100, 100)
    x, y = (axis.reshape(grid.shape) for axis in grid.centres().T)
    sphere = derivatives(np.sqrt(20.0**2 - x**2 - y**2), grid.cell_m)
    np.testing.assert_allclose(sphere.mean_curvature[1:-1, 1:-1], 1.0 / 20.0, rtol=1e-3)
    np.testing.assert_allclose(sphere.profile_curvature[1:-1, 1:-1], 1.0 / 20.0, rtol=1e-3)
    cone = derivatives(-np.hypot(x, y), grid.cell_m)
    radius = np.hypot(x, y)
    far = (radius > 2.0) & np.isfinite(cone.slope_rad)
    np.testing.assert_allclose(cone.plan_curvature[far], 1.0 / radius[far], rtol=0.02)
    np.testing.assert_allclose(cone.profile_curvature[far], 0.0, atol=0.02)
    np.testing.assert_allclose(cone.slope_rad[far], np.pi / 4.0, rtol=0.01)
