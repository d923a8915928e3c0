"""The scenes are what their truth says."""

from dataclasses import replace

import numpy as np
import pytest

from algorithms.simulation.curved_parts import MAX_SAGITTA_M, tube
from algorithms.simulation.materials import PLASTER, STEEL
from algorithms.simulation.parts import CylinderTruth, box, slab
from algorithms.simulation.pipe_hall import pipe_hall_scene
from algorithms.simulation.ray_casting import RayCaster
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import scan_scene, simulate_stations
from algorithms.simulation.scene import Scene, scene_edges, scene_from_parts
from algorithms.simulation.scenes import SCENES
from algorithms.simulation.stations import station_pose
from algorithms.simulation.walls import Opening, wall, wall_frame

BUILDINGS = ("house", "pipe_hall", "office", "corridor")
COARSE = VirtualScanner(rows=100, columns=240, mixed_pixels=False)


def _scene(*parts: object) -> Scene:
    return scene_from_parts("test", list(parts), [station_pose((0.0, 0.0, 0.0), 0.0)])  # type: ignore[arg-type]


@pytest.mark.parametrize("name", sorted(SCENES))
def test_scenes_are_registered_under_their_own_name(name: str) -> None:
    assert SCENES[name]().name == name


@pytest.mark.parametrize("name", sorted(SCENES))
def test_no_triangle_is_degenerate(name: str) -> None:
    scene = SCENES[name]()
    a, b, c = (scene.vertices[scene.triangles[:, k]] for k in range(3))
    # A square millimetre is smaller than the smallest facet of the thinnest tube.
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).min() > 1e-6


@pytest.mark.parametrize("name", BUILDINGS)
def test_a_quarter_of_what_each_station_sees_was_in_sight_of_an_earlier_one(name: str) -> None:
    scene = SCENES[name]()
    caster = RayCaster(scene)
    scans = simulate_stations(scene, scene.stations, COARSE, np.random.default_rng(0))
    clouds = [pose.apply(scan.points[::5]) for pose, scan in zip(scene.stations, scans, strict=True)]
    for k, cloud in enumerate(clouds[1:], start=1):
        assert max(_share_in_sight(caster, cloud, pose.translation) for pose in scene.stations[:k]) > 0.25


def _share_in_sight(caster: RayCaster, points: np.ndarray, eye: np.ndarray) -> float:
    """Share of the points that nothing hides from the eye, within 30 m."""
    rays = points - eye
    distances = np.linalg.norm(rays, axis=1)
    hits = caster.cast(np.asarray(eye), rays / distances[:, None])
    return float(np.mean((np.abs(hits.ranges_m - distances) < 0.03) & (distances < 30.0)))


@pytest.mark.parametrize("name", BUILDINGS)
def test_no_station_stands_against_a_surface(name: str) -> None:
    scene = SCENES[name]()
    scanner = replace(COARSE, min_range_m=0.0)
    for scan in simulate_stations(scene, scene.stations, scanner, np.random.default_rng(0)):
        # The shortest range of the scanner as delivered.
        assert np.linalg.norm(scan.points, axis=1).min() > VirtualScanner().min_range_m


@pytest.mark.parametrize("name", BUILDINGS)
def test_buildings_have_edges_in_more_than_three_directions(name: str) -> None:
    edges = scene_edges(SCENES[name]())
    lengths = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1)
    directions = (edges[:, 1] - edges[:, 0])[lengths > 0.5] / lengths[lengths > 0.5, None]
    unique = directions[[np.all(np.abs(directions[:k] @ directions[k]) < 0.99) for k in range(len(directions))]]
    assert len(unique) > 3


def test_degenerate_scenes_have_no_edges() -> None:
    assert [len(scene_edges(SCENES[name]())) for name in ("parallel_pipes", "single_plane")] == [0, 0]


def test_a_box_has_twelve_edges_of_its_lengths() -> None:
    edges = scene_edges(_scene(box((0.0, 0.0, 0.0), (1.0, 2.0, 3.0), PLASTER, turn_rad=0.3)))
    lengths = np.sort(np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1))
    np.testing.assert_allclose(lengths, [1.0] * 4 + [2.0] * 4 + [3.0] * 4, atol=1e-12)


def test_a_smooth_joint_is_no_edge() -> None:
    left = box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), PLASTER, omit=("right",))
    right = box((1.0, 0.0, 0.0), (2.0, 1.0, 1.0), PLASTER, omit=("left",))
    edges = scene_edges(_scene(left, right))
    assert not np.any(np.all(np.abs(edges[:, :, 0] - 1.0) < 1e-9, axis=1))


