"""Rays and points against triangles, compared with what is computed without a tree."""

import subprocess
import sys

import numpy as np
import pytest

from algorithms.deviations.triangles import closest_on_triangles
from algorithms.scans.triangle_tree import TriangleTree
from algorithms.simulation.ray_casting import RayCaster
from algorithms.simulation.scenes import SCENES

FAR_M = np.array([500_000.0, 5_400_000.0, 300.0])


def soup(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return triangles of very different sizes anywhere in a cube of 10 m."""
    sizes = 10.0 ** rng.uniform(-2.0, 0.5, (count, 1, 1))
    corners = rng.uniform(0.0, 10.0, (count, 1, 3)) + sizes * rng.normal(size=(count, 3, 3))
    return corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)


def rays(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    directions = rng.normal(size=(count, 3))
    return rng.uniform(0.0, 10.0, (count, 3)), directions / np.linalg.norm(directions, axis=1, keepdims=True)


def met_at(origin: np.ndarray, direction: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return where a ray meets each triangle, by Cramer's rule; inf where it does not."""
    a, u, v = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    system = np.stack([np.broadcast_to(-direction, u.shape), u, v], axis=2)
    t, s, r = np.linalg.solve(system, (origin - a)[:, :, None])[:, :, 0].T
    return np.where((s >= 0.0) & (r >= 0.0) & (s + r <= 1.0) & (t > 0.0), t, np.inf)


@pytest.mark.parametrize("count", [1, 2, 5, 700])
def test_the_first_triangle_is_the_nearest_of_all_that_are_met(count: int) -> None:
    rng = np.random.default_rng(count)
    vertices, triangles = soup(rng, count)
    origins, directions = rays(rng, 401)
    directions[::2] = vertices[triangles[rng.integers(0, count, 201)]].mean(axis=1) - origins[::2]  # at a triangle
    ranges = np.array([met_at(*ray, vertices[triangles]) for ray in zip(origins, directions, strict=True)])
    expected = np.where(np.isfinite(ranges.min(axis=1)), ranges.argmin(axis=1), -1)
    assert (expected[::2] >= 0).all()
    np.testing.assert_array_equal(TriangleTree(vertices, triangles).first_hits(origins, directions), expected)


def test_anything_met_counts_only_between_near_and_far() -> None:
    rng = np.random.default_rng(3)
    vertices, triangles = soup(rng, 300)
    origins, directions = rays(rng, 500)
    ranges = np.array([met_at(*ray, vertices[triangles]) for ray in zip(origins, directions, strict=True)])
    expected = ((ranges >= 1.0) & (ranges <= 2.0)).any(axis=1)
    assert 0 < expected.sum() < len(expected)
    np.testing.assert_array_equal(TriangleTree(vertices, triangles).meets_any(origins, directions, 1.0, 2.0), expected)


def test_a_segment_crosses_all_triangles_between_its_ends() -> None:
    rng = np.random.default_rng(4)
    vertices, triangles = soup(rng, 300)
    starts, ends = rng.uniform(0.0, 10.0, (2, 400, 3))
    along = np.array([met_at(start, end - start, vertices[triangles]) for start, end in zip(starts, ends, strict=True)])
    segments, crossed = TriangleTree(vertices, triangles).crossings(starts, ends)
    assert sorted(np.column_stack([segments, crossed]).tolist()) == np.argwhere(along < 1.0).tolist()


def test_the_nearest_triangle_is_nearer_than_all_others() -> None:
    rng = np.random.default_rng(5)
    vertices, triangles = soup(rng, 400)
    points = rng.uniform(-5.0, 15.0, (300, 3))
    corners = vertices[triangles]
    distances = np.empty((len(points), len(triangles)))
    for k, point in enumerate(points):
        places, _ = closest_on_triangles(np.tile(point, (len(triangles), 1)), corners)
        distances[k] = np.linalg.norm(places - point, axis=1)
    np.testing.assert_array_equal(TriangleTree(vertices, triangles).nearest(points), distances.argmin(axis=1))


def test_no_ray_slips_through_between_neighbouring_triangles() -> None:
    """Rays at corners, edges and along the axes of a box from inside: each of them meets a wall."""
    rng = np.random.default_rng(6)
    steps = np.linspace(-1.0, 1.0, 9)
    u, v = (each.ravel() for each in np.meshgrid(steps, steps))
    on_faces = np.vstack(
        [np.insert(np.column_stack([u, v]), axis, side, axis=1) for axis in range(3) for side in (-1.0, 1.0)]
    )
    corners = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    quads = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
    triangles = np.array([each for a, b, c, d in quads for each in ((a, b, c), (a, c, d))])
    tree = TriangleTree(corners, triangles)
    for eye in (np.zeros(3), rng.uniform(-0.9, 0.9, 3)):
        assert (tree.first_hits(eye, on_faces - eye) >= 0).all()
        assert (tree.first_hits(eye, np.vstack([np.eye(3), -np.eye(3)])) >= 0).all()


def test_of_two_triangles_at_one_place_the_first_is_met() -> None:
    vertices = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]])
    tree = TriangleTree(vertices, np.tile([0, 1, 2], (40, 1)))
    assert tree.first_hits(np.array([0.2, 0.2, 0.0]), np.array([[0.0, 0.0, 1.0]])).tolist() == [0]
    assert tree.nearest(np.array([[0.2, 0.2, 0.0]])).tolist() == [0]


