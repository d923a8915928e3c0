"""Planes from scans: found, kept apart, bounded, oriented."""

import numpy as np
import pytest

from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.features.planes.plane_boundaries import outline, signed_area
from algorithms.progress import NoProgress
from algorithms.scans.instrument_errors import TimeSource
from algorithms.scans.scan import Scan
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import scan_scene
from algorithms.simulation.scenes import SCENES
from tests.scenes.lines.feature_scenes import SENSOR, cloud, rectangle, room, tube


def features_of(points, sensor_m=SENSOR, **options):
    return extract_features(
        cloud(points, sensor_m), FeatureOptions(**options), progress=NoProgress(), rng=np.random.default_rng(0)
    )


@pytest.fixture(scope="module")
def exact_room():
    return features_of(room(np.random.default_rng(1)))


def test_a_room_has_six_planes(exact_room):
    assert len(exact_room.planes) == 6


def test_exact_points_give_exact_planes(exact_room):
    offsets = sorted(np.abs(exact_room.planes.offsets))
    assert offsets == pytest.approx([1.5, 1.5, 2.0, 2.0, 3.0, 3.0], abs=1e-9)  # m; only rounding is left


def test_normals_of_planes_point_to_the_sensor(exact_room):
    planes = exact_room.planes
    assert (np.einsum("ij,ij->i", planes.normals, SENSOR - planes.centroids) > 0).all()


def test_bases_of_planes_are_right_handed(exact_room):
    planes = exact_room.planes
    third = np.cross(planes.bases[:, :, 0], planes.bases[:, :, 1])
    assert third == pytest.approx(planes.normals, abs=1e-12)


def test_areas_are_those_of_the_faces(exact_room):
    assert sorted(exact_room.planes.areas_m2) == pytest.approx([12, 12, 18, 18, 24, 24], rel=0.06)  # half a raster cell


def test_surface_sample_knows_its_planes(exact_room):
    surface = exact_room.surface
    on_plane = surface.plane_labels >= 0
    assert on_plane.mean() > 0.9
    planes = exact_room.planes
    own = surface.plane_labels[on_plane]
    gap = np.einsum("ij,ij->i", surface.points[on_plane] - planes.centroids[own], planes.normals[own])
    assert np.abs(gap).max() < 0.1  # m: one voxel


def test_a_door_leaf_three_centimetres_off_its_wall_is_a_plane_of_its_own():
    rng = np.random.default_rng(2)
    wall = rectangle(rng, (-3, 2, -1.5), (6, 0, 0), (0, 0, 3), 9000, 0.002)
    behind_door = (np.abs(wall[:, 0]) < 0.45) & (wall[:, 2] < 0.5)
    door = rectangle(rng, (-0.45, 1.97, -1.5), (0.9, 0, 0), (0, 0, 2), 900, 0.002)
    planes = features_of(np.concatenate([wall[~behind_door], door])).planes
    assert sorted(-planes.offsets) == pytest.approx([1.97, 2.0], abs=0.001)  # m: sixth of the noise, 900 points


def test_two_pieces_of_one_wall_side_by_side_become_one_plane():
    rng = np.random.default_rng(3)
    left = rectangle(rng, (-3, 2, -1.5), (3, 0, 0), (0, 0, 3), 6000, 0.002)
    right = rectangle(rng, (0, 2.001, -1.5), (3, 0, 0), (0, 0, 3), 6000, 0.002)
    assert len(features_of(np.concatenate([left, right])).planes) == 1


def test_a_pipe_holds_no_plane():
    rng = np.random.default_rng(4)
    pipe = tube(rng, (3, -2, 0), (3, 2, 0), 0.3, 30_000, noise_m=0.002, facing=(-1, 0, 0))
    assert len(features_of(pipe).planes) == 0


def test_an_outline_takes_holes_off_and_adds_pieces():
    raster = np.zeros((40, 60), dtype=np.uint8)
    raster[5:35, 5:35] = 1
    raster[15:25, 15:25] = 0
    raster[10:20, 45:55] = 1
    # a quarter cell is lost along every border: 30 x 30 -> 29.5 x 29.5, the hole grows to 10.5 x 10.5
    assert abs(signed_area(outline(raster))) == pytest.approx(29.5**2 - 10.5**2 + 9.5**2, rel=0.02)


def test_an_unknown_sensor_is_found_from_the_cloud():
    features = features_of(room(np.random.default_rng(5), noise_m=0.002), sensor_m=None)
    assert features.sensor_m is not None
    assert features.seen is not None


@pytest.fixture(scope="module")
def scanned_room():
    scene = SCENES["office"]()
    scanner = VirtualScanner(rows=150, columns=400)
    return scan_scene(scene, scene.stations[0], scanner, np.random.default_rng(5))


@pytest.mark.parametrize("shift_m", [0.0, 2.5], ids=["origin", "beside it"])
def test_a_cloud_tells_of_its_instrument_where_it_is_seen_from_the_origin_of_its_file(scanned_room, shift_m):
    seconds = np.linspace(0.0, 100.0, len(scanned_room.points), dtype=np.float32)
    cloud_of_las = Scan(
        points=scanned_room.points + np.array([shift_m, 0.0, 0.0]), origin_m=np.zeros(3), times_s=seconds
    )
    features = extract_features(cloud_of_las, FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0))
    assert (features.plane_responses is None) == (shift_m > 0.0)
    assert (features.sweep is None) == (shift_m > 0.0)
    if features.sweep is not None:
        assert features.sweep.told_by == TimeSource.TIME_STAMPS
        assert features.sweep.duration_s == pytest.approx(100.0)


def test_noise_is_that_of_the_points():
    features = features_of(room(np.random.default_rng(6), noise_m=0.003))
    assert features.noise_std_m == pytest.approx(0.003, rel=0.1)


def test_scattered_points_give_no_planes():
    points = np.random.default_rng(7).random((4000, 3)) * 4.0
    assert len(features_of(points).planes) == 0


def test_a_single_point_gives_no_features():
    features = features_of(np.array([[1.0, 2.0, 3.0]]))
    assert (len(features.planes), len(features.lines), len(features.cylinders)) == (0, 0, 0)