def test_a_ridge_between_two_slabs_is_an_edge() -> None:
    up = np.array([0.0, 0.0, 0.1])
    south = slab(np.array([(0, -1, 0), (2, -1, 0), (2, 0, 1), (0, 0, 1)]), up, PLASTER, omit=("back",))
    north = slab(np.array([(0, 0, 1), (2, 0, 1), (2, 1, 0), (0, 1, 0)]), up, PLASTER, omit=("front",))
    edges = scene_edges(_scene(south, north))
    ridge = np.array([(0.0, 0.0, 1.1), (2.0, 0.0, 1.1)])
    assert any(np.allclose(edge, ridge) or np.allclose(edge, ridge[::-1]) for edge in edges)


def test_a_window_has_its_reveals_as_edges() -> None:
    window = Opening(1.0, 2.0, 0.8, 2.0, frame_depth_m=None)
    frame = wall_frame((0.0, 0.0), (4.0, 0.0))
    edges = scene_edges(_scene(*wall(frame, np.array([[0.0, 3.0], [4.0, 3.0]]), [window], PLASTER, reveal_m=0.25)))
    # Four around the opening, four into the depth; the free rims of an infinitely thin face are none.
    lengths = np.sort(np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1))
    np.testing.assert_allclose(lengths, [0.25] * 4 + [1.0] * 2 + [1.2] * 2, atol=1e-12)


def test_the_foot_of_a_wall_is_cut_by_its_door() -> None:
    door = Opening(1.0, 2.0, 0.0, 2.0, frame_depth_m=None)
    parts = wall(wall_frame((0.0, 0.0), (4.0, 0.0)), np.array([[0.0, 3.0], [4.0, 3.0]]), [door], PLASTER)
    ends = np.sort(parts[0].edges[:, :, 0], axis=1)[np.all(parts[0].edges[:, :, 2] == 0.0, axis=1)]
    np.testing.assert_allclose(np.sort(ends, axis=0), [[0.0, 1.0], [2.0, 4.0]], atol=1e-12)


@pytest.mark.parametrize("radius", [0.03, 0.11, 0.9])
def test_scanned_tubes_have_the_true_radius(radius: float) -> None:
    scene = _scene(tube((2.0, 1.0, -3.0), (2.5, -0.4, 3.0), radius, STEEL))
    scanner = VirtualScanner(rows=500, columns=600, range_noise_std_m=0.0, angle_noise_std_rad=0.0, mixed_pixels=False)
    points = scan_scene(scene, scene.stations[0], scanner, np.random.default_rng(0)).points
    truth = scene.cylinders[0]
    start, axis = np.array(truth.start_m), np.array(truth.end_m) - np.array(truth.start_m)
    axis /= np.linalg.norm(axis)
    deviation = np.linalg.norm(np.cross(points - start, axis), axis=1) - radius
    assert np.abs(deviation).max() <= MAX_SAGITTA_M
    # The facets' mean distance is the radius; the beams sample them unevenly.
    assert abs(deviation.mean()) < 0.1 * MAX_SAGITTA_M


def test_the_pipe_hall_has_pipes_along_three_axes_and_oblique_ones() -> None:
    cylinders: tuple[CylinderTruth, ...] = pipe_hall_scene().cylinders
    axes = np.array([np.array(c.end_m) - np.array(c.start_m) for c in cylinders])
    axes = np.abs(axes / np.linalg.norm(axes, axis=1, keepdims=True))
    along = [int(np.sum(axes[:, k] > 0.999)) for k in range(3)]
    assert min(along) >= 4
    assert len(cylinders) > sum(along)
    assert len({c.radius_m for c in cylinders}) >= 8


def test_a_level_station_keeps_the_vertical_and_turns_by_its_heading() -> None:
    pose = station_pose((1.0, 2.0, 3.0), np.pi / 2)
    np.testing.assert_allclose(pose.apply([1.0, 0.0, 0.0]), [1.0, 3.0, 3.0], atol=1e-15)
    np.testing.assert_allclose(pose.apply([0.0, 0.0, 1.0]), [1.0, 2.0, 4.0], atol=1e-15)


def test_tilt_is_about_the_scanners_own_axes() -> None:
    pose = station_pose((0.0, 0.0, 0.0), 0.7, 0.2, 0.0)
    heading_only = station_pose((0.0, 0.0, 0.0), 0.7)
    np.testing.assert_allclose(pose.apply([1.0, 0.0, 0.0]), heading_only.apply([1.0, 0.0, 0.0]), atol=1e-15)
