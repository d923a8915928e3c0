"""Lines where planes meet, with their Jacobians and extents."""

import dataclasses

import numpy as np
import pytest

from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.geometry.covariances import intersection_covariances, intersection_jacobians, intersection_lines
from algorithms.geometry.lines import LineSource
from algorithms.progress import NoProgress
from tests.scenes.lines.feature_scenes import SENSOR, cloud, rectangle, room, tube


def features_of(points, sensor_m=SENSOR, seed=0, **options):
    return extract_features(
        cloud(points, sensor_m), FeatureOptions(**options), progress=NoProgress(), rng=np.random.default_rng(seed)
    )


def two_planes(rng):
    """Give normals, centroids and bases of one pair of planes."""
    normals = rng.normal(size=(2, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    bases = np.stack([np.linalg.qr(np.column_stack([n, rng.normal(size=(3, 2))]))[0][:, 1:] for n in normals])
    return normals, rng.normal(size=(2, 3)) * 3.0, bases


@pytest.fixture(scope="module")
def exact_room():
    return features_of(room(np.random.default_rng(1)))


def test_a_room_has_twelve_edges(exact_room):
    assert len(exact_room.lines) == 12


def test_exact_planes_give_exact_edges(exact_room):
    lines = exact_room.lines
    off_axis = np.sort(
        np.abs(lines.anchors - (lines.anchors * lines.directions).sum(1, keepdims=True) * lines.directions)
    )
    expected = {(0.0, 1.5, 2.0), (0.0, 1.5, 3.0), (0.0, 2.0, 3.0)}
    assert {tuple(row) for row in np.round(off_axis, 8)} == expected  # m


def test_edges_are_as_long_as_the_room(exact_room):
    assert sorted(exact_room.lines.lengths) == pytest.approx(
        [3.0] * 4 + [4.0] * 4 + [6.0] * 4, abs=0.35
    )  # m: two voxels


def test_planes_that_end_before_their_intersection_give_no_line():
    rng = np.random.default_rng(2)
    floor = rectangle(rng, (-3, -2, -1.5), (6, 0, 0), (0, 3, 0), 6000, 0.001)
    wall = rectangle(rng, (-3, 2, 0.0), (6, 0, 0), (0, 0, 1.5), 4000, 0.001)
    features = features_of(np.concatenate([floor, wall]))
    assert (len(features.planes), len(features.lines)) == (2, 0)


def test_planes_that_meet_along_a_part_give_a_line_of_that_part():
    rng = np.random.default_rng(3)
    floor = rectangle(rng, (-3, -2, -1.5), (6, 0, 0), (0, 4, 0), 9000, 0.001)
    wall = rectangle(rng, (0, 2, -1.5), (2, 0, 0), (0, 0, 1.5), 2500, 0.001)
    lines = features_of(np.concatenate([floor, wall])).lines
    ends = np.sort(np.stack(lines.end_points)[:, 0, 0])
    assert ends == pytest.approx([0.0, 2.0], abs=0.2)  # m: a voxel and its half


def test_planes_at_a_flat_angle_give_no_line():
    rng = np.random.default_rng(4)
    left = rectangle(rng, (-3, 2, -1.5), (3, 0, 0), (0, 0, 3), 6000, 0.001)
    right = rectangle(rng, (0, 2, -1.5), (3, 0.4, 0), (0, 0, 3), 6000, 0.001)  # 8.5 gon
    features = features_of(np.concatenate([left, right]))
    assert (len(features.planes), len(features.lines)) == (2, 0)


def test_intersection_jacobians_agree_with_numerical_differentiation():
    rng = np.random.default_rng(5)
    normals, centroids, bases = two_planes(rng)

    def intersect(change):
        moved = []
        for k in range(2):
            a, b = change[3 * k : 3 * k + 2], change[3 * k + 2]
            n = normals[k] + bases[k] @ a
            # x stays on the changed plane through c + n b when n'.(x - c) = b; renormalising changes second order only
            moved.append((n / np.linalg.norm(n), centroids[k] + normals[k] * b))
        (ni, ci), (nj, cj) = moved
        points, units = intersection_lines(ni[None], ci[None], nj[None], cj[None])
        return points[0], units[0]

    anchor, direction = intersect(np.zeros(6))
    anchor = anchor + 0.7 * direction
    line_bases, jacobians = intersection_jacobians(
        anchor[None], direction[None], normals[:1], centroids[:1], bases[:1], normals[1:], centroids[1:], bases[1:]
    )
    E = line_bases[0]
    step = 1e-6
    numerical = np.empty((4, 6))
    for k in range(6):
        values = []
        for sign in (1.0, -1.0):
            point, unit = intersect(sign * step * np.eye(6)[k])
            # where the changed line meets the plane through the anchor across the unchanged line
            point = point + ((anchor - point) @ direction) / (unit @ direction) * unit
            values.append(np.concatenate([E.T @ unit, E.T @ (point - anchor)]))
        numerical[:, k] = (values[0] - values[1]) / (2 * step)
    assert jacobians[0] == pytest.approx(numerical, abs=1e-7)


def test_line_covariance_is_that_of_its_two_planes():
    rng = np.random.default_rng(6)
    features = features_of(room(rng, noise_m=0.002))
    lines, planes = features.lines, features.planes
    i, j = lines.parents.T
    expected = intersection_covariances(lines.parent_jacobians, planes.covariances[i], planes.covariances[j])
    assert lines.covariances == pytest.approx(expected, rel=1e-12)


def test_bases_of_lines_are_right_handed(exact_room):
    lines = exact_room.lines
    third = np.cross(lines.bases[:, :, 0], lines.bases[:, :, 1])
    assert third == pytest.approx(lines.directions, abs=1e-12)


def test_cylinder_axes_follow_the_intersections():
    rng = np.random.default_rng(7)
    pipe = tube(rng, (1.5, -1.9, 0.5), (1.5, 1.9, 0.5), 0.15, 4000, noise_m=0.001, facing=(-1, 0, 0))
    features = features_of(np.concatenate([room(rng, noise_m=0.001), pipe]))
    lines = features.lines
    # the room's twelve edges; a strip of the pipe that passes for a plane may add some
    assert (lines.sources[:-1] == LineSource.PLANE_INTERSECTION).sum() >= 12
    assert (lines.sources == LineSource.CYLINDER_AXIS).nonzero()[0].tolist() == [len(lines) - 1]
    assert list(lines.parents[-1]) == [0, -1]


def test_same_input_gives_the_same_features():
    points = room(np.random.default_rng(8), noise_m=0.003)
    first, second = features_of(points, sensor_m=SENSOR), features_of(points, sensor_m=SENSOR)
    for field in dataclasses.fields(first.lines):
        assert np.array_equal(getattr(first.lines, field.name), getattr(second.lines, field.name))


def test_a_longer_least_length_drops_short_lines():
    points = room(np.random.default_rng(9))
    assert len(features_of(points, min_line_length_m=3.5).lines) == 8