def test_what_is_met_does_not_depend_on_how_far_the_origin_of_the_coordinates_is() -> None:
    rng = np.random.default_rng(7)
    vertices, triangles = soup(rng, 300)
    origins, directions = rays(rng, 500)
    near = TriangleTree(vertices, triangles).first_hits(origins, directions)
    far = TriangleTree(vertices + FAR_M, triangles).first_hits(origins + FAR_M, directions)
    assert (near != far).sum() <= 1  # coordinates are rounded to a nanometre there, and an edge may be that near


def test_a_ray_has_the_same_answer_alone_and_among_others() -> None:
    scene = SCENES["corridor"]()
    tree, (_, directions) = TriangleTree(scene.vertices, scene.triangles), rays(np.random.default_rng(8), 20_000)
    eye = np.asarray(scene.stations[0].translation)
    together = tree.first_hits(eye, directions)
    np.testing.assert_array_equal(together[37:300], tree.first_hits(eye, directions[37:300]))
    assert together[5] == tree.first_hits(eye, directions[5:6])[0]


def test_ranges_to_an_oblique_plane_are_those_of_its_equation() -> None:
    """Every hit lies in its triangle within a nanometre: planes of the smallest triangles are known no better."""
    scene = SCENES["house"]()
    origin = np.asarray(scene.stations[0].translation)
    _, directions = rays(np.random.default_rng(9), 5000)
    hits = RayCaster(scene).cast(origin, directions)
    found = hits.found
    places = origin + hits.ranges_m[found, None] * directions[found]
    nearest, _ = closest_on_triangles(places, scene.vertices[scene.triangles[hits.triangles[found]]])
    assert (np.linalg.norm(nearest - places, axis=1) * hits.cosines[found]).max() < 1e-9


WITHOUT_OPEN3D = """
import sys
sys.modules["open3d"] = None
import numpy as np
from algorithms.deviations.signed_distances import from_mesh
from algorithms.deviations.triangles import Mesh
from algorithms.meshing import contour_cones, faults, texture
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import scan_scene
from algorithms.simulation.scenes import SCENES
scene = SCENES["house"]()
scan = scan_scene(scene, scene.stations[0], VirtualScanner(rows=40, columns=80), np.random.default_rng(0))
assert len(scan.points) > 100
mesh = Mesh(scene.vertices, scene.triangles)
assert np.isfinite(from_mesh(scan.points, mesh, 1e9).distances_m).all()
faults.self_intersections(mesh)
"""


def test_scans_are_simulated_and_compared_where_there_is_no_open3d() -> None:
    made = subprocess.run([sys.executable, "-c", WITHOUT_OPEN3D], capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stderr
