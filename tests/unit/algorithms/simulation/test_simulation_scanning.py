"""The virtual scanner measures what it says it measures."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import RigidTransform

from algorithms.errors import InvalidInputError
from algorithms.scans.scan import Scan
from algorithms.simulation.degenerate_scenes import single_plane_scene
from algorithms.simulation.house import house_scene
from algorithms.simulation.materials import GLASS, PAINT, Material
from algorithms.simulation.office import office_scene
from algorithms.simulation.parts import polygons
from algorithms.simulation.scanner import VirtualScanner, directions_of, scanner_with_step
from algorithms.simulation.scanning import scan_scene, simulate_stations
from algorithms.simulation.scene import Scene, scene_from_parts, triangles_at
from algorithms.simulation.stations import station_pose

EXACT = VirtualScanner(
    rows=60, columns=144, range_noise_std_m=0.0, angle_noise_std_rad=0.0, mixed_pixels=False, intensity_noise=0.0
)
LEVEL = station_pose((0.0, 0.0, 0.0), 0.0)
HEIGHT_M = 1.7


def _upright(x: float, low_y: float, high_y: float, material: Material = PAINT) -> Scene:
    """A panel across the x axis, 4 m high."""
    ring = np.array([(x, low_y, -2.0), (x, high_y, -2.0), (x, high_y, 2.0), (x, low_y, 2.0)])
    return scene_from_parts("panel", [polygons([ring], material)], [LEVEL])


def _joined(*scenes: Scene) -> Scene:
    parts = [polygons([s.vertices[t] for t in s.triangles], s.materials[0], with_edges=False) for s in scenes]
    return scene_from_parts("joined", parts, [LEVEL])


def _rows_and_columns(scan: Scan) -> tuple[np.ndarray, np.ndarray]:
    """Row and column of each point."""
    assert scan.grid is not None
    rows, columns = np.nonzero(scan.grid.index >= 0)
    order = np.argsort(scan.grid.index[rows, columns])
    return rows[order], columns[order]


def test_the_same_seed_gives_the_same_scan_bit_for_bit() -> None:
    scene = house_scene()
    scanner = VirtualScanner(rows=80, columns=200)
    one, two = (scan_scene(scene, scene.stations[0], scanner, np.random.default_rng(7)) for _ in range(2))
    np.testing.assert_array_equal(one.points, two.points)
    np.testing.assert_array_equal(one.intensity, two.intensity)


def test_another_seed_gives_another_scan() -> None:
    scene = single_plane_scene()
    one, two = (scan_scene(scene, LEVEL_ABOVE, replace(EXACT, range_noise_std_m=0.002), _rng(k)) for k in (1, 2))
    assert np.abs(one.points - two.points).max() > 1e-4


@pytest.mark.parametrize("scene", [house_scene(), office_scene()], ids=lambda s: s.name)
def test_without_noise_every_point_mapped_by_the_tilted_pose_lies_on_the_mesh(scene: Scene) -> None:
    pose = scene.stations[4]
    scan = scan_scene(scene, pose, EXACT, _rng())
    in_world = pose.apply(scan.points)[::7]
    # 1e-9 m off the plane is rounding; 1 micrometre beside the rim is the single precision of the search tree.
    off_plane = [
        np.abs(scene.normals[at] @ p - scene.offsets_m[at]).min(initial=1.0) for p, at in _on_mesh(scene, in_world)
    ]
    assert max(off_plane) < 1e-9


def _on_mesh(scene: Scene, points: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    return [(p, triangles_at(scene, p)) for p in points]


LEVEL_ABOVE = station_pose((0.0, 0.0, HEIGHT_M), 0.0)


def _rng(seed: int = 5) -> np.random.Generator:
    return np.random.default_rng(seed)


def _plane_ranges(pose: RigidTransform, azimuths: np.ndarray, elevations: np.ndarray) -> np.ndarray:
    """Ranges to the level ground z = 0 in closed form."""
    directions = pose.rotation.apply(directions_of(azimuths, elevations))
    return np.asarray(-pose.translation[2] / directions[:, 2])


def test_range_noise_has_the_stated_standard_deviation() -> None:
    pose = station_pose((0.0, 0.0, HEIGHT_M), 0.4, 0.05, -0.1)
    scanner = replace(EXACT, rows=100, columns=250, range_noise_std_m=0.003)
    scan = scan_scene(single_plane_scene(), pose, scanner, _rng())
    rows, columns = _rows_and_columns(scan)
    true = _plane_ranges(pose, scanner.azimuths(columns), scanner.elevations(rows))
    normalised = (np.linalg.norm(scan.points, axis=1) - true) / 0.003
    low, high = stats.chi2.interval(0.999, len(normalised))
    assert low < np.sum(normalised**2) < high


def test_range_noise_grows_with_distance_slant_and_darkness_as_stated() -> None:
    scanner = replace(
        EXACT,
        rows=100,
        columns=250,
        range_noise_std_m=0.001,
        range_noise_per_m=2e-4,
        range_noise_footprint=0.3,
        range_noise_reflectance_exponent=0.5,
    )
    scan = scan_scene(single_plane_scene(), LEVEL_ABOVE, scanner, _rng())
    rows, columns = _rows_and_columns(scan)
    true = _plane_ranges(LEVEL_ABOVE, scanner.azimuths(columns), scanner.elevations(rows))
    tangent = np.sqrt(true**2 - HEIGHT_M**2) / HEIGHT_M
    slant = 0.3 * 0.5 * (0.003 + 0.3e-3 * true) * tangent
    std = np.sqrt(0.001**2 + (2e-4 * true) ** 2 + slant**2) / np.sqrt(0.45 / 0.5)
    normalised = (np.linalg.norm(scan.points, axis=1) - true) / std
    low, high = stats.chi2.interval(0.999, len(normalised))
    assert low < np.sum(normalised**2) < high


def test_angle_noise_moves_the_beam_but_not_the_recorded_direction() -> None:
    pose = station_pose((0.0, 0.0, HEIGHT_M), 0.4, 0.3, -0.2)
    std = 5e-5
    scanner = replace(EXACT, rows=100, columns=250, angle_noise_std_rad=std, max_incidence_rad=np.deg2rad(75.0))
    scan = scan_scene(single_plane_scene(), pose, scanner, _rng())
    rows, columns = _rows_and_columns(scan)
    azimuths, elevations = scanner.azimuths(columns), scanner.elevations(rows)
    # The range error of a tilted circle pair on a plane, by central differences of the closed form.
    h = 1e-6
    by_azimuth = (_plane_ranges(pose, azimuths + h, elevations) - _plane_ranges(pose, azimuths - h, elevations)) / (
        2 * h
    )
    by_elevation = (_plane_ranges(pose, azimuths, elevations + h) - _plane_ranges(pose, azimuths, elevations - h)) / (
        2 * h
    )
    error = np.linalg.norm(scan.points, axis=1) - _plane_ranges(pose, azimuths, elevations)
    normalised = error / (std * np.hypot(by_azimuth, by_elevation))
    low, high = stats.chi2.interval(0.999, len(normalised))
    assert low < np.sum(normalised**2) < high


def test_points_lie_in_the_direction_of_their_grid_cell() -> None:
    scene = house_scene()
    scanner = VirtualScanner(rows=80, columns=200, angle_noise_std_rad=1e-3)
    scan = scan_scene(scene, scene.stations[1], scanner, _rng())
    rows, columns = _rows_and_columns(scan)
    nominal = directions_of(scanner.azimuths(columns), scanner.elevations(rows))
    measured = scan.points / np.linalg.norm(scan.points, axis=1, keepdims=True)
    # Rounding of a product and a norm.
    np.testing.assert_allclose(measured, nominal, atol=1e-14)


def test_the_grid_counts_every_point_once() -> None:
    scene = house_scene()
    scan = scan_scene(scene, scene.stations[1], VirtualScanner(rows=80, columns=200), _rng())
    assert scan.grid is not None
    numbers = scan.grid.index[scan.grid.index >= 0]
    np.testing.assert_array_equal(np.sort(numbers), np.arange(len(scan)))


def test_the_top_row_looks_up_and_azimuth_grows_with_the_column() -> None:
    scanner = scanner_with_step(np.deg2rad(1.0))
    assert (scanner.rows, scanner.columns) == (150, 360)
    np.testing.assert_allclose(np.rad2deg(scanner.elevations(np.array([0, 149]))), [89.5, -59.5], atol=1e-9)
    np.testing.assert_allclose(np.rad2deg(scanner.azimuths(np.array([0, 359]))), [-179.5, 179.5], atol=1e-9)


def test_panes_that_let_nothing_back_only_return_the_mirror_spot() -> None:
    scene = _joined(_upright(3.0, -2.0, 2.0, GLASS), _upright(5.0, -2.0, 2.0))
    scanner = replace(EXACT, rows=300, columns=720, glass_pass_probability=0.0)
    scan = scan_scene(scene, LEVEL, scanner, _rng())
    incidence = np.arccos(scan.points[:, 0] / np.linalg.norm(scan.points, axis=1))
    np.testing.assert_allclose(scan.points[:, 0], 3.0, atol=1e-9)
    assert incidence.max() <= scanner.glass_return_incidence_rad


def test_panes_that_pass_the_beam_show_the_wall_behind() -> None:
    scene = _joined(_upright(3.0, -2.0, 2.0, GLASS), _upright(5.0, -2.0, 2.0))
    scanner = replace(EXACT, glass_pass_probability=1.0, glass_return_incidence_rad=0.0)
    scan = scan_scene(scene, LEVEL, scanner, _rng())
    bare = scan_scene(_upright(5.0, -2.0, 2.0), LEVEL, scanner, _rng())
    np.testing.assert_array_equal(scan.points, bare.points)


def test_flat_incidence_drops_out() -> None:
    limit = np.deg2rad(60.0)
    scan = scan_scene(single_plane_scene(), LEVEL_ABOVE, replace(EXACT, max_incidence_rad=limit), _rng())
    incidence = np.arccos(HEIGHT_M / np.linalg.norm(scan.points, axis=1))
    # One row of the 2.5 degree grid lies within the limit and is there.
    assert np.deg2rad(57.0) < incidence.max() <= limit


def test_far_points_drop_out() -> None:
    scan = scan_scene(single_plane_scene(), LEVEL_ABOVE, replace(EXACT, max_range_m=6.0), _rng())
    assert 4.5 < np.linalg.norm(scan.points, axis=1).max() <= 6.0


def test_dark_surfaces_drop_out_earlier() -> None:
    dark = Material("soot", 0.025)
    scanner = replace(EXACT, rows=300, columns=720, max_range_m=10.0)
    # sqrt(0.025 / 0.1) = half the reach at normal incidence.
    assert len(scan_scene(_upright(4.9, -2.0, 2.0, dark), LEVEL, scanner, _rng())) > 0
    assert len(scan_scene(_upright(5.1, -2.0, 2.0, dark), LEVEL, scanner, _rng())) == 0


def test_random_dropouts_take_their_share() -> None:
    scene = single_plane_scene()
    everything = len(scan_scene(scene, LEVEL_ABOVE, EXACT, _rng()))
    left = len(scan_scene(scene, LEVEL_ABOVE, replace(EXACT, dropout_probability=0.3), _rng()))
    # Five standard deviations of the binomial distribution.
    assert abs(left - 0.7 * everything) < 5.0 * np.sqrt(0.21 * everything)


MIXING = replace(
    EXACT, rows=60, columns=3600, lowest_rad=-0.3, highest_rad=0.3, mixed_pixels=True, beam_divergence_rad=2e-3
)
SLANT_M = 0.005
"""Part of a footprint (radius 4 mm) on a face at up to 45 degrees: its mean range differs from the centre's by less."""
BEFORE_A_WALL = _joined(_upright(4.0, -1.0, 1.0), _upright(4.5, -3.0, 3.0))


