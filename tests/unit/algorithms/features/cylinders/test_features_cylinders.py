"""Cylinders: exact, uncertain, and refused."""

import numpy as np
import pytest

from algorithms.features.cylinders.cylinder_axes import find_cylinders
from algorithms.features.cylinders.cylinder_fitting import fit_cylinder
from algorithms.features.options import FeatureOptions
from tests.scenes.lines.feature_scenes import tube

START, END = np.array([2.0, -1.5, 0.3]), np.array([2.4, 1.5, 0.9])
AXIS = (END - START) / np.linalg.norm(END - START)


def axis_errors(cylinders, k=0):
    """Give the distance of the axis from the true one [m] and the angle between them [rad]."""
    offset = cylinders.axes.anchors[k] - START
    direction = cylinders.axes.directions[k]
    return np.linalg.norm(np.cross(offset, AXIS)), np.linalg.norm(np.cross(direction, AXIS))


@pytest.mark.parametrize("radius_m", [0.03, 0.1, 0.5])
def test_exact_points_give_the_exact_cylinder(radius_m):
    points = tube(np.random.default_rng(1), START, END, radius_m, 8000, facing=(-1, 0, 0))
    cylinders = find_cylinders(points, np.zeros(3), 0.001, FeatureOptions())
    assert len(cylinders) == 1
    off, tilt = axis_errors(cylinders)
    assert off < 1e-7  # m
    assert tilt < 1e-7  # rad
    assert cylinders.radii_m[0] == pytest.approx(radius_m, abs=1e-7)


def test_the_extent_is_that_of_the_points():
    points = tube(np.random.default_rng(2), START, END, 0.1, 8000, noise_m=0.002, facing=(-1, 0, 0))
    cylinders = find_cylinders(points, np.zeros(3), 0.002, FeatureOptions())
    assert cylinders.axes.lengths[0] == pytest.approx(np.linalg.norm(END - START), rel=0.01)


def test_the_arc_is_the_seen_part():
    points = tube(np.random.default_rng(3), START, END, 0.2, 8000, np.deg2rad(150), 0.001, facing=(-1, 0, 0))
    cylinders = find_cylinders(points, np.zeros(3), 0.001, FeatureOptions())
    assert np.rad2deg(cylinders.arcs_rad[0]) == pytest.approx(150, abs=11)  # two bins of 5 degrees


def test_a_tunnel_is_not_convex():
    points = tube(np.random.default_rng(4), (-4, 0, 0), (4, 0, 0), 1.2, 30_000, np.deg2rad(300), 0.002, (0, 0, 1))
    cylinders = find_cylinders(points, np.zeros(3), 0.002, FeatureOptions())
    assert list(cylinders.convex) == [False]


def test_a_pipe_is_convex():
    points = tube(np.random.default_rng(5), START, END, 0.1, 8000, noise_m=0.002, facing=(-1, 0, 0))
    assert list(find_cylinders(points, np.zeros(3), 0.002, FeatureOptions()).convex) == [True]


def test_radius_limits_are_kept():
    points = tube(np.random.default_rng(6), START, END, 0.1, 8000, noise_m=0.002, facing=(-1, 0, 0))
    assert len(find_cylinders(points, np.zeros(3), 0.002, FeatureOptions(min_cylinder_radius_m=0.15))) == 0


def test_a_narrow_strip_of_a_pipe_is_refused():
    points = tube(np.random.default_rng(7), START, END, 0.3, 8000, np.deg2rad(35), 0.002, facing=(-1, 0, 0))
    assert len(find_cylinders(points, np.zeros(3), 0.002, FeatureOptions())) == 0


def test_a_ring_shorter_than_its_diameter_is_refused():
    points = tube(np.random.default_rng(8), START, START + 0.5 * AXIS, 0.4, 8000, noise_m=0.002, facing=(-1, 0, 0))
    assert len(find_cylinders(points, np.zeros(3), 0.002, FeatureOptions())) == 0


def test_a_bush_holds_no_cylinder():
    points = np.random.default_rng(9).random((20_000, 3)) * 1.5
    assert len(find_cylinders(points, np.zeros(3), 0.002, FeatureOptions())) == 0


def test_two_pieces_of_one_pipe_are_one_cylinder():
    rng = np.random.default_rng(10)
    half = 0.5 * (START + END)
    parts = [tube(rng, a, b, 0.1, 4000, noise_m=0.001, facing=(-1, 0, 0)) for a, b in
             ((START, half - 0.3 * AXIS), (half + 0.3 * AXIS, END))]  # fmt: skip
    assert len(find_cylinders(np.concatenate(parts), np.zeros(3), 0.001, FeatureOptions())) == 1


def test_two_parallel_pipes_are_two_cylinders():
    rng = np.random.default_rng(11)
    parts = [
        tube(rng, START + shift, END + shift, 0.08, 6000, noise_m=0.001, facing=(-1, 0, 0))
        for shift in (np.zeros(3), np.array([0.0, 0.0, 0.3]))
    ]
    assert len(find_cylinders(np.concatenate(parts), np.zeros(3), 0.001, FeatureOptions())) == 2


def test_start_values_may_be_centimetres_and_degrees_off():
    points = tube(np.random.default_rng(12), START, END, 0.1, 3000, facing=(-1, 0, 0))
    direction = AXIS + 0.05 * np.array([0.0, -0.2, 1.0])
    fitted = fit_cylinder(points, 0.5 * (START + END) + 0.02, direction / np.linalg.norm(direction), 0.13, 0.01)
    assert fitted is not None
    assert fitted.radius_m == pytest.approx(0.1, abs=1e-7)
