"""Scanners and surfaces that are not ideal are wrong in the way they say, and in no other."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import RigidTransform

from algorithms.errors import InvalidInputError
from algorithms.scans.instrument_errors import (
    TimeSource,
    drift_displacements,
    instrument_displacements,
    sweep_of,
    without_errors,
)
from algorithms.simulation.degenerate_scenes import single_plane_scene
from algorithms.simulation.materials import PAINT
from algorithms.simulation.office import office_scene
from algorithms.simulation.parts import polygons
from algorithms.simulation.scanner import VirtualScanner, directions_of
from algorithms.simulation.scanning import scan_scene
from algorithms.simulation.scene import Scene, scene_from_parts
from algorithms.simulation.scenes import SCENES
from algorithms.simulation.stations import station_pose
from algorithms.simulation.systematic_errors import SystematicErrors
from algorithms.simulation.unevenness import Unevenness

EXACT = VirtualScanner(
    rows=60, columns=144, range_noise_std_m=0.0, angle_noise_std_rad=0.0, mixed_pixels=False, intensity_noise=0.0
)
HEIGHT_M = 1.7
GROUND = single_plane_scene()
ABOVE = station_pose((0.0, 0.0, HEIGHT_M), 0.4)
RNG = np.random.default_rng


def points_and_ranges(scanner: VirtualScanner, scene: Scene = GROUND) -> tuple[np.ndarray, np.ndarray]:
    points = scan_scene(scene, ABOVE, scanner, RNG(5)).points
    return points, np.linalg.norm(points, axis=1)


def out_of_adjustment(**errors: float) -> VirtualScanner:
    return replace(EXACT, systematic=SystematicErrors(**errors))


def test_an_instrument_without_errors_on_even_surfaces_gives_the_scan_of_one_that_knows_of_none() -> None:
    scene, scanner = office_scene(), VirtualScanner(rows=80, columns=200)
    pose, even = scene.stations[1], replace(scene, unevenness=Unevenness(rms_m=0.0))
    plain = scan_scene(scene, pose, scanner, RNG(3))
    zero = scan_scene(even, pose, replace(scanner, systematic=SystematicErrors()), RNG(3))
    np.testing.assert_array_equal(plain.points, zero.points)
    np.testing.assert_array_equal(plain.intensity, zero.intensity)


def test_a_range_offset_lengthens_every_range_by_itself() -> None:
    (_, true), (_, measured) = points_and_ranges(EXACT), points_and_ranges(out_of_adjustment(range_offset_m=0.004))
    np.testing.assert_allclose(measured - true, 0.004, atol=1e-12)


def test_a_scale_of_ranges_makes_the_cloud_larger_about_the_instrument() -> None:
    (true, _), (measured, _) = points_and_ranges(EXACT), points_and_ranges(out_of_adjustment(range_scale_error=2e-5))
    np.testing.assert_allclose(measured, true * (1.0 + 2e-5), atol=1e-12)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_offset_by_incidence_is_as_stated_at_seventy_degrees_and_grows_with_the_tangent(sign: float) -> None:
    _, true = points_and_ranges(EXACT)
    _, measured = points_and_ranges(out_of_adjustment(incidence_offset_m=sign * 0.001))
    incidence = np.arccos(HEIGHT_M / true)
    assert np.rad2deg(incidence).min() < 35.0
    assert np.rad2deg(incidence).max() > 83.0
    expected = sign * 0.001 * np.tan(incidence) / np.tan(np.deg2rad(70.0))
    np.testing.assert_allclose(measured - true, expected, atol=1e-12)


def test_a_vertical_index_error_raises_every_recorded_direction() -> None:
    error = 1e-3
    points, measured = points_and_ranges(out_of_adjustment(vertical_index_error_rad=error))
    recorded = np.arcsin(points[:, 2] / measured)
    # Ranges are those of the directions in which the beams really left, below the recorded ones.
    np.testing.assert_allclose(measured, -HEIGHT_M / np.sin(recorded - error), rtol=1e-9)


def test_the_errors_of_axes_and_of_the_tripod_are_those_that_calibration_takes_off() -> None:
    scanner = out_of_adjustment(
        vertical_index_error_rad=2e-4, collimation_error_rad=3e-4, trunnion_error_rad=-2e-4, range_offset_m=0.004
    )
    points, _ = points_and_ranges(scanner)
    errors = np.array([2e-4, 0.004, 0.0, 3e-4, -2e-4])
    # on the plane again, in the frame of the tripod
    np.testing.assert_allclose(without_errors(points, np.zeros(3), errors)[:, 2], -HEIGHT_M, atol=1e-9)
    displaced = points - instrument_displacements(points) @ errors
    np.testing.assert_allclose(displaced[:, 2], -HEIGHT_M, atol=1e-5)  # to first order


def test_a_tripod_that_turns_tilts_the_first_columns_against_the_last() -> None:
    drift, bend = (2e-4, -1e-4, 3e-4), (-1e-4, 2e-4, 1e-4)
    points, _ = points_and_ranges(out_of_adjustment(drift_rad=drift, drift_bend_rad=bend))
    scan = scan_scene(GROUND, ABOVE, out_of_adjustment(drift_rad=drift, drift_bend_rad=bend), RNG(5))
    sweep = sweep_of(scan)
    assert sweep is not None
    assert sweep.turn_rad == pytest.approx(2.0 * np.pi, abs=1e-6)
    displaced = points - drift_displacements(points, sweep.times(points)) @ np.array([*drift, *bend])
    np.testing.assert_allclose(displaced[:, 2], -HEIGHT_M, atol=1e-5)
    assert np.abs(points[:, 2] + HEIGHT_M).max() > 5e-4


def test_points_without_columns_tell_the_time_by_their_order_and_not_in_any_other() -> None:
    room = SCENES["office"]()
    scan = scan_scene(room, room.stations[0], replace(EXACT, rows=200, columns=500), RNG(5))
    by_columns, by_order = sweep_of(scan), sweep_of(replace(scan, grid=None))
    assert by_columns is not None
    assert by_order is not None
    assert by_order.turn_rad == pytest.approx(by_columns.turn_rad, abs=0.1)
    times = by_columns.times(scan.points)
    inside = (times > 0.05) & (times < 0.95)
    assert np.abs(by_order.times(scan.points) - times)[inside].max() < 0.02
    mixed = RNG(1).permutation(len(scan.points))
    assert sweep_of(replace(scan, points=scan.points[mixed], intensity=None, grid=None)) is None
    narrow = np.abs(np.arctan2(scan.points[:, 1], scan.points[:, 0])) < 0.1
    assert sweep_of(replace(scan, points=scan.points[narrow], intensity=None, grid=None)) is None


def test_time_stamps_tell_the_time_in_any_order_of_the_points_and_however_unsteadily_the_scanner_turned() -> None:
    room = SCENES["office"]()
    scan = scan_scene(room, room.stations[0], replace(EXACT, rows=60, columns=500), RNG(5))
    steady = sweep_of(scan)
    assert steady is not None
    shares = steady.times(scan.points)
    true = np.where(shares < 0.4, 100.0 * shares, 40.0 + 300.0 * (shares - 0.4))  # faster from there on
    mixed = RNG(1).permutation(len(scan.points))
    stamped = replace(
        scan, points=scan.points[mixed], intensity=None, grid=None, times_s=true[mixed].astype(np.float32)
    )
    sweep = sweep_of(stamped)
    assert sweep is not None
    assert (sweep.told_by, steady.told_by) == (TimeSource.TIME_STAMPS, TimeSource.COLUMNS)
    assert sweep.duration_s == pytest.approx(220.0, rel=0.01)
    inside = (shares > 0.02) & (shares < 0.98)
    assert np.abs(sweep.times(scan.points) - true / 220.0)[inside].max() < 0.01
    unknown = stamped.times_s.copy()
    unknown[::3] = np.nan
    assert sweep_of(replace(stamped, times_s=unknown)) is not None


def test_a_scanner_that_goes_round_twice_has_no_one_time_for_a_direction() -> None:
    room = SCENES["office"]()
    scan = scan_scene(room, room.stations[0], replace(EXACT, rows=60, columns=500), RNG(5))
    steady = sweep_of(scan)
    assert steady is not None
    times = steady.times(scan.points)
    twice = np.concatenate([times, times + 1.0]).astype(np.float32)
    both = replace(scan, points=np.tile(scan.points, (2, 1)), intensity=None, grid=None, times_s=twice)
    assert sweep_of(both) is None


@pytest.mark.parametrize("wrong", [{"range_offset_m": float("nan")}, {"range_scale_error": -1.0}], ids=str)
def test_impossible_errors_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(InvalidInputError):
        SystematicErrors(**wrong)


FIELD = Unevenness(rms_m=0.002, correlation_length_m=1.0, seed=11)
UP = np.array([0.0, 0.0, 1.0])


def heights(points: np.ndarray, normal: np.ndarray = UP, field: Unevenness = FIELD) -> np.ndarray:
    return field.heights_m(points, np.broadcast_to(normal, points.shape))


def scattered(count: int, extent_m: float = 300.0) -> np.ndarray:
    """Points of one level plane so large that what chance makes of a field averages out."""
    return np.column_stack([RNG(1).uniform(-extent_m, extent_m, (count, 2)), np.full(count, 0.7)])


@pytest.mark.parametrize("normal", [UP, np.array([1.0, 0.0, 0.0]), np.array([0.0, -1.0, 0.0])], ids=str)
def test_heights_have_the_stated_root_mean_square(normal: np.ndarray) -> None:
    # The mean square over 40 000 points is known to 1 %.
    assert np.sqrt(np.mean(heights(scattered(40_000), normal) ** 2)) == pytest.approx(0.002, rel=0.02)


def test_heights_are_nearly_normally_distributed() -> None:
    excess = [float(stats.kurtosis(heights(scattered(20_000), field=replace(FIELD, seed=seed)))) for seed in range(5)]
    assert np.abs(excess).max() < 0.5


@pytest.mark.parametrize("length_m", [0.5, 1.0, 3.0])
def test_the_correlation_of_heights_falls_to_a_part_in_e_over_the_correlation_length(length_m: float) -> None:
    here = scattered(1000)
    shares = []
    for seed in range(60):
        field = Unevenness(correlation_length_m=length_m, seed=seed)
        there = here + length_m * np.array([np.cos(seed), np.sin(seed), 0.0])
        shares.append(np.corrcoef(heights(here, field=field), heights(there, field=field))[0, 1])
    # That of one field, of 64 waves, scatters by 0.08; the mean of 60 by 0.01.
    assert np.mean(shares) == pytest.approx(np.exp(-1.0), abs=0.04)


def test_surfaces_of_different_directions_are_uneven_independently() -> None:
    points = scattered(1000)
    shares = [
        np.corrcoef(heights(points, field=field), heights(points, np.array([1.0, 0.0, 0.0]), field))[0, 1]
        for field in (replace(FIELD, seed=seed) for seed in range(20))
    ]
    # One field's share scatters by 0.12 (64 waves), the mean of 20 by 0.03.
    assert abs(np.mean(shares)) < 0.1


def test_a_surface_is_where_it_is_whichever_side_its_normal_points_to() -> None:
    points = scattered(100)
    np.testing.assert_allclose(heights(points, -UP), -heights(points), atol=1e-15)


def test_other_seeds_give_other_surfaces() -> None:
    points = scattered(1000)
    assert abs(np.corrcoef(heights(points), heights(points, field=replace(FIELD, seed=12)))[0, 1]) < 0.5


@pytest.mark.parametrize("wrong", [{"rms_m": -0.001}, {"rms_m": 2.0}, {"correlation_length_m": 0.0}], ids=str)
def test_impossible_unevenness_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(InvalidInputError):
        Unevenness(**wrong)


UNEVEN_GROUND = replace(GROUND, unevenness=FIELD)


@pytest.mark.parametrize(
    "pose",
    [
        ABOVE,
        station_pose((3.1, -2.2, 1.4), 2.0, 0.3, -0.2),
        station_pose((-1.0, 4.0, -1.2), 1.0, np.pi, 0.1),
    ],
    ids=["from above", "from elsewhere, tilted", "from below"],
)
def test_every_station_sees_the_same_unevenness(pose: RigidTransform) -> None:
    scan = scan_scene(UNEVEN_GROUND, pose, EXACT, RNG())
    points = pose.apply(scan.points)
    assert len(points) > 1000
    on_plane = points * np.array([1.0, 1.0, 0.0])
    # A micrometre: what three rounds leave at four degrees to the surface.
    np.testing.assert_allclose(points[:, 2], heights(on_plane), atol=2e-6)
    assert np.std(points[:, 2]) > 0.001


def test_unevenness_moves_points_along_their_beams() -> None:
    even, uneven = (scan_scene(scene, ABOVE, EXACT, RNG()).points for scene in (GROUND, UNEVEN_GROUND))
    across = np.cross(even, uneven) / np.linalg.norm(even, axis=1, keepdims=True)
    # Rounding of a product of lengths up to 25 m.
    assert np.abs(across).max() < 1e-12


NEAR_M, FAR_M, EDGE = 4.0, 4.5, 0.25
"""A panel before a wall, and the tangent of the azimuth of the panel's edges."""
SLANT_M = 0.005
"""Part of a footprint (radius 4 mm) on a face at up to 45 degrees: its mean range differs from the centre's by less."""
ROLLED = station_pose((0.0, 0.0, 0.0), 0.0004, 0.02)
"""So that the edges cross the columns, and beams meet them with every part of their footprint."""
MIXING = replace(
    EXACT, rows=120, columns=3600, lowest_rad=-0.3, highest_rad=0.3, mixed_pixels=True, beam_divergence_rad=2e-3
)
RADIUS_RAD = 1e-3 + 0.0015 / NEAR_M
"""Of the footprint at the panel, seen from the scanner: half the divergence and half the exit diameter."""


