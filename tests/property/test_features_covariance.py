"""Normalised estimation errors over many noisy scenes: the covariances of features are honest."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from algorithms.features.cylinders.cylinder_fitting import fit_cylinder
from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.features.patches.patch_covariance import estimate_waviness, estimate_wavinesses, honest_covariance
from algorithms.progress import NoProgress
from tests.scenes.lines.feature_scenes import SENSOR, cloud, rectangle, room, tube

pytestmark = pytest.mark.slow


def features_of(points, sensor_m=SENSOR):
    return extract_features(
        cloud(points, sensor_m), FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0)
    )


@pytest.fixture(scope="module")
def rooms():
    """Thirty noisy scans of one room: 180 planes and 360 lines."""
    return [features_of(room(np.random.default_rng(seed), per_m2=60.0, noise_m=0.003)) for seed in range(30)]


def plane_error(planes, k):
    """Give (a1, a2, b) of the true face as seen from the estimate."""
    n = planes.normals[k]
    axis = int(np.argmax(np.abs(n)))
    true = np.sign(n[axis]) * np.eye(3)[axis]
    h = -[3.0, 2.0, 1.5][axis]  # inward normals
    a = planes.bases[k].T @ true / (n @ true)
    b = (h - planes.centroids[k] @ true) / (n @ true)
    return np.array([*a, b])


def line_error(lines, k):
    """Give (a1, a2, b1, b2) of the true edge as seen from the estimate."""
    d, c, E = lines.directions[k], lines.anchors[k], lines.bases[k]
    axis = int(np.argmax(np.abs(d)))
    true = np.sign(d[axis]) * np.eye(3)[axis]
    on_true = np.sign(c) * np.array([3.0, 2.0, 1.5])
    on_true[axis] = 0.0
    point = on_true + ((c - on_true) @ d) / (true @ d) * true
    return np.array([*(E.T @ true) / (d @ true), *E.T @ (point - c)])


def test_planes_have_a_normalised_error_of_three(rooms):
    errors = [
        (e := plane_error(f.planes, k)) @ np.linalg.solve(f.planes.covariances[k], e)
        for f in rooms
        for k in range(len(f.planes))
    ]
    assert len(errors) == 180
    # 3 +- 0.18 (one sigma of the mean); waviness estimated as positive where there is none makes it a little smaller
    assert 2.3 < np.mean(errors) < 3.5


def test_lines_have_a_normalised_error_of_four(rooms):
    errors = [
        (e := line_error(f.lines, k)) @ np.linalg.solve(f.lines.covariances[k], e)
        for f in rooms
        for k in range(len(f.lines))
    ]
    assert len(errors) == 360
    assert 3.0 < np.mean(errors) < 4.6  # 4 +- 0.15, correlated between lines of one plane


def test_cylinders_have_a_normalised_error_of_five():
    errors = []
    start, end, radius = np.array([2.0, -1.0, 0.2]), np.array([2.3, 1.0, 0.4]), 0.15
    axis = (end - start) / np.linalg.norm(end - start)
    for seed in range(150):
        points = tube(np.random.default_rng(seed), start, end, radius, 800, np.pi, 0.002, (-1, 0, 0))
        fitted = fit_cylinder(points, 0.5 * (start + end), axis, radius, 0.002)
        assert fitted is not None
        true = np.sign(axis @ fitted.direction) * axis
        point = start + ((fitted.anchor - start) @ fitted.direction) / (true @ fitted.direction) * true
        e = np.array([*fitted.basis.T @ true, *fitted.basis.T @ (point - fitted.anchor), radius - fitted.radius_m])
        errors.append(e @ np.linalg.solve(fitted.covariance, e))
    assert 3.7 < np.mean(errors) < 5.8  # 5 +- 0.26


def test_a_wavy_wall_has_a_larger_standard_deviation_than_an_even_one():
    rng = np.random.default_rng(1)
    wall = rectangle(rng, (-4, 2, -1.5), (8, 0, 0), (0, 0, 3), 12_000, 0.001)
    wavy = wall + 0.002 * np.sin(2 * np.pi * wall[:, :1] / 2.5) * np.array([0.0, 1.0, 0.0])
    even, uneven = (features_of(points).planes.covariances[0, 2, 2] ** 0.5 for points in (wall, wavy))
    assert uneven > 5.0 * even


def test_waviness_is_estimated_without_bias():
    rng = np.random.default_rng(2)
    jacobian = np.column_stack([rng.uniform(-1, 1, (40, 2)), np.ones(40)])
    noise = np.full(40, 0.0005**2)
    found = [
        estimate_waviness(jacobian, rng.normal(0, 0.002, 40) + rng.normal(0, 0.0005, 40), noise) for _ in range(200)
    ]
    assert np.mean(found) == pytest.approx(0.002**2, rel=0.06)  # relative sigma of the mean 1.7 %


def just_too_wavy(rng):
    """Give a surface whose 40 patches scatter by two standard deviations of chi-square too much."""
    jacobian = np.column_stack([rng.uniform(-1, 1, (40, 2)), np.ones(40)])
    misfits = rng.normal(0, 1, 40)
    misfits -= jacobian @ np.linalg.lstsq(jacobian, misfits)[0]
    misfits *= np.sqrt((37.0 + 2.0 * np.sqrt(74.0)) / np.sum(misfits**2))
    return jacobian, 0.0005 * misfits, np.full(40, 0.0005**2)


def even(rng):
    """Give a surface whose patches scatter as their noise lets expect."""
    jacobian, misfits, variances = just_too_wavy(rng)
    return jacobian, 0.8 * misfits, variances


def test_a_scatter_just_too_large_is_chance_among_even_surfaces():
    rng = np.random.default_rng(5)
    assert (estimate_wavinesses([just_too_wavy(rng), even(rng), even(rng)]) == 0.0).all()


def test_the_same_scatter_is_waviness_among_wavy_surfaces():
    rng = np.random.default_rng(6)
    assert (estimate_wavinesses([just_too_wavy(rng), just_too_wavy(rng), even(rng)]) > 0.0).all()


def floor(rng, noise_m):
    """Give a floor 1.6 m below the instrument, out to 12 m, measured with noise along the rays."""
    depression, azimuth = np.meshgrid(np.deg2rad(np.arange(8.0, 70.0, 0.7)), np.deg2rad(np.arange(0.0, 360.0, 2.0)))
    down, around = depression.ravel(), azimuth.ravel()
    rays = np.column_stack([np.cos(down) * np.cos(around), np.cos(down) * np.sin(around), -np.sin(down)])
    return rays * (1.6 / np.sin(down) + rng.normal(0.0, noise_m, len(down)))[:, None]


def test_a_floor_seen_at_all_incidences_has_a_normalised_error_of_three():
    errors = []
    for seed in range(25):
        planes = features_of(floor(np.random.default_rng(seed), 0.004), np.zeros(3)).planes
        n = planes.normals[0]
        true = np.array([0.0, 0.0, 1.0])
        e = np.array([*(planes.bases[0].T @ true / n[2]), (-1.6 - planes.centroids[0, 2]) / n[2]])
        errors.append(e @ np.linalg.solve(planes.covariances[0], e))
    assert 1.8 < np.mean(errors) < 4.5  # 3 +- 0.49 (one sigma of the mean of 25)


def test_covariance_without_waviness_is_the_formal_one():
    rng = np.random.default_rng(3)
    jacobian = np.column_stack([rng.uniform(-1, 1, (40, 2)), np.ones(40)])
    formal = np.linalg.inv(jacobian.T @ jacobian) * 0.001**2
    given_noise = honest_covariance(jacobian, np.zeros(40), np.full(40, 0.001**2), 0.0)
    assert given_noise == pytest.approx(formal, rel=1e-9)


@settings(max_examples=5)
@given(
    angles=st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    shift=st.tuples(*[st.floats(-50.0, 50.0)] * 3),
)
def test_moving_a_scan_moves_its_planes(angles, shift):
    """Voxels do not turn with the scan, so the planes agree within their standard deviation, not exactly."""
    points = room(np.random.default_rng(4), noise_m=0.002)
    motion = Rotation.from_rotvec(angles)
    still, moved = features_of(points), features_of(motion.apply(points) + shift, motion.apply(SENSOR) + shift)
    assert len(moved.planes) == 6
    for k in range(6):
        n, c = motion.apply(still.planes.normals[k]), motion.apply(still.planes.centroids[k]) + shift
        same = int(np.argmax(moved.planes.normals @ n))
        gap = abs(float(moved.planes.normals[same] @ (moved.planes.centroids[same] - c)))
        assert gap < 3.0 * float(still.planes.covariances[k, 2, 2]) ** 0.5
