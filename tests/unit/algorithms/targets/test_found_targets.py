"""Targets are found where they are, and nothing else is taken for one."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array
from algorithms.errors import InvalidInputError
from algorithms.scans.scan import Scan
from algorithms.simulation.curved_parts import tube
from algorithms.simulation.materials import CONCRETE, PLASTER, STEEL
from algorithms.simulation.parts import Part, box
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import scan_scene
from algorithms.simulation.scene import scene_from_parts
from algorithms.simulation.target_parts import BOARD_WHITE, checker_board, facing, plate, retro_cylinder, sphere
from algorithms.targets.bright_spot import SpotModel
from algorithms.targets.finding import TargetsOfScan, find_targets
from algorithms.targets.options import BoardKind, RetroKind, SoughtKind, SphereKind, TargetKind
from algorithms.targets.seen_cloud import closed_raster
from algorithms.targets.spot_shape import SpotShape

RADIUS_M, BOARD_M, RETRO_M = 0.0725, 0.15, 0.05
FINE = VirtualScanner(
    rows=180,
    columns=240,
    lowest_rad=-0.036,
    highest_rad=0.036,
    leftmost_rad=-0.048,
    rightmost_rad=0.048,
    range_noise_std_m=0.001,
    mixed_intensities=True,
)
"""4 mm between points at 10 m."""
WALL = box((12.0, -3.0, -3.0), (12.2, 3.0, 3.0), PLASTER)
CHI_SQUARE_3 = 16.27
"""Exceeded by one of a thousand."""


def _scan(parts: Sequence[Part], scanner: VirtualScanner = FINE, seed: int = 5) -> Scan:
    scene = scene_from_parts("targets", [WALL, *parts], [])
    return scan_scene(scene, RigidTransform.identity(), scanner, np.random.default_rng(seed))


def _inclined(centre: Array, incidence_deg: float, turn_rad: float) -> RigidTransform:
    towards = -centre / np.linalg.norm(centre)
    cosine, sine = np.cos(np.deg2rad(incidence_deg)), np.sin(np.deg2rad(incidence_deg))
    turned = [towards[0] * cosine - towards[1] * sine, towards[0] * sine + towards[1] * cosine, towards[2]]
    return facing(centre.tolist(), turned, turn_rad)


def _assert_found(targets: TargetsOfScan, truth: Array, within_m: float) -> None:
    assert len(targets.found) == len(truth), [each.reason for each in targets.rejected]
    for centre in truth:
        errors = [each.centre_m - centre for each in targets.found]
        nearest = int(np.argmin([np.linalg.norm(error) for error in errors]))
        error, target = errors[nearest], targets.found[nearest]
        assert np.linalg.norm(error) < within_m
        assert error @ np.linalg.solve(target.covariance_m2, error) < CHI_SQUARE_3


def test_spheres_are_found_to_a_part_of_a_millimetre() -> None:
    truth = np.array([[10.0, 0.2, 0.1], [8.0, -0.2, -0.1]])
    poles = [tube((x, y, -1.0), (x, y, z), 0.015, STEEL) for x, y, z in truth.tolist()]
    scan = _scan([*(sphere(centre.tolist(), RADIUS_M) for centre in truth), *poles])
    _assert_found(find_targets(scan, [SphereKind(RADIUS_M)]), truth, 0.0005)


def test_a_sphere_is_found_in_shuffled_points_without_raster_and_far_from_the_origin() -> None:
    truth = np.array([[8.0, 0.1, 0.0]])
    scan = _scan([sphere(truth[0].tolist(), RADIUS_M)])
    order = np.random.default_rng(1).permutation(len(scan.points))
    shift = np.array([3.0, -2.0, 1.0])
    assert scan.sensor_m is not None
    loose = replace(
        scan,
        points=scan.points[order] + shift,
        sensor_m=scan.sensor_m + shift,
        grid=None,
        intensity=None,
        origin_m=np.array([5e5, 5e6, 100.0]),
    )
    _assert_found(find_targets(loose, [SphereKind(RADIUS_M)]), truth + shift, 0.0005)


def test_neither_tubes_nor_spheres_of_another_radius_are_taken_for_the_sphere() -> None:
    parts = [sphere((9.0, 0.2, 0.1), 1.2 * RADIUS_M), tube((9.0, -0.2, -1.0), (9.0, -0.2, 1.0), RADIUS_M, STEEL)]
    targets = find_targets(_scan(parts), [SphereKind(RADIUS_M)])
    assert targets.found == ()


@pytest.mark.slow
@pytest.mark.parametrize("incidence_deg", [0.0, 60.0])
def test_a_board_is_found_whatever_its_turn(incidence_deg: float) -> None:
    truth = np.array([[10.0, 0.2, 0.1], [9.8, -0.2, -0.1]])
    parts = [
        part
        for centre, turn in zip(truth, (0.2, 0.9), strict=True)
        for part in checker_board(_inclined(centre, incidence_deg, turn), BOARD_M)
    ]
    targets = find_targets(_scan(parts), [BoardKind(BOARD_M)])
    _assert_found(targets, truth, 0.0005)
    assert all(abs(np.degrees(each.incidence_rad) - incidence_deg) < 2.0 for each in targets.found)


@pytest.mark.slow
def test_boards_of_another_size_and_plates_are_no_boards() -> None:
    parts = [
        *checker_board(facing((10.0, 0.25, 0.1), (-1.0, 0.0, 0.0)), 2.0 * BOARD_M),
        *checker_board(facing((10.0, -0.2, -0.1), (-1.0, 0.0, 0.0)), 0.5 * BOARD_M),
        plate(facing((9.9, -0.2, 0.15), (-1.0, 0.0, 0.0)), 0.3, 0.1, BOARD_WHITE),
    ]
    assert find_targets(_scan(parts), [BoardKind(BOARD_M)]).found == ()


@pytest.mark.parametrize("tail", [0.0, 0.12])
def test_retro_squares_are_found_beside_a_number_plate_that_is_named(tail: float) -> None:
    truth = np.array([[10.0, 0.25, 0.1], [9.9, -0.2, -0.1]])
    parts = [
        *(plate(facing(centre.tolist(), -centre, 0.3), RETRO_M, RETRO_M) for centre in truth),
        plate(facing((9.9, 0.0, 0.22), (-1.0, 0.0, 0.0)), 0.52, 0.11),
    ]
    scanner = replace(FINE, tail_share=tail, tail_offset_rad=0.002)
    targets = find_targets(_scan(parts, scanner), [RetroKind(RETRO_M)])
    _assert_found(targets, truth, 0.001)
    assert "too large" in targets.rejected[0].reason


def test_what_bars_leave_of_a_sign_is_no_target_and_says_why() -> None:
    sign = plate(facing((10.0, 0.0, 0.0), (-1.0, 0.0, 0.0)), 0.4, 0.06)
    bars = [box((9.5, y - 0.03, -0.3), (9.55, y + 0.03, 0.3), CONCRETE) for y in (-0.17, -0.06, 0.05, 0.16)]
    targets = find_targets(_scan([sign, *bars]), [RetroKind(RETRO_M), RetroKind(RETRO_M, TargetKind.RETRO_CYLINDER)])
    assert targets.found == ()
    assert any("edge of what stands before it: part of something" in each.reason for each in targets.rejected)


def test_a_retro_square_is_found_before_the_sky() -> None:
    truth = np.array([[10.0, 0.2, 0.1]])
    parts = [plate(facing(truth[0].tolist(), -truth[0], 0.3), RETRO_M, RETRO_M)]
    scene = scene_from_parts("sky", [box((9.0, -0.5, -0.5), (9.2, -0.1, 0.5), CONCRETE), *parts], [])
    scan = scan_scene(scene, RigidTransform.identity(), FINE, np.random.default_rng(5))
    _assert_found(find_targets(scan, [RetroKind(RETRO_M)]), truth, 0.001)


def test_the_axis_of_a_retro_cylinder_is_found() -> None:
    truth = np.array([[10.0, 0.2, 0.1], [9.0, -0.2, -0.2]])
    scan = _scan([part for centre in truth for part in retro_cylinder(centre, RETRO_M)])
    targets = find_targets(scan, [RetroKind(RETRO_M, TargetKind.RETRO_CYLINDER)])
    assert len(targets.found) == 2
    for centre in truth:
        assert min(float(np.linalg.norm(each.centre_m - centre)) for each in targets.found) < 0.001


def test_a_scene_without_targets_has_none() -> None:
    parts = [
        box((9.0, -0.4, -1.0), (9.4, -0.1, 1.0), CONCRETE),
        tube((10.0, 0.2, -1.0), (10.0, 0.2, 1.0), 0.06, STEEL),
        plate(facing((10.5, 0.05, 0.2), (-1.0, 0.0, 0.0)), 0.3, 0.2, BOARD_WHITE),
    ]
    kinds: list[SoughtKind] = [SphereKind(RADIUS_M), BoardKind(BOARD_M), RetroKind(RETRO_M)]
    assert find_targets(_scan(parts), kinds).found == ()


def test_what_cannot_be_seen_is_refused() -> None:
    scan = _scan([])
    with pytest.raises(InvalidInputError, match="intensities"):
        find_targets(replace(scan, intensity=None), [BoardKind(BOARD_M)])
    with pytest.raises(InvalidInputError, match="raster"):
        find_targets(replace(scan, grid=None), [RetroKind(RETRO_M)])
    with pytest.raises(InvalidInputError, match="there are none"):
        find_targets(scan, [])


@pytest.mark.slow
@pytest.mark.parametrize("first_column", [0, 3000])
def test_targets_on_the_seam_of_a_panorama_are_found(first_column: int) -> None:
    # a square, a sphere and a board at the azimuth where the columns begin and end
    truth = np.array([[-3.0, 0.0, 0.0], [-2.7, 0.02, 0.18], [-2.9, 0.01, -0.2]])
    parts = [
        box((-5.2, -3.0, -3.0), (-5.0, 3.0, 3.0), PLASTER),
        plate(facing(truth[0].tolist(), (1.0, 0.0, 0.0), 0.3), RETRO_M, RETRO_M),
        sphere(truth[1].tolist(), RADIUS_M),
        *checker_board(facing(truth[2].tolist(), (1.0, 0.0, 0.0), 0.2), BOARD_M),
    ]
    scanner = VirtualScanner(rows=140, columns=4000, lowest_rad=-0.11, highest_rad=0.11, mixed_intensities=True)
    scan = _scan(parts, scanner)
    assert scan.grid is not None
    turned = replace(scan, grid=replace(scan.grid, index=np.roll(scan.grid.index, first_column, axis=1)))
    targets = find_targets(turned, [RetroKind(RETRO_M), SphereKind(RADIUS_M), BoardKind(BOARD_M)])
    _assert_found(targets, truth, 0.002)


def test_a_raster_that_does_not_close_or_goes_on_after_a_turn_is_told() -> None:
    def raster(turn_rad: float) -> tuple[Array, Array]:
        azimuths = np.linspace(0.0, turn_rad, 200, endpoint=False)
        points = np.column_stack([np.cos(azimuths), np.sin(azimuths), np.zeros(200)])
        return points, np.arange(200)[None, :]

    open_points, open_index = raster(6.0)
    assert closed_raster(open_points, open_index) is open_index
    points, index = raster(2.0 * np.pi)
    np.testing.assert_array_equal(closed_raster(points, index)[0, 200:], np.arange(12))
    # four columns are measured twice
    points, index = raster(2.0 * np.pi * 200.0 / 196.0)
    np.testing.assert_array_equal(closed_raster(points, index)[0, 200:], np.arange(4, 16))


@pytest.mark.parametrize("made_as", [TargetKind.RETRO_SQUARE, TargetKind.RETRO_CYLINDER])
def test_a_spot_is_one_kind_and_the_other_is_its_alternative(made_as: TargetKind) -> None:
    truth = np.array([[10.0, 0.2, 0.1]])
    square = [plate(facing(truth[0].tolist(), (-1.0, 0.0, 0.0)), RETRO_M, RETRO_M)]
    scan = _scan(square if made_as is TargetKind.RETRO_SQUARE else retro_cylinder(truth[0], RETRO_M))
    other = ({TargetKind.RETRO_SQUARE, TargetKind.RETRO_CYLINDER} - {made_as}).pop()
    assert len(find_targets(scan, [RetroKind(RETRO_M, other)]).found) == 1
    found = find_targets(scan, [RetroKind(RETRO_M, other), RetroKind(RETRO_M, made_as)]).found
    assert [(each.kind, each.alternative) for each in found] == [(made_as, other)]


@pytest.mark.slow
def test_the_centres_of_retro_cylinders_scatter_as_their_covariances_say() -> None:
    rng = np.random.default_rng(11)
    squares = []
    for seed in range(24):
        truth = np.array([10.0, rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2)]) * rng.uniform(0.9, 1.1)
        found = find_targets(
            _scan(retro_cylinder(truth, RETRO_M), seed=seed), [RetroKind(RETRO_M, TargetKind.RETRO_CYLINDER)]
        ).found
        assert len(found) == 1
        error = found[0].centre_m - truth
        squares.append(float(error @ np.linalg.solve(found[0].covariance_m2, error)))
    # 3 +- 0.5 is one standard deviation of the mean of 24
    assert 1.5 < float(np.mean(squares)) < 4.5


@pytest.mark.parametrize("kind", [TargetKind.RETRO_SQUARE, TargetKind.RETRO_CYLINDER])
@pytest.mark.parametrize("tail", [False, True])
@pytest.mark.parametrize("slope", [-0.3, 0.3])
def test_the_derivatives_of_a_spots_picture_are_its_differences(kind: TargetKind, tail: bool, slope: float) -> None:
    places = np.random.default_rng(2).uniform(-0.05, 0.05, (40, 2))
    shape = SpotShape(kind, 0.05, slope, 3.0)
    problem = SpotModel(places, np.zeros(40), np.linspace(0.0, 1.0, 40), shape, 1.0, True)
    own = (0.4,) if kind is TargetKind.RETRO_SQUARE else (0.4, 0.02, 0.05, 0.03)
    x = np.array([0.003, 0.002, 0.5, 7.0, np.log(0.003), *own, *((0.1, 0.02) if tail else ())])
    steps = 1e-6 * np.eye(len(x))
    differences = [(problem.intensities(x + s)[0] - problem.intensities(x - s)[0]) / 2e-6 for s in steps]
    expected = np.stack(differences, axis=1)
    np.testing.assert_allclose(problem.intensities(x)[1], expected, atol=1e-6 * float(np.abs(expected).max()))


@pytest.mark.parametrize("height_m", [-0.55, 0.4])
def test_a_near_cylinder_is_seen_in_perspective_as_its_model_draws_it(height_m: float) -> None:
    centre, blur_m = np.array([4.6, 0.0003, height_m]), 0.25 * (0.003 + 0.3e-3 * 4.6)
    elevation = float(np.arctan2(height_m, 4.6))
    scanner = replace(
        FINE, rows=40, columns=40, lowest_rad=elevation - 0.012, highest_rad=elevation + 0.012, leftmost_rad=-0.012,
        rightmost_rad=0.012, range_noise_std_m=0.0, angle_noise_std_rad=0.0, intensity_noise=0.0,
    )  # fmt: skip
    scene = scene_from_parts("cylinder", retro_cylinder(centre, RETRO_M), [])
    scan = scan_scene(scene, RigidTransform.identity(), scanner, np.random.default_rng(1))
    assert scan.intensity is not None
    range_m = float(np.hypot(centre[0], centre[1]))
    towards = np.array([centre[0], centre[1], 0.0]) / range_m
    met = scan.points * (range_m / (scan.points @ towards))[:, None]
    places = np.column_stack([met @ np.array([-towards[1], towards[0], 0.0]), met[:, 2] - height_m])
    shape = SpotShape(TargetKind.RETRO_CYLINDER, RETRO_M, height_m / range_m, range_m)
    picture, _ = shape.picture(places, float(np.log(blur_m)), shape.begins)
    brightest = float(scan.intensity.max())
    assert np.abs(scan.intensity / brightest - picture / picture.max()).max() < 0.025