def panel_before_wall() -> Scene:
    rings = [
        np.array([(x, -y, -2.0), (x, y, -2.0), (x, y, 2.0), (x, -y, 2.0)]) for x, y in ((NEAR_M, 1.0), (FAR_M, 3.0))
    ]
    return scene_from_parts("panel", [polygons([ring], PAINT) for ring in rings], [ROLLED])


def panel_points(scanner: VirtualScanner) -> np.ndarray:
    return np.asarray(ROLLED.apply(scan_scene(panel_before_wall(), ROLLED, scanner, RNG(2)).points))


def at_edges(scanner: VirtualScanner) -> np.ndarray:
    """Give the points of beams whose footprint reaches over an edge of the panel."""
    points = panel_points(scanner)
    return np.asarray(points[np.abs(np.abs(points[:, 1] / points[:, 0]) - EDGE) < RADIUS_RAD])


def on_a_surface(points: np.ndarray) -> np.ndarray:
    return np.minimum(np.abs(points[:, 0] - NEAR_M), np.abs(points[:, 0] - FAR_M)) < SLANT_M


def test_beams_that_return_one_surface_lie_on_either_one_and_nowhere_else() -> None:
    points = at_edges(replace(MIXING, unmixed_share=1.0))
    assert on_a_surface(points).all()
    nearer, beside = points[:, 0] < 0.5 * (NEAR_M + FAR_M), np.abs(points[:, 1] / points[:, 0]) > EDGE
    # Some of the panel's range in a direction beside the panel, some of the wall's in a direction onto it.
    assert np.count_nonzero(nearer & beside) > 20
    assert np.count_nonzero(~nearer & ~beside) > 20