def test_mixed_pixels_lie_between_foreground_and_background() -> None:
    scan = scan_scene(BEFORE_A_WALL, LEVEL, MIXING, _rng())
    between = (scan.points[:, 0] > 4.0 + SLANT_M) & (scan.points[:, 0] < 4.5 - SLANT_M)
    assert np.count_nonzero(between) > 100
    assert scan.points[:, 0].min() > 4.0 - SLANT_M
    assert scan.points[:, 0].max() < 4.5 + SLANT_M


def test_mixed_pixels_only_occur_at_the_depth_edge() -> None:
    scan = scan_scene(BEFORE_A_WALL, LEVEL, MIXING, _rng())
    x, y, _ = scan.points.T
    between = (x > 4.0 + SLANT_M) & (x < 4.5 - SLANT_M)
    beside_edge = np.abs(np.abs(y / x) - 0.25)
    # Radius of the footprint seen from the scanner: half the divergence and half the exit diameter at 4 m, slanted.
    assert beside_edge[between].max() < 2.0 * (1e-3 + 0.0015 / 4.0)


def test_without_mixing_every_point_lies_on_a_surface() -> None:
    scan = scan_scene(BEFORE_A_WALL, LEVEL, replace(MIXING, mixed_pixels=False), _rng())
    assert np.all((np.abs(scan.points[:, 0] - 4.0) < 1e-9) | (np.abs(scan.points[:, 0] - 4.5) < 1e-9))


