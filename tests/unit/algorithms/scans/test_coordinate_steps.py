"""The step that coordinates are rounded to is found from themselves, and nothing is found where there is none."""

import numpy as np
import pytest

from algorithms.scans.coordinate_steps import coordinate_steps, step_of
from tests.scenes.lines.feature_scenes import SENSOR, cloud

POINTS = 30_000


def coordinates() -> np.ndarray:
    """Two walls 5 m apart with 2 mm of noise, and what lies between them, along one axis."""
    rng = np.random.default_rng(1)
    walls = np.concatenate([rng.normal(0.0, 0.002, POINTS // 4), rng.normal(5.0, 0.002, POINTS // 4)])
    return np.concatenate([walls, rng.uniform(0.0, 5.0, POINTS // 2)])


@pytest.mark.parametrize("step", [0.0001, 0.001, 0.003048, 0.01, 0.05])
@pytest.mark.parametrize("offset", [0.0, 512_345.3])
def test_the_scale_of_integers_is_found(step: float, offset: float) -> None:
    found, uneven = step_of(np.rint(coordinates() / step) * step + offset)
    assert found == pytest.approx(step, rel=1e-4)
    assert not uneven


@pytest.mark.parametrize("decimals", [1, 2, 3])
def test_decimals_of_text_are_found_in_few_points(decimals: int) -> None:
    written = [float(f"{value:.{decimals}f}") for value in coordinates()[::25]]
    assert step_of(np.array(written))[0] == pytest.approx(10.0**-decimals, rel=1e-4)


def test_decimals_are_found_through_single_precision() -> None:
    rounded = np.round(coordinates(), 2).astype(np.float32).astype(np.float64)
    assert step_of(rounded)[0] == pytest.approx(0.01, rel=1e-3)


@pytest.mark.parametrize(("offset", "step"), [(500_000.0, 2.0**-5), (5_300_000.0, 2.0**-1)])
def test_national_coordinates_in_single_precision_have_its_spacing(offset: float, step: float) -> None:
    assert step_of((coordinates() + offset).astype(np.float32).astype(np.float64))[0] == pytest.approx(step)


def test_single_precision_near_the_origin_is_harmless() -> None:
    assert step_of(coordinates().astype(np.float32).astype(np.float64))[0] < 1e-6  # m


def test_full_precision_has_no_step() -> None:
    assert step_of(coordinates())[0] < 1e-12  # m


def test_slices_of_a_depth_camera_are_said_to_be_of_unequal_thickness() -> None:
    # disparities of an eighth of a pixel, base times focal length 400: slices of z²/3200
    depths = 400.0 / (np.rint(8.0 * 400.0 / (1.0 + np.random.default_rng(2).uniform(0.0, 3.0, POINTS))) / 8.0)
    found, uneven = step_of(depths)
    assert uneven
    assert found == pytest.approx(np.sqrt(np.mean((depths**2 / 3200.0) ** 2)), rel=0.05)


def test_slices_are_seen_in_whole_millimetres_too() -> None:
    depths = 400.0 / (np.rint(8.0 * 400.0 / (1.0 + np.random.default_rng(3).uniform(0.0, 3.0, POINTS))) / 8.0)
    found, uneven = step_of(np.round(depths, 3))
    assert uneven
    assert found > 0.002


def test_the_step_of_ranges_is_found_though_no_axis_has_one() -> None:
    rng = np.random.default_rng(4)
    directions = rng.normal(size=(POINTS, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    points = SENSOR + directions * (np.rint(rng.uniform(2.0, 9.0, POINTS) / 0.02) * 0.02)[:, None]
    steps = coordinate_steps(cloud(points, SENSOR))
    assert steps.range_m == pytest.approx(0.02, rel=1e-3)
    assert steps.axes_m.max() < 1e-12


@pytest.mark.parametrize("step", [0.001, 0.01, 0.05])
def test_rounded_axes_are_not_taken_for_a_step_of_ranges(step: float) -> None:
    rng = np.random.default_rng(5)
    points = np.rint(rng.normal(0.0, 4.0, (POINTS, 3)) / step) * step
    steps = coordinate_steps(cloud(points, SENSOR))
    assert steps.axes_m == pytest.approx(np.full(3, step), rel=1e-3)
    assert steps.range_m == 0.0


def test_each_axis_has_a_step_of_its_own() -> None:
    points = np.random.default_rng(6).normal(0.0, 4.0, (POINTS, 3))
    points[:, 2] = np.round(points[:, 2], 2)
    steps = coordinate_steps(cloud(points, None))
    assert steps.axes_m[2] == pytest.approx(0.01, rel=1e-3)
    assert steps.axes_m[:2].max() < 1e-12
