"""Where the instrument stood, told from the cloud alone."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.scans.range_image import Visibility, conservative_nearest_m, spherical_range_image, visibility
from algorithms.scans.sensor_position import estimate_sensor_position, hidden_shares

CELL_RAD = np.radians(1.0)


def _grid(u: tuple[float, float], v: tuple[float, float], step: float = 0.12) -> tuple[np.ndarray, np.ndarray]:
    a, b = np.meshgrid(np.arange(*u, step), np.arange(*v, step))
    return a.ravel(), b.ravel()


def room_with_columns(sensor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A room of 10 x 8 x 3 m with two columns, as far as an instrument at `sensor` sees it: points and normals."""
    parts, normals = [], []
    for axis, value in ((2, 0.0), (2, 3.0), (0, 0.0), (0, 10.0), (1, 0.0), (1, 8.0)):
        others = [k for k in range(3) if k != axis]
        a, b = _grid((0.0, (10.0, 8.0, 3.0)[others[0]]), (0.0, (10.0, 8.0, 3.0)[others[1]]))
        wall = np.empty((len(a), 3))
        wall[:, axis], wall[:, others[0]], wall[:, others[1]] = value, a, b
        parts.append(wall)
        normals.append(np.tile(np.eye(3)[axis], (len(a), 1)))
    columns = [((3.0, 3.6), (5.0, 5.6)), ((6.5, 7.1), (2.0, 2.6)), ((2.0, 2.5), (1.0, 1.5))]
    for (x0, x1), (y0, y1) in columns:
        for axis, value, span in ((0, x0, (y0, y1)), (0, x1, (y0, y1)), (1, y0, (x0, x1)), (1, y1, (x0, x1))):
            a, b = _grid(span, (0.0, 3.0))
            side = np.empty((len(a), 3))
            side[:, axis], side[:, 1 - axis], side[:, 2] = value, a, b
            parts.append(side)
            normals.append(np.tile(np.eye(3)[axis], (len(a), 1)))
    points, normal = np.vstack(parts), np.vstack(normals)
    seen = np.ones(len(points), dtype=bool)
    rays = points - sensor
    for (x0, x1), (y0, y1) in columns:
        low, high = np.array([x0, y0]), np.array([x1, y1])
        with np.errstate(divide="ignore", invalid="ignore"):
            t0, t1 = (low - sensor[:2]) / rays[:, :2], (high - sensor[:2]) / rays[:, :2]
        enter, leave = np.nanmax(np.minimum(t0, t1), axis=1), np.nanmin(np.maximum(t0, t1), axis=1)
        seen &= ~((enter < leave) & (enter > 0.0) & (enter < 0.999))
    return points[seen], normal[seen]


def test_the_position_is_found_wherever_the_scan_was_moved() -> None:
    sensor = np.array([4.5, 3.8, 1.6])
    points, normals = room_with_columns(sensor)
    motion = RigidTransform.from_components([20.0, -35.0, 8.0], Rotation.random(random_state=4))
    estimate = estimate_sensor_position(
        motion.apply(points), motion.rotation.apply(normals), rng=np.random.default_rng(0)
    )
    assert estimate.position_m is not None
    # A nearly empty room of 10 m hides little: 1.5 m is what its three columns can tell.
    assert np.linalg.norm(estimate.position_m - motion.apply(sensor)) < 1.5


def test_in_an_open_square_where_nothing_hides_anything_equal_steps_of_angle_tell_the_position() -> None:
    zenith, azimuth = np.meshgrid(np.radians(np.arange(40.0, 130.0, 0.8)), np.radians(np.arange(0.0, 360.0, 0.8)))
    rays = np.column_stack(
        [(np.sin(zenith) * np.cos(azimuth)).ravel(), (np.sin(zenith) * np.sin(azimuth)).ravel(), np.cos(zenith).ravel()]
    )
    sensor = np.array([0.0, 0.0, 1.7])
    with np.errstate(divide="ignore"):
        to_ground, to_facade = -sensor[2] / rays[:, 2], 15.0 / rays[:, 0]
    ranges = np.where(to_ground > 0.0, to_ground, np.inf), np.where(to_facade > 0.0, to_facade, np.inf)
    nearest = np.minimum(*ranges)
    seen = nearest < 30.0
    points = sensor + rays[seen] * nearest[seen, None]
    normals = np.where((ranges[0] < ranges[1])[seen, None], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0])
    motion = RigidTransform.from_components([-6.0, 11.0, 3.0], Rotation.random(random_state=5))
    estimate = estimate_sensor_position(
        motion.apply(points), motion.rotation.apply(normals), rng=np.random.default_rng(0)
    )
    assert estimate.position_m is not None
    # Positions 20 m away hide nothing either.
    assert np.linalg.norm(estimate.position_m - motion.apply(sensor)) < 1.0


def test_a_candidate_next_to_the_best_position_is_taken_although_it_is_worse() -> None:
    sensor = np.array([4.5, 3.8, 1.6])
    points, normals = room_with_columns(sensor)
    best = estimate_sensor_position(points, normals, rng=np.random.default_rng(0)).position_m
    assert best is not None
    candidate = best + np.array([0.3, -0.2, 0.1])
    estimate = estimate_sensor_position(points, normals, candidate_m=candidate, rng=np.random.default_rng(0))
    np.testing.assert_array_equal(estimate.position_m, candidate)


