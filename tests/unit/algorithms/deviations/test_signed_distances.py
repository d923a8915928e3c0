"""Distances from clouds, meshes and planes, with the right sign."""

import numpy as np
import pytest

from algorithms.deviations.signed_distances import (
    PlaneSet,
    cloud_normals,
    from_cloud,
    from_mesh,
    from_planes,
    inside_polygon,
)
from algorithms.deviations.statistics import deviation_statistics, histogram_of
from algorithms.deviations.triangles import FACE, cleaned, closest_on_triangles, condition_of
from algorithms.errors import InvalidInputError

CORNERS = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip
"""A cube whose faces look outwards."""


def of_cube(points: np.ndarray) -> np.ndarray:
    """Give the signed distances from the unit cube in closed form."""
    apart = np.abs(points - 0.5) - 0.5
    return np.linalg.norm(np.maximum(apart, 0.0), axis=1) + np.minimum(apart.max(axis=1), 0.0)


def test_distances_from_a_cube_are_those_of_the_formula_inside_and_outside() -> None:
    points = np.random.default_rng(1).uniform(-0.7, 1.7, (2000, 3))
    found = from_mesh(points, cleaned(CORNERS, FACES)[0], 5.0)
    assert found.signed.all()
    assert np.abs(found.distances_m - of_cube(points)).max() < 1e-6


def test_far_from_the_origin_distances_are_the_same() -> None:
    points = np.random.default_rng(2).uniform(-0.7, 1.7, (500, 3))
    far = np.array([500_000.0, 5_800_000.0, 300.0])
    found = from_mesh(points + far, cleaned(CORNERS + far, FACES)[0], 5.0)
    assert np.abs(found.distances_m - of_cube(points)).max() < 1e-6


def test_a_closed_mesh_has_no_faults_and_each_damage_is_counted() -> None:
    assert condition_of(cleaned(CORNERS, FACES)[0]).is_closed
    assert condition_of(cleaned(CORNERS, FACES[1:])[0]).border_edges == 3
    turned = FACES.copy()
    turned[0] = turned[0, ::-1]
    assert condition_of(cleaned(CORNERS, turned)[0]).contradicting_edges == 3
    doubled = np.vstack([FACES, FACES[:1]])
    assert condition_of(cleaned(CORNERS, doubled)[0]).crowded_edges == 3
    assert cleaned(CORNERS, np.vstack([FACES, [[0, 0, 1]]]))[1] == 1


def test_beside_a_hole_there_is_no_sign() -> None:
    lid = cleaned(CORNERS, FACES[2:])[0]  # the face x = 0 is missing
    found = from_mesh(np.array([[-0.2, 0.5, 0.99], [-0.2, 0.5, 1.5], [0.5, 0.5, 1.2]]), lid, 5.0)
    assert found.signed.tolist() == [False, False, True]
    assert (found.distances_m > 0.0).all()


def test_a_mesh_without_faces_or_with_wrong_numbers_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="no triangle with an area"):
        cleaned(CORNERS, np.empty((0, 3), dtype=np.int64))
    with pytest.raises(InvalidInputError, match="does not exist"):
        cleaned(CORNERS, np.array([[0, 1, 8]]))
    with pytest.raises(InvalidInputError, match="finite"):
        cleaned(np.full((3, 3), np.nan), np.array([[0, 1, 2]]))


def test_the_nearest_place_of_a_triangle_is_nearer_than_any_sampled_one() -> None:
    rng = np.random.default_rng(3)
    points, corners = rng.normal(size=(300, 3)), rng.normal(size=(300, 3, 3))
    places, parts = closest_on_triangles(points, corners)
    weights = rng.dirichlet(np.ones(3), 4000)
    sampled = np.linalg.norm(np.einsum("sw,nwk->nsk", weights, corners) - points[:, None], axis=2).min(axis=1)
    found = np.linalg.norm(places - points, axis=1)
    assert (found <= sampled + 1e-12).all()
    assert np.median(sampled - found) < 0.02
    assert {FACE} < set(parts.tolist())


def test_the_spacing_of_a_reference_cloud_is_no_deviation() -> None:
    rng = np.random.default_rng(4)
    reference = np.column_stack([rng.uniform(0, 2, (4000, 2)), np.zeros(4000)])
    points = np.column_stack([rng.uniform(0.2, 1.8, (500, 2)), np.full(500, -0.013)])
    normals = cloud_normals(reference, 0.15)
    upwards = np.where(normals[:, 2:] < 0.0, -normals, normals)
    found = from_cloud(points, reference, upwards, 0.5)
    assert found.signed.all()
    assert np.abs(found.distances_m + 0.013).max() < 1e-9


def test_what_is_no_surface_gives_distances_without_sign_and_far_points_none() -> None:
    wire = np.column_stack([np.linspace(0.0, 1.0, 50), np.zeros(50), np.zeros(50)])
    found = from_cloud(np.array([[0.5, 0.0, 0.1], [0.5, 0.0, 9.0]]), wire, cloud_normals(wire, 0.2), 0.5)
    assert found.signed.tolist() == [False, False]
    assert found.distances_m[0] == pytest.approx(0.1, abs=0.01)
    assert np.isnan(found.distances_m[1])


def test_points_belong_to_the_plane_whose_outline_they_are_before() -> None:
    square = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    planes = PlaneSet(np.zeros((2, 3)), np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]), (square, None))
    points = np.array([[0.5, 0.5, 0.02], [3.0, 0.5, 0.02], [-0.01, 5.0, 5.0], [0.5, 0.5, -0.03]])
    found = from_planes(points, planes, 1.0)
    assert found.nearest.tolist() == [0, -1, 1, 0]
    assert found.distances_m[[0, 2, 3]] == pytest.approx([0.02, -0.01, -0.03])


def test_a_polygon_with_a_notch_holds_what_is_inside_only() -> None:
    notched = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [1.0, 1.0], [0.0, 2.0]])
    assert inside_polygon(np.array([[1.0, 0.5], [1.0, 1.5], [0.2, 1.5], [3.0, 1.0]]), notched).tolist() == [
        True, False, True, False,
    ]  # fmt: skip
    with pytest.raises(InvalidInputError, match="bound nothing"):
        inside_polygon(np.zeros((1, 2)), notched[:2])


def test_statistics_leave_out_what_has_no_deviation() -> None:
    values = np.array([0.01, -0.02, np.nan, 0.03, -0.28])
    found = deviation_statistics(values, 0.02)
    assert found.count == 4
    assert found.mean_m == pytest.approx(-0.065)
    assert found.std_m == pytest.approx(np.std([0.01, -0.02, 0.03, -0.28], ddof=1))
    assert (found.largest_m, found.largest_at) == (-0.28, 4)
    assert found.share_within == 0.5
    assert found.robust_std_m < found.std_m
    with pytest.raises(InvalidInputError, match="no point has one"):
        deviation_statistics(np.full(3, np.nan), 0.01)


def test_a_histogram_counts_every_deviation_once() -> None:
    values = np.random.default_rng(5).normal(0.0, 0.01, 1000)
    found = histogram_of(np.append(values, np.nan), 0.02, 20)
    assert found.counts.sum() + found.below + found.above == 1000
    assert found.below > 0
    assert found.above > 0
