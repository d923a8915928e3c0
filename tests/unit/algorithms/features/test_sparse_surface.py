"""Surface of which few points are known: far away, or seen at a flat angle."""

import numpy as np
import pytest

from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.progress import NoProgress
from algorithms.scans.scan import Scan

NOISE_M = 0.003
FAR_M = 14.0
"""Where the far wall stands; its points are too far apart for cells that suit the near floor."""


def floor(rng, step=0.02):
    x, y = np.meshgrid(np.arange(-2.0, 2.0, step), np.arange(-2.0, 2.0, step))
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, -1.5)]) + rng.normal(0.0, NOISE_M, (x.size, 3))


def far_wall(rng, step=0.17):
    y, z = np.meshgrid(np.arange(-3.0, 3.0, step), np.arange(-1.5, 1.5, step))
    jitter = rng.uniform(-0.4 * step, 0.4 * step, (2, y.size))
    return np.column_stack([
        FAR_M + rng.normal(0.0, NOISE_M, y.size), y.ravel() + jitter[0], z.ravel() + jitter[1]
    ])  # fmt: skip


def bush(rng, count=400):
    return np.array([0.0, FAR_M, 0.0]) + rng.uniform(-1.5, 1.5, (count, 3))


def features(*parts):
    scan = Scan(name="S", points=np.concatenate(parts), origin_m=np.zeros(3), sensor_m=np.zeros(3))
    return extract_features(scan, FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0))


@pytest.fixture(scope="module")
def seen():
    rng = np.random.default_rng(3)
    return features(floor(rng), far_wall(rng), bush(rng)).surface


def test_a_far_wall_is_surface_although_its_points_are_far_apart(seen):
    on_wall = (np.abs(seen.points[:, 0] - FAR_M) < 0.02) & (np.abs(seen.normals[:, 0]) > 0.98)
    corners = np.array([[y, z] for y in (-2.5, 0.0, 2.5) for z in (-1.2, 1.2)])
    places = seen.points[on_wall][:, 1:]
    assert np.linalg.norm(places - corners[:, None], axis=2).min(axis=1).max() < 0.6


def test_its_normals_point_to_the_instrument(seen):
    far = (np.abs(seen.points[:, 0] - FAR_M) < 0.02) & (np.linalg.norm(seen.normals, axis=1) > 0.5)
    assert (seen.normals[far, 0] < -0.9).all()


def test_scattered_points_of_a_bush_are_no_surface(seen):
    in_bush = seen.points[:, 1] > FAR_M - 2.0
    assert np.count_nonzero(in_bush & (np.linalg.norm(seen.normals, axis=1) > 0.5)) <= 3


def test_where_points_are_dense_nothing_is_added():
    rng = np.random.default_rng(4)
    near = features(floor(rng))
    on_floor = np.abs(near.surface.points[:, 2] + 1.5) < 0.01
    assert on_floor.all()
    assert (near.surface.plane_labels >= 0).mean() > 0.95
