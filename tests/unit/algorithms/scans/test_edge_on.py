"""Surface that would have been seen edge-on is none, as the curtains behind edges."""

import numpy as np

from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.progress import NoProgress
from algorithms.scans.edge_on import planes_seen_edge_on, seen_edge_on
from algorithms.scans.scan import Scan

SENSOR = np.zeros(3)


def room_with(extra, rng):
    """Give a scan of a floor and two walls round the instrument, 1 mm of noise, and more points."""
    u, v = rng.uniform(-4.0, 4.0, (2, 40_000))
    floor = np.column_stack([u, v, np.full(len(u), -1.6)])
    north = np.column_stack([u, np.full(len(u), 4.0), 0.4 * v])
    east = np.column_stack([np.full(len(u), 4.0), u, 0.4 * v])
    points = np.vstack([floor, north, east, extra])
    rays = points / np.linalg.norm(points, axis=1, keepdims=True)
    points = points + rays * rng.normal(0.0, 0.001, (len(points), 1))
    return Scan(points=points, origin_m=np.zeros(3), name="room", sensor_m=SENSOR)


def features_of(scan):
    return extract_features(scan, FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0))


def passing_m(features):
    """Give how near the planes pass the instrument [m]."""
    return np.abs(np.einsum("ij,ij->i", features.planes.centroids, features.planes.normals))


def test_a_curtain_of_mixed_pixels_behind_the_edge_of_a_door_is_no_plane_and_no_surface():
    rng = np.random.default_rng(1)
    ranges, heights = rng.uniform(0.8, 2.2, 6_000), rng.uniform(-1.0, 1.0, 6_000)
    curtain = np.column_stack([-0.6 * ranges, 0.8 * ranges, heights])
    features = features_of(room_with(curtain, rng))
    assert len(features.planes) == 3
    assert passing_m(features).min() > 1.5
    index = features.index
    hanging = (index.points[:, 0] < 0.0) & (np.abs(index.points[:, 2]) < 0.9) & (index.points[:, 1] < 3.0)
    assert not hanging.any()


def test_a_scan_of_nothing_but_a_curtain_has_no_plane():
    rng = np.random.default_rng(3)
    ranges, heights = rng.uniform(0.8, 2.2, 6_000), rng.uniform(-1.0, 1.0, 6_000)
    points = np.column_stack([-0.6 * ranges, 0.8 * ranges, heights])
    features = features_of(Scan(points=points, origin_m=np.zeros(3), name="curtain", sensor_m=SENSOR))
    assert len(features.planes) == 0
    assert len(features.index.points) == 0


def test_a_screen_that_stands_beside_the_rays_stays():
    rng = np.random.default_rng(2)
    along, heights = rng.uniform(-0.7, 0.7, 6_000), rng.uniform(-1.0, 1.0, 6_000)
    screen = np.column_stack([-1.2 - 0.8 * along, 1.6 - 0.6 * along, heights])
    features = features_of(room_with(screen, rng))
    assert len(features.planes) == 4


def test_surface_is_seen_edge_on_where_the_ray_lies_in_it():
    points = np.array([[5.0, 0.0, 0.0], [5.0, 0.0, 0.0], [0.5, 0.0, 0.0], [50.0, 0.0, -1.6]])
    normals = np.array([[0.0, 1.0, 0.0], [0.0, np.cos(0.05), np.sin(0.05)], [0.06, 0.998, 0.0], [0.0, 0.0, 1.0]])
    tilted = np.array([[0.0, 1.0, 0.0], [np.sin(0.05), np.cos(0.05), 0.0], [0.2, 0.98, 0.0], [0.0, 0.0, 1.0]])
    assert seen_edge_on(points, normals, SENSOR).tolist() == [True, True, True, False]
    assert seen_edge_on(points, tilted, SENSOR).tolist() == [True, False, False, False]


def test_a_long_plane_is_judged_where_it_is_nearest():
    normals, bases = np.array([[0.0, 1.0, 0.0]] * 2), np.array([np.eye(3)[:, [2, 0]]] * 2)
    centroids = np.array([[20.0, 0.1, 0.0]] * 2)
    extents = np.array([[-1.0, -19.5, 1.0, 19.5], [-1.0, -2.0, 1.0, 2.0]])
    assert planes_seen_edge_on(normals, centroids, bases, extents, SENSOR).tolist() == [False, True]