@pytest.mark.slow
def test_the_standard_deviation_tells_where_much_is_hidden_from_where_hardly_anything_is() -> None:
    """Columns in a room leave the instrument one place; before one bare wall it may have stood anywhere."""
    sensor = np.array([4.5, 3.8, 1.6])
    points, normals = room_with_columns(sensor)
    among_columns = estimate_sensor_position(points, normals, rng=np.random.default_rng(0))
    y, z = _grid((-10.0, 10.0), (0.0, 6.0))
    wall = np.column_stack([np.zeros(len(y)), y, z])
    before_a_wall = estimate_sensor_position(
        wall, np.tile([1.0, 0.0, 0.0], (len(wall), 1)), rng=np.random.default_rng(0)
    )
    assert among_columns.position_m is not None
    assert among_columns.std_m is not None
    assert before_a_wall.std_m is not None
    assert np.linalg.norm(among_columns.position_m - sensor) < 3.0 * among_columns.std_m
    assert among_columns.std_m < 0.5 * before_a_wall.std_m


def test_the_given_candidate_is_taken_when_nothing_speaks_against_it() -> None:
    sensor = np.array([4.5, 3.8, 1.6])
    points, normals = room_with_columns(sensor)
    estimate = estimate_sensor_position(points, normals, candidate_m=sensor, rng=np.random.default_rng(0))
    np.testing.assert_array_equal(estimate.position_m, sensor)


def test_a_candidate_outside_the_room_is_not_taken() -> None:
    sensor = np.array([4.5, 3.8, 1.6])
    points, normals = room_with_columns(sensor)
    estimate = estimate_sensor_position(
        points, normals, candidate_m=np.array([-2.0, 4.0, 1.5]), rng=np.random.default_rng(0)
    )
    assert estimate.position_m is not None
    assert np.linalg.norm(estimate.position_m - sensor) < 1.5


def test_too_few_points_give_no_position() -> None:
    points = np.random.default_rng(1).uniform(size=(50, 3))
    assert estimate_sensor_position(points, np.zeros((50, 3)), rng=np.random.default_rng(0)).position_m is None


def test_hardly_anything_is_hidden_from_the_true_position_and_much_from_another() -> None:
    sensor = np.array([4.5, 3.8, 1.6])
    points, normals = room_with_columns(sensor)
    shares = hidden_shares(points, normals, np.array([sensor, [9.5, 7.5, 2.9]]), cells=118, spacing_m=0.12)
    assert shares[0] < 0.02
    assert shares[1] > 0.05


def test_the_range_image_knows_nearest_and_farthest_range_of_a_direction() -> None:
    points = np.array([[3.0, 0.001, 0.0], [5.0, 0.001, 0.0]])
    image = spherical_range_image(points, np.zeros(3), CELL_RAD)
    seen = np.isfinite(image.nearest_m)
    assert seen.sum() == 1
    assert image.nearest_m[seen][0] == pytest.approx(3.0, abs=1e-5)  # float32
    assert image.farthest_m[seen][0] == pytest.approx(5.0, abs=1e-5)


def test_a_splat_covers_the_cells_its_disc_spans() -> None:
    image = spherical_range_image(np.array([[2.0, 0.0, 0.0]]), np.zeros(3), CELL_RAD, splat_m=0.1)
    # A disc of 0.1 m radius at 2 m spans 5.7 degrees: 5 to 8 cells each way.
    assert 25 <= np.isfinite(image.nearest_m).sum() <= 64


def test_places_before_on_and_behind_a_wall_are_free_surface_and_hidden() -> None:
    y, z = _grid((-3.0, 3.0), (-3.0, 3.0), 0.05)
    image = spherical_range_image(np.column_stack([np.full(len(y), 4.0), y, z]), np.zeros(3), CELL_RAD, splat_m=0.05)
    places = np.array([[2.0, 0.1, 0.1], [4.0, 0.1, 0.1], [7.0, 0.1, 0.1], [-2.0, 0.1, 0.1]])
    wanted = [Visibility.FREE, Visibility.SURFACE, Visibility.HIDDEN, Visibility.UNKNOWN]
    assert [Visibility(k) for k in visibility(places, image)] == wanted


def test_a_grazing_floor_is_never_in_its_own_free_space() -> None:
    x, y = _grid((-20.0, 20.0), (-20.0, 20.0), 0.15)
    floor = np.column_stack([x, y, np.full(len(x), -1.7)])
    image = spherical_range_image(floor, np.zeros(3), CELL_RAD, splat_m=0.1)
    between = floor + np.array([0.07, 0.07, 0.0])
    assert not (visibility(between, image) == int(Visibility.FREE)).any()


def test_conservative_ranges_leave_unknown_directions_unknown() -> None:
    image = spherical_range_image(np.array([[2.0, 0.0, 0.0]]), np.zeros(3), CELL_RAD)
    np.testing.assert_array_equal(np.isfinite(conservative_nearest_m(image)), np.isfinite(image.nearest_m))


def test_where_no_ray_fell_what_is_next_to_it_may_reach_into_the_gap() -> None:
    """A column before a wall, with a gap of one cell between their last and first rays: next to it nothing is free."""
    turns = (np.arange(-20, 20) + 0.5) * CELL_RAD
    turns = turns[np.abs(turns - 0.5 * CELL_RAD) > 1e-9]
    ranges = np.where(turns < 0.0, 2.0, 6.0)
    points = np.column_stack([ranges * np.cos(turns), ranges * np.sin(turns), np.full(len(turns), 0.001)])
    image = spherical_range_image(points, np.zeros(3), CELL_RAD)
    row = np.flatnonzero(np.isfinite(image.nearest_m).any(axis=1))[0]
    gap = int(np.pi / CELL_RAD)
    assert not np.isfinite(image.nearest_m[row, gap])
    known = conservative_nearest_m(image)[row]
    np.testing.assert_allclose(known[gap + 1 : gap + 3], [2.0, 6.0], atol=1e-5)
    assert not np.isfinite(known[gap])
