"""Surfaces on a grid, their maps and colours, and patterns in their difference."""

import numpy as np
import pytest

from algorithms.deviations import colour_classes as colours
from algorithms.deviations.rasters import Grid, grid_over, heights_at, raster_surface, viewed_along, wished_cell
from algorithms.deviations.surface_maps import density_map, distance_map, residuals_of, rms_map
from algorithms.deviations.surface_patterns import surface_pattern
from algorithms.errors import InvalidInputError

GRID = Grid(0.0, 0.0, 1.0, 40, 60)
HEIGHT_M, SPEED_M_S, LINES_PER_S, ROLL_RAD, LAG_PERIOD_M = 200.0, 60.0, 100.0, 0.15, 15.0


def terrain(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return 3.0 * np.sin(u / 15.0) + 2.0 * np.cos(v / 11.0)


def points_on_terrain(seed: int, count: int, noise_m: float) -> np.ndarray:
    rng = np.random.default_rng(seed)
    uv = rng.uniform([0.0, 0.0], [60.0, 40.0], (count, 2))
    return np.column_stack([uv, terrain(*uv.T) + rng.normal(0.0, noise_m, count)])


def flown_strip(seed: int, lag_s: float) -> np.ndarray:
    """Simulate a strip flown north with a polygon mirror whose angle is recorded too late, or too early."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 1.5, 1.0 / 25_000.0) + rng.uniform(0.0, 1e-4)
    rate = 2.0 * ROLL_RAD * LINES_PER_S
    true = ROLL_RAD * (2.0 * ((t * LINES_PER_S) % 1.0) - 1.0)
    recorded = true - rate * lag_s * np.sin(2.0 * np.pi * SPEED_M_S * t / LAG_PERIOD_M)
    ranges = HEIGHT_M / np.cos(true) + rng.normal(0.0, 0.02, len(t))
    return np.column_stack([ranges * np.sin(recorded), SPEED_M_S * t, HEIGHT_M - ranges * np.cos(recorded)])


def test_a_tilted_plane_is_exact_wherever_its_points_lie() -> None:
    rng = np.random.default_rng(1)
    uv = rng.uniform([0.0, 0.0], [60.0, 40.0], (9000, 2))
    surface = raster_surface(np.column_stack([uv, 0.7 * uv[:, 0] - 0.3 * uv[:, 1] + 5.0]), GRID)
    centres = GRID.centres()
    expected = (0.7 * centres[:, 0] - 0.3 * centres[:, 1] + 5.0).reshape(GRID.shape)
    known = np.isfinite(surface.heights_m)
    assert known.mean() > 0.99
    assert np.abs(surface.heights_m - expected)[known].max() < 1e-9


def test_the_standard_deviation_of_heights_is_honest_on_a_plane() -> None:
    found = []
    for seed in range(2, 10):
        rng = np.random.default_rng(seed)
        uv = rng.uniform([0.0, 0.0], [60.0, 40.0], (12_000, 2))
        surface = raster_surface(np.column_stack([uv, rng.normal(0.0, 0.05, len(uv))]), GRID)
        found.append((surface.heights_m / surface.std_m)[np.isfinite(surface.std_m)])
    ratios = np.concatenate(found)
    assert np.sqrt(np.mean(ratios**2)) == pytest.approx(1.0, abs=0.05)


def test_points_on_one_line_make_no_surface() -> None:
    line = np.column_stack([np.linspace(0.0, 60.0, 500), np.full(500, 20.3), np.zeros(500)])
    assert np.isnan(raster_surface(line, GRID).heights_m).all()


def test_density_counts_points_per_area_and_distance_reaches_the_nearest() -> None:
    uvh = np.array([[0.5, 0.5, 1.0], [0.6, 0.6, 1.0], [10.5, 0.5, 2.0]])
    coarse = Grid(0.0, 0.0, 5.0, 1, 3)
    assert density_map(uvh, coarse).tolist() == [[2 / 25, 0.0, 1 / 25]]
    assert distance_map(uvh, Grid(0.0, 0.0, 1.0, 1, 4))[0] == pytest.approx(
        [0.0, np.hypot(0.9, 0.1), 1.9026, 2.9017], abs=1e-4
    )


def test_residuals_show_where_the_points_leave_the_surface() -> None:
    uvh = points_on_terrain(3, 20_000, 0.02)
    surface = raster_surface(uvh, GRID)
    raised = uvh[:, 0] < 5.0
    uvh[raised, 2] += 0.6
    residuals = residuals_of(uvh, surface.heights_m, GRID)
    rms = rms_map(uvh, residuals, Grid(0.0, 0.0, 5.0, 8, 12))
    assert (rms[:, 0] > 0.5).all()
    assert (rms[1:-1, 1:-1] < 0.1).all()
    assert np.isnan(heights_at(surface.heights_m, GRID, np.array([[-3.0, 5.0, 0.0]])))[0]


def test_a_wall_is_seen_from_where_its_normal_points() -> None:
    seen = viewed_along(np.array([[1.0, -2.0, 3.0]]), np.array([0.0, -1.0, 0.0]))
    assert seen.tolist() == [[1.0, 3.0, 2.0]]
    assert viewed_along(np.array([[1.0, -2.0, 3.0]]), np.array([0.0, 0.0, 1.0])).tolist() == [[1.0, -2.0, 3.0]]


def test_surfaces_of_different_places_have_no_grid() -> None:
    here = points_on_terrain(4, 100, 0.0)
    there = here + np.array([500.0, 0.0, 0.0])
    with pytest.raises(InvalidInputError, match="no area in common"):
        grid_over([here, there], 1.0, overlap=True)
    with pytest.raises(InvalidInputError, match="too many"):
        grid_over([here, here], 1e-4, overlap=True)
    assert wished_cell(10_000, (60.0, 40.0), 4.0) == 1.0


def test_the_classes_are_those_of_the_source() -> None:
    def painted(classes: colours.ColourClasses, value: float) -> tuple[int, ...]:
        return tuple(classes.colours_of(np.array([value]))[0].tolist())

    assert painted(colours.DISTANCE_CLASSES, 0.5) == (0, 100, 0)
    assert painted(colours.DISTANCE_CLASSES, 2.0) == (255, 255, 0)
    assert painted(colours.DISTANCE_CLASSES, 5.1) == (139, 0, 0)
    assert painted(colours.RMS_CLASSES, 0.51) == (139, 0, 0)
    density = colours.density_classes(4.64)
    assert painted(density, 0.0) == (255, 255, 255)
    assert painted(density, 0.77) == colours.DENSITY_COLOURS[0]  # the source: up to 0.77 points a square metre
    assert painted(density, 4.64) == colours.DENSITY_COLOURS[-1]
    assert painted(colours.deviation_classes(0.01), 0.0) == (255, 255, 255)
    assert painted(colours.deviation_classes(0.01), np.nan) == (255, 255, 255)
    red, _, blue = painted(colours.deviation_classes(0.01), 0.02)
    assert red > blue
    assert colours.DISTANCE_CLASSES.picture(np.array([[0.0, 9.0]]), pixels=2).shape == (2, 4, 3)


def test_a_scan_lag_is_found_with_its_direction_and_period() -> None:
    first, second = flown_strip(1, 0.0), flown_strip(2, 1e-5)
    grid = grid_over([first, second], 1.0, overlap=True)
    difference = raster_surface(second, grid).heights_m - raster_surface(first, grid).heights_m
    found = surface_pattern(difference, grid)
    assert found.significant
    assert found.wavelength_m == pytest.approx(LAG_PERIOD_M, rel=0.1)
    assert found.stripes_azimuth_gon == pytest.approx(100.0, abs=20.0)


def test_without_scan_lag_no_pattern_is_found() -> None:
    significant = 0
    for seed in range(30):
        surfaces = []
        grid = Grid(-25.0, 0.0, 1.0, 90, 50)
        surfaces = [raster_surface(flown_strip(2 * seed + k, 0.0), grid).heights_m for k in (0, 1)]
        significant += surface_pattern(surfaces[1] - surfaces[0], grid).significant
    assert significant <= 2


def test_offset_and_tilt_are_told_apart_from_patterns_and_objects_left_out() -> None:
    grid = Grid(-30.0, -20.0, 1.0, 40, 60)
    surfaces = []
    for seed in (1, 2):
        uvh = points_on_terrain(seed, 30_000, 0.02) - [30.0, 20.0, 0.0]
        if seed == 2:
            uvh[:, 2] += 0.05 + 0.002 * uvh[:, 0]
            uvh[(np.abs(uvh[:, 0]) < 4.0) & (np.abs(uvh[:, 1]) < 4.0), 2] += 2.0
        surfaces.append(raster_surface(uvh, grid).heights_m)
    found = surface_pattern(surfaces[1] - surfaces[0], grid)
    assert found.offset_m == pytest.approx(0.05, abs=0.003)
    assert found.tilt_u_mrad == pytest.approx(2.0, abs=0.2)
    assert found.tilt_v_mrad == pytest.approx(0.0, abs=0.2)
    assert 40 <= found.gross_cells <= 120
    assert not found.significant


def test_too_small_an_area_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="cells in common"):
        surface_pattern(np.zeros((3, 3)), Grid(0.0, 0.0, 1.0, 3, 3))