def test_the_stated_share_of_beams_at_edges_is_not_mixed() -> None:
    always = np.count_nonzero(on_a_surface(at_edges(replace(MIXING, unmixed_share=0.0))))
    points = at_edges(replace(MIXING, unmixed_share=0.4))
    chances = len(points) - always
    unmixed = np.count_nonzero(on_a_surface(points)) - always
    # Five standard deviations of the binomial distribution.
    assert abs(unmixed - 0.4 * chances) < 5.0 * np.sqrt(0.24 * chances)


def test_the_surface_with_more_of_the_beam_returns_more_often() -> None:
    points = at_edges(replace(MIXING, unmixed_share=1.0))
    inside = EDGE - np.abs(points[:, 1] / points[:, 0])
    nearer = points[:, 0] < 0.5 * (NEAR_M + FAR_M)
    mostly_panel, mostly_wall = inside > 0.3 * RADIUS_RAD, inside < -0.3 * RADIUS_RAD
    assert np.mean(nearer[mostly_panel]) > 0.75
    assert np.mean(nearer[mostly_wall]) < 0.4


def test_beams_away_from_edges_are_not_touched_by_what_happens_there() -> None:
    scans = [panel_points(replace(MIXING, unmixed_share=share)) for share in (0.0, 1.0)]
    away = [p[np.abs(np.abs(p[:, 1] / p[:, 0]) - EDGE) > 2.0 * RADIUS_RAD] for p in scans]
    np.testing.assert_array_equal(*away)


def test_a_share_that_is_none_is_refused() -> None:
    with pytest.raises(InvalidInputError):
        replace(MIXING, unmixed_share=1.2)


def test_directions_of_recorded_points_stay_nominal_on_uneven_ground() -> None:
    scanner = replace(EXACT, rows=10, columns=20, lowest_rad=-1.0, highest_rad=-0.5)
    points = scan_scene(UNEVEN_GROUND, ABOVE, scanner, RNG()).points
    rows, columns = np.tile(np.arange(10), 20), np.repeat(np.arange(20), 10)
    nominal = directions_of(scanner.azimuths(columns), scanner.elevations(rows))
    np.testing.assert_allclose(points / np.linalg.norm(points, axis=1, keepdims=True), nominal, atol=1e-14)
