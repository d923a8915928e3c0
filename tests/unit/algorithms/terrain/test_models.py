"""Models of heights and linear prediction on surfaces that are known."""

import numpy as np
import pytest

from algorithms.arrays import Array
from algorithms.deviations.rasters import Grid
from algorithms.progress import NoProgress
from algorithms.terrain.cell_heights import filled
from algorithms.terrain.contours import contours
from algorithms.terrain.hillshade import hillshade
from algorithms.terrain.linear_prediction import Covariance, predicted
from algorithms.terrain.models import canopy_over, gaps_in_words, terrain_models
from algorithms.terrain.options import Opening
from tests.scenes.simulated_terrain import hill_heights, hills_with_houses


def test_heights_of_objects_are_surface_minus_terrain_and_the_terrain_runs_on_below_them() -> None:
    points, ground = hills_with_houses()
    models = terrain_models(points, ground, 1.0, None, NoProgress())
    x, y = models.grid.centres().T
    errors = models.dtm_m.ravel() - hill_heights(x, y)
    assert np.sqrt((errors**2).mean()) < 0.1
    np.testing.assert_allclose(models.ndsm_m, models.dsm_m - models.dtm_m)
    house = models.ndsm_m[22:28, 22:30]
    assert house.min() > 4.0
    known = np.isfinite(models.dtm_std_m.ravel())
    normalised = errors[known] / models.dtm_std_m.ravel()[known]
    assert 0.7 < np.sqrt((normalised**2).mean()) < 1.5


def waves(x: Array, y: Array, lengths_m: tuple[float, ...], share: float) -> Array:
    """Return heights of waves (n,) in several directions, as high as a share of their length."""
    rng = np.random.default_rng(4)
    z = np.zeros_like(x)
    for length in lengths_m:
        for azimuth, phase in rng.uniform(0.0, 2.0 * np.pi, (3, 2)):
            z += share * length * np.sin((x * np.cos(azimuth) + y * np.sin(azimuth)) * 2.0 * np.pi / length + phase)
    return z


TERRAINS = {
    "plane": lambda x, y: 0.2 * x - 0.1 * y,
    "hills": lambda x, y: 6.0 * np.sin(x / 11.0) + 4.0 * np.cos(y / 9.0),
    "waves of all lengths": lambda x, y: waves(x, y, (400.0, 160.0, 70.0, 30.0), 0.01),
    "terraces": lambda x, y: 2.0 * np.floor((x + 0.3 * y) / 12.0) + 0.02 * y,
    "roof of a ridge": lambda x, y: -0.6 * np.abs(x - 25.0 + 0.2 * y),
    "rough": lambda x, y: 0.05 * x + 0.3 * np.sin(x / 1.5) * np.sin(y / 1.7),
    "level and hills": lambda x, y: np.where(x < 25.0, 0.1 * x, 2.5 + 1.5 * np.sin(x / 6.0) * np.cos(y / 5.0)),
}


@pytest.mark.parametrize("density", [1.0, 4.0, 20.0])
@pytest.mark.parametrize("noise_m", [0.02, 0.1])
def test_standard_deviations_of_heights_are_those_of_their_errors(density: float, noise_m: float) -> None:
    """Over terrains that bend, step and are rough, half of each with noise three times as large."""
    squares = {}
    for number, (name, height) in enumerate(TERRAINS.items()):
        rng = np.random.default_rng(number)
        x, y = rng.uniform(0.0, 50.0, (2, rng.poisson(density * 2500.0)))
        noise = noise_m * np.where(y > 25.0, 3.0, 1.0)
        points = np.column_stack([x, y, height(x, y) + noise * rng.normal(size=len(x))])
        models = terrain_models(points, np.ones(len(points), dtype=np.bool_), 1.0, None, NoProgress())
        known = np.isfinite(models.dtm_std_m)
        truth = height(*models.grid.centres().T).reshape(models.grid.shape)
        squares[name] = (((models.dtm_m - truth) / models.dtm_std_m)[known] ** 2).mean()
        assert 0.7 < np.sqrt(squares[name]) < 1.35, name
    assert 0.9 < np.sqrt(np.mean(list(squares.values()))) < 1.1


