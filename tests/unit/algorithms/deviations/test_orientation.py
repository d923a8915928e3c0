"""Which side of a surface is positive, told, found or called arbitrary."""

import numpy as np
import pytest

from algorithms.arrays import Array
from algorithms.deviations.orientation import OrientedBy, Side, orientation


def scattered(normals: Array) -> Array:
    """Turn normals this way and that, as fits leave them."""
    signs = np.where(np.random.default_rng(1).random(len(normals)) < 0.5, -1.0, 1.0)
    return np.asarray(normals * signs[:, None])


def ground() -> tuple[Array, Array]:
    xy = np.random.default_rng(2).uniform(-30.0, 30.0, (4000, 2))
    slopes = np.stack([0.5 / 9 * np.cos(xy[:, 0] / 9) + 0.03, -0.4 / 7 * np.sin(xy[:, 1] / 7)], axis=1)
    z = 0.5 * np.sin(xy[:, 0] / 9) + 0.4 * np.cos(xy[:, 1] / 7) + 0.03 * xy[:, 0]
    normals = np.column_stack([-slopes, np.ones(len(xy))])
    return normals / np.linalg.norm(normals, axis=1)[:, None], np.column_stack([xy, z])


def box(thickness: float = 3.0) -> tuple[Array, Array]:
    """Give the six faces of a box with their outer normals."""
    rng, sides = np.random.default_rng(3), np.array([6.0, 4.0, thickness])
    places, normals = [], []
    for axis in range(3):
        for side in (0.0, 1.0):
            area = np.prod(np.delete(sides, axis))
            points = rng.uniform(0.0, 1.0, (int(60 * area), 3)) * sides
            points[:, axis] = side * sides[axis]
            places.append(points)
            normals.append(np.tile(np.eye(3)[axis] * (2.0 * side - 1.0), (len(points), 1)))
    return np.concatenate(normals), np.concatenate(places)


@pytest.mark.parametrize("shift", [[0.0, 0.0, 0.0], [690_000.0, 5_340_000.0, 500.0], [0.0, 0.0, 100.0]])
def test_a_terrain_looks_upwards_wherever_its_frame_begins(shift: list[float]) -> None:
    normals, places = ground()
    found = orientation(scattered(normals), places + shift, None, None)
    assert found.by is OrientedBy.UP
    np.testing.assert_array_equal(found.normals, normals)


def test_a_room_with_its_ceiling_is_no_terrain() -> None:
    xy = np.random.default_rng(4).uniform(0.0, 6.0, (3000, 2))
    places = np.column_stack([xy, np.where(np.arange(3000) % 2, 2.5, 0.0)])
    assert orientation(np.tile([0.0, 0.0, 1.0], (3000, 1)), places, None, None).by is OrientedBy.NEIGHBOURS


@pytest.mark.parametrize("thickness", [3.0, 0.3])
def test_a_body_keeps_one_side_all_around_and_its_sign_is_arbitrary(thickness: float) -> None:
    normals, places = box(thickness)
    found = orientation(scattered(normals), places, None, None)
    same = np.einsum("ij,ij->i", found.normals, normals)
    assert found.is_arbitrary
    assert abs(same.mean()) > 0.98


def test_a_stated_side_and_the_instruments_decide_before_all_else() -> None:
    normals, places = ground()
    below = orientation(scattered(normals), places, None, Side(direction=np.array([0.0, 0.0, -2.0])))
    assert below.by is OrientedBy.STATED
    np.testing.assert_array_equal(below.normals, -normals)
    point = orientation(scattered(normals), places, None, Side(point_m=np.array([0.0, 0.0, -500.0])))
    np.testing.assert_array_equal(point.normals, -normals)
    instruments = np.where(places[:, :1] < 0.0, [[0.0, 0.0, 50.0]], [[0.0, 0.0, -50.0]])
    found = orientation(scattered(normals), places, instruments, None)
    assert found.by is OrientedBy.INSTRUMENTS
    np.testing.assert_array_equal(np.sign(found.normals[:, 2]), np.where(places[:, 0] < 0.0, 1.0, -1.0))


def test_what_is_no_surface_stays_without_a_normal() -> None:
    normals, places = ground()
    normals[::7] = 0.0
    assert not orientation(normals, places, None, None).normals[::7].any()
