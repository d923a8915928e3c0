"""Tanks and silos on one ground: found as cylinders, and registered by their axes."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.errors import DegenerateGeometryError
from algorithms.features.cylinders.cylinder_axes import find_cylinders
from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.matching.degeneracy import require_determining_geometry
from algorithms.matching.parallel_axes import parallel_axis_motions
from algorithms.progress import NoProgress
from algorithms.registration import DEFAULT_METHOD
from algorithms.registration.base import PairStatus, RegistrationProblem
from tests.scenes.lines.feature_scenes import cloud, rectangle, tube

NOISE_M = 0.002
POSES = [
    RigidTransform.from_components(place, Rotation.from_euler("zyx", angles))
    for place, angles in (((1.5, 0.7, 1.7), (0.4, 0.02, 0.01)), ((-1.1, 1.4, 1.6), (2.2, -0.01, 0.03)))
]
"""World from scan of the two stations amid the tanks."""
RING = [(12.0 * np.cos(angle), 12.0 * np.sin(angle)) for angle in np.radians([0.0, 120.0, 240.0])]
EQUAL = [(x, y, 3.0) for x, y in RING]
UNEQUAL = [(x, y, radius) for (x, y), radius in zip(RING, (3.0, 2.2, 4.0), strict=True)]


def tank_points(rng, place, tanks, height_m=9.0):
    """Give points of the ground and of the side of every tank that can be seen from a place, in world axes."""
    parts = [rectangle(rng, (-25, -25, 0), (50, 0, 0), (0, 50, 0), 40_000, NOISE_M)]
    for x, y, radius in tanks:
        way = np.array([place[0] - x, place[1] - y, 0.0])
        arc = 2.0 * np.arccos(radius / np.linalg.norm(way)) - 0.1
        parts.append(tube(rng, (x, y, 0), (x, y, height_m), radius, 9000, arc, NOISE_M, way))
    points = np.concatenate(parts)
    inside = [np.hypot(points[:, 0] - x, points[:, 1] - y) < radius - 0.05 for x, y, radius in tanks]
    return points[~np.any(inside, axis=0)]


def tank_features(tanks):
    """Extract the features of both stations."""
    found = []
    for number, pose in enumerate(POSES):
        points = tank_points(np.random.default_rng(number), pose.translation, tanks)
        scan = dataclasses.replace(cloud(pose.inv().apply(points)), sensor_m=np.zeros(3))
        found.append(extract_features(scan, FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0)))
    return found


def registered(tanks):
    target, source = tank_features(tanks)
    return DEFAULT_METHOD().register(RegistrationProblem(target, source), progress=NoProgress())


def error_m(pose):
    """Give how far the second station is from its true place."""
    return np.linalg.norm(((POSES[0].inv() * POSES[1]).inv() * pose).translation)


@pytest.mark.parametrize(("radius_m", "height_m", "arc_deg"), [(2.0, 8.0, 140), (3.0, 9.0, 140), (5.0, 8.0, 100)])
def test_tanks_up_to_five_metres_are_cylinders(radius_m, height_m, arc_deg):
    rng = np.random.default_rng(1)
    points = tube(rng, (14, 0, 0), (14, 0, height_m), radius_m, 20_000, np.radians(arc_deg), NOISE_M, (-1, 0, 0))
    cylinders = find_cylinders(points, np.zeros(3), NOISE_M, FeatureOptions())
    assert cylinders.radii_m == pytest.approx([radius_m], abs=0.005)


def test_of_an_arc_that_does_not_tell_the_radius_no_giant_cylinder_is_made():
    rng = np.random.default_rng(2)
    points = tube(rng, (14, 0, 0), (14, 0, 9), 4.0, 3000, np.radians(50), 0.02, (-1, 0, 0))
    assert len(find_cylinders(points, np.zeros(3), 0.02, FeatureOptions())) == 0


def test_rough_ground_makes_no_giant_cylinder():
    rng = np.random.default_rng(3)
    x, y = rng.uniform(-15, 15, (2, 40_000))
    bumps = 0.6 * np.sin(0.7 * x) * np.cos(0.5 * y) + 0.3 * np.sin(1.9 * x + 1.3 * y) + rng.normal(0, 0.03, x.shape)
    points = np.column_stack([x, y, bumps - 2.0])
    assert len(find_cylinders(points, np.zeros(3), 0.03, FeatureOptions())) == 0


def test_axes_and_the_ground_propose_the_true_motion():
    target, source = tank_features(UNEQUAL)
    motions = parallel_axis_motions(target, source, max_angle_rad=0.03, max_distance_m=0.15)
    assert min(error_m(pose) for pose in motions.poses) < 0.01


def test_swapping_the_scans_inverts_the_motions_that_axes_propose():
    target, source = tank_features(EQUAL)
    forward, backward = (
        parallel_axis_motions(*pair, max_angle_rad=0.03, max_distance_m=0.15)
        for pair in ((target, source), (source, target))
    )
    assert len(forward) == len(backward)
    for pose in backward.poses:
        apart = [(pose * other).as_matrix() - np.eye(4) for other in forward.poses]
        assert min(np.abs(each).max() for each in apart) < 0.02


@pytest.mark.slow
def test_unequal_tanks_register():
    result = registered(UNEQUAL)
    assert result.status is PairStatus.ACCEPTED
    assert error_m(result.final.pose.target_from_source) < 0.005


@pytest.mark.slow
def test_three_equal_tanks_in_a_triangle_are_ambiguous():
    result = registered(EQUAL)
    assert result.status is PairStatus.AMBIGUOUS
    assert any("looks like itself elsewhere" in reason for reason in result.reasons)


def test_a_single_tank_leaves_the_turn_about_its_axis_free():
    features = tank_features(EQUAL[:1])[0]
    with pytest.raises(DegenerateGeometryError) as refusal:
        require_determining_geometry(features, "target frame")
    assert refusal.value.rank == 5
    assert refusal.value.free_directions[0].startswith("rotation about")