def test_separated_echoes_do_not_mix() -> None:
    scan = scan_scene(BEFORE_A_WALL, LEVEL, replace(MIXING, echo_separation_m=0.1), _rng())
    off_surface = np.minimum(np.abs(scan.points[:, 0] - 4.0), np.abs(scan.points[:, 0] - 4.5))
    assert off_surface.max() < SLANT_M


def test_intensity_is_reflectance_times_cosine_of_incidence() -> None:
    scan = scan_scene(_upright(3.0, -2.0, 2.0), LEVEL, EXACT, _rng())
    cosine = scan.points[:, 0] / np.linalg.norm(scan.points, axis=1)
    assert scan.intensity is not None
    # Single precision of the stored intensity.
    np.testing.assert_allclose(scan.intensity, PAINT.reflectance * cosine, rtol=1e-6)


def test_a_scanner_that_sees_nothing_gives_an_empty_scan() -> None:
    scan = scan_scene(single_plane_scene(), LEVEL_ABOVE, replace(EXACT, lowest_rad=0.1), _rng())
    assert len(scan) == 0
    assert scan.grid is not None
    assert np.all(scan.grid.index == -1)


def test_the_scan_does_not_tell_its_true_pose() -> None:
    scan = scan_scene(single_plane_scene(), LEVEL_ABOVE, EXACT, _rng())
    assert scan.world_from_scan is None
    assert scan.sensor_m is not None
    np.testing.assert_array_equal(scan.sensor_m, np.zeros(3))


def test_stations_are_scanned_in_turn() -> None:
    scene = single_plane_scene()
    scans = list(simulate_stations(scene, scene.stations, EXACT, _rng()))
    assert [scan.name for scan in scans] == ["single_plane-1", "single_plane-2"]


@pytest.mark.parametrize(
    "wrong",
    [
        {"rows": 0},
        {"lowest_rad": 1.0, "highest_rad": 0.5},
        {"highest_rad": 2.0},
        {"min_range_m": 5.0, "max_range_m": 5.0},
        {"range_noise_std_m": -0.001},
        {"range_noise_std_m": float("nan")},
        {"dropout_probability": 1.5},
        {"reach_reflectance": 0.0},
    ],
    ids=str,
)
def test_impossible_data_sheets_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(InvalidInputError):
        VirtualScanner(**wrong)  # type: ignore[arg-type]
