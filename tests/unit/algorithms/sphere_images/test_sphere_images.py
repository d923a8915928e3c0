"""Tessellated spheres and the rotations that lay one Gaussian image on another."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from algorithms.sphere_images.gaussian_image import Directions, correlations, sphere_image
from algorithms.sphere_images.rotation_search import rotation_peaks
from algorithms.sphere_images.tessellation import tessellation


def directions(rng: np.random.Generator, count: int = 25) -> Directions:
    normals = rng.normal(size=(count, 3))
    return Directions(normals / np.linalg.norm(normals, axis=1, keepdims=True), rng.uniform(1.0, 5.0, count))


def turned(some: Directions, rotation: Rotation) -> Directions:
    return Directions(rotation.apply(some.normals), some.weights)


@pytest.mark.parametrize("level", [0, 1, 3])
def test_a_divided_icosahedron_has_as_many_cells_as_euler_says(level: int) -> None:
    cells = tessellation(level)
    assert len(cells.centres) == 10 * 4**level + 2
    assert len(cells.triangles) == 20 * 4**level
    assert len(cells.edges) == 30 * 4**level
    np.testing.assert_allclose(np.linalg.norm(cells.centres, axis=1), 1.0)


def test_the_true_rotation_correlates_better_than_others() -> None:
    rng = np.random.default_rng(1)
    source, truth = directions(rng), Rotation.random(random_state=rng)
    image = sphere_image(turned(source, truth), 4)
    others = Rotation.random(200, random_state=rng)
    values = correlations(image, source, np.concatenate([truth.as_matrix()[None], others.as_matrix()]))
    assert values[0] > 2.0 * values[1:].max()


@pytest.mark.parametrize("about_vertical", [True, False])
def test_the_rotation_is_found_to_a_cell(about_vertical: bool) -> None:
    rng = np.random.default_rng(2)
    source = directions(rng)
    truth = Rotation.from_euler("z", 2.3) if about_vertical else Rotation.from_rotvec([0.4, -1.9, 0.7])
    peaks = rotation_peaks(turned(source, truth), source, finest_level=6, about_vertical=about_vertical, most=5)
    off = Rotation.from_matrix(peaks.rotations[0]) * truth.inv()
    assert off.magnitude() < peaks.width_rad


def test_a_box_is_ambiguous_in_four_headings() -> None:
    box = Directions(np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]]), np.ones(5))
    peaks = rotation_peaks(box, box, finest_level=5, about_vertical=True, most=10)
    assert np.count_nonzero(peaks.correlations > 0.9 * peaks.correlations[0]) == 4
