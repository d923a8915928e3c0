"""B-spline patches lie where the surface is, take knots where it bends, and state how well they fit."""

import numpy as np
import pytest
from scipy.interpolate import NdBSpline

from algorithms.errors import InvalidInputError
from algorithms.meshing.faults import faults_of
from algorithms.meshing.spline_patches import CylinderPatch, HeightFieldPatch, SplinePatch, fitted_patch, tessellated

NOISE_M = 0.002
RECTANGLE = HeightFieldPatch(
    np.array([10.0, -5.0, 2.0]), np.array([2.0, 0.0, 0.0]), np.array([0.0, 1.5, 0.0]), reach_m=1.0
)


def heights(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A saddle with a sharp hill on one side."""
    return 0.2 * x * y + 0.15 * np.exp(-((x - 1.6) ** 2 + (y - 1.1) ** 2) / 0.01)


def scanned(count: int, noise_m: float, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0.0, 2.0, count), rng.uniform(0.0, 1.5, count)
    return RECTANGLE.corner_m + np.column_stack([x, y, heights(x, y) + rng.normal(0.0, noise_m, count)])


def on_grid(patch: SplinePatch, count: int = 60) -> tuple[np.ndarray, np.ndarray]:
    u, v = (each.ravel() for each in np.meshgrid(np.linspace(0, 1, count), np.linspace(0, 1, count), indexing="ij"))
    return patch.at(u, v), np.column_stack([u, v])


def test_a_height_field_has_its_knots_where_it_bends_and_its_noise_as_standard_deviation() -> None:
    patch = fitted_patch(scanned(40_000, NOISE_M), RECTANGLE, 3, 0.0, 64)
    places, _ = on_grid(patch)
    x, y, z = (places - RECTANGLE.corner_m).T
    assert np.sqrt(np.mean((z - heights(x, y)) ** 2)) < 2.0 * patch.surface_std_m
    assert patch.surface_std_m < 0.3 * NOISE_M
    assert patch.std_m == pytest.approx(NOISE_M, rel=0.03)
    assert patch.missed_spans == 0
    spans = np.diff(np.unique(patch.knots_u))
    middles = np.unique(patch.knots_u)[:-1] + spans / 2.0
    assert spans[np.argmin(np.abs(middles - 0.8))] < 0.3 * spans[0]


def test_the_standard_deviation_of_the_surface_holds_its_errors() -> None:
    ratios = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        x, y = rng.uniform(0.0, 2.0, 3000), rng.uniform(0.0, 1.5, 3000)
        points = RECTANGLE.corner_m + np.column_stack([x, y, 0.1 * x * y + rng.normal(0.0, NOISE_M, 3000)])
        patch = fitted_patch(points, RECTANGLE, 3, 0.0, 64)
        places = patch.at(x / 2.0, y / 1.5) - RECTANGLE.corner_m
        ratios.append(np.mean((places[:, 2] - 0.1 * x * y) ** 2) / patch.surface_std_m**2)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.25)


def test_a_tolerance_saves_knots() -> None:
    points = scanned(40_000, NOISE_M)
    exact, coarse = (fitted_patch(points, RECTANGLE, 3, tolerance, 64) for tolerance in (0.0, 0.02))
    assert coarse.control_m.size < 0.5 * exact.control_m.size
    assert coarse.misfit_m > exact.misfit_m


def test_a_closed_cylinder_is_a_smooth_surface_without_a_seam() -> None:
    rng = np.random.default_rng(2)
    turn, up = rng.uniform(0.0, 2.0 * np.pi, 8000), rng.uniform(0.0, 3.0, 8000)
    radius = 0.5 + 0.03 * np.cos(3.0 * turn) * np.sin(up) + rng.normal(0.0, NOISE_M, len(turn))
    points = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), up])
    column = CylinderPatch(
        np.zeros(3), np.array([0.0, 0.0, 3.0]), np.array([1.0, 0.0, 0.5]), 0.0, 2.0 * np.pi, 0.2, 1.0
    )
    patch = fitted_patch(points, column, 3, 0.0, 64)
    places, parameters = on_grid(patch)
    true = 0.5 + 0.03 * np.cos(6.0 * np.pi * parameters[:, 0]) * np.sin(places[:, 2])
    assert np.sqrt(np.mean((np.hypot(places[:, 0], places[:, 1]) - true) ** 2)) < 2.0 * patch.surface_std_m
    assert patch.std_m == pytest.approx(NOISE_M, rel=0.03)
    ends = patch.at(np.array([0.0, 1.0]), np.array([0.3, 0.3]))
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-12)
    mesh = tessellated(patch, 4)
    loops = [fault for fault in faults_of(mesh, np.empty(0, dtype=np.int64)) if fault.kind == "border-loop"]
    assert [fault.count for fault in loops] == [2]


def test_scipy_evaluates_the_same_surface_from_knots_and_control_points() -> None:
    patch = fitted_patch(scanned(3000, NOISE_M), RECTANGLE, 3, 0.0, 64)
    places, parameters = on_grid(patch, 20)
    other = NdBSpline((patch.knots_u, patch.knots_v), patch.control_m, (3, 3))(parameters)
    np.testing.assert_allclose(places, other, atol=1e-12)


def test_too_few_points_are_refused() -> None:
    with pytest.raises(InvalidInputError, match="points lie in it"):
        fitted_patch(scanned(20, 0.0), RECTANGLE, 3, 0.0, 64)