def test_lakes_have_no_data_and_terrain_below_buildings_goes_on() -> None:
    """A lake of 60 m, a pond of 12 m, a house of 30 m and a hall of 80 m on a slope with 2 points a square metre."""
    rng = np.random.default_rng(5)
    x, y = rng.uniform(0.0, 240.0, (2, 115_000))
    z = 0.05 * x
    dry = (np.hypot(x - 50.0, y - 50.0) > 30.0) & (np.hypot(x - 50.0, y - 150.0) > 6.0)
    house = (np.abs(x - 120.0) < 15.0) & (np.abs(y - 60.0) < 15.0)
    hall = (np.abs(x - 170.0) < 40.0) & (np.abs(y - 150.0) < 40.0)
    z[house | hall] += 8.0
    points = np.column_stack([x, y, z])[dry]
    models = terrain_models(points, ~(house | hall)[dry], 1.0, None, NoProgress())
    u, v = (each.reshape(models.grid.shape) for each in models.grid.centres().T)
    lake = np.hypot(u - 50.0, v - 50.0)
    under_hall = np.maximum(np.abs(u - 170.0), np.abs(v - 150.0))
    assert models.no_terrain[lake < 29.0].all()
    assert models.no_surface[lake < 29.0].all()
    assert models.no_terrain[under_hall < 25.0].all()
    assert not models.no_terrain[(lake > 31.0) & (under_hall > 41.0)].any()
    assert not models.no_surface[lake > 31.0].any()
    np.testing.assert_array_equal(np.isnan(models.known_ndsm_m), models.no_terrain)
    known = np.isfinite(models.known_dtm_m)
    assert np.abs(models.known_dtm_m - 0.05 * u)[known].max() < 0.1
    (said,) = gaps_in_words(models)
    assert "wider than 20 m without points" in said


def test_sparse_points_are_no_gaps() -> None:
    x, y = np.random.default_rng(6).uniform(0.0, 1000.0, (2, 10_000))
    points = np.column_stack([x, y, 0.1 * x])
    models = terrain_models(points, np.ones(len(points), dtype=np.bool_), 2.0, None, NoProgress())
    assert models.bridged.empty_m == pytest.approx(50.0, rel=0.1)
    assert models.no_terrain.mean() < 1e-3


def test_the_canopy_stands_as_high_as_its_trees() -> None:
    rng = np.random.default_rng(3)
    x, y = rng.uniform(0.0, 60.0, (2, 12000))
    z = 0.1 * x
    crowns = (x > 20.0) & (x < 45.0) & (rng.random(12000) < 0.8)
    z[crowns] += rng.uniform(11.0, 12.0, int(crowns.sum()))
    points = np.column_stack([x, y, z])
    models = terrain_models(points, ~crowns, 1.0, None, NoProgress())
    canopy = canopy_over(points, models, Opening(), 1.0, NoProgress())
    assert np.median(canopy.stand_m[:, 22:43]) == pytest.approx(11.9, abs=0.3)
    assert np.median(canopy.stand_m[:, :18]) == pytest.approx(0.0, abs=0.1)


def test_linear_prediction_has_honest_standard_deviations() -> None:
    rng = np.random.default_rng(7)
    covariance, normalised = Covariance(4.0, 1.0, 0.1), []
    for _ in range(60):
        plan = np.column_stack([rng.uniform(0.0, 20.0, (60, 2)), np.zeros(60)])
        gaps = ((plan[:, None, :2] - plan[None, :, :2]) ** 2).sum(axis=2)
        surface = rng.multivariate_normal(np.zeros(60), np.exp(-0.5 * gaps / 16.0), method="svd")
        plan[:, 2] = surface + rng.normal(0.0, 0.1, 60)
        inner = np.flatnonzero((np.abs(plan[:50, :2] - 10.0) < 6.0).all(axis=1))[:5]
        kept = np.setdiff1d(np.arange(60), inner)
        found = predicted(plan[kept], np.ones(len(kept)), plan[inner], covariance, NoProgress(), with_std=True)
        normalised.append((surface[inner] - found.heights_m) / found.std_m)
    # the plane of each unit takes a little of the signal, and tells nothing of it
    assert 0.85 < np.sqrt((np.concatenate(normalised) ** 2).mean()) < 1.3


def test_a_membrane_over_gaps_of_a_plane_is_the_plane() -> None:
    grid = Grid(0.0, 0.0, 1.0, 40, 50)
    x, y = grid.centres().T
    plane = (0.2 * x - 0.1 * y).reshape(grid.shape)
    holed = plane.copy()
    holed[10:25, 15:35] = np.nan
    np.testing.assert_allclose(filled(holed), plane, atol=0.02)


def test_contours_lie_at_multiples_of_the_interval_and_keep_their_height() -> None:
    grid = Grid(0.0, 0.0, 1.0, 30, 30)
    x, _ = grid.centres().T
    found = contours((0.5 * x).reshape(grid.shape), grid, 2.0, base_m=101.0)
    assert [each.height_m for each in found] == [102.0, 104.0, 106.0, 108.0, 110.0, 112.0, 114.0]
    for each in found:
        for line in each.lines:
            np.testing.assert_allclose(0.5 * line[:, 0] + 101.0, each.height_m)
            np.testing.assert_allclose(line[:, 2] + 101.0, each.height_m)


def test_a_slope_that_faces_the_light_is_brightest() -> None:
    grid = Grid(0.0, 0.0, 1.0, 10, 10)
    x, _ = grid.centres().T
    east_rising = x.reshape(grid.shape)
    assert (hillshade(east_rising, grid, 270.0, 45.0) == 255).all()
    assert (hillshade(-east_rising, grid, 270.0, 45.0) == 0).all()
