"""Planes of rounded coordinates promise no more than they keep: offset and tilts against many roundings."""

import numpy as np
import pytest

from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.features.planes.plane_rounding import patch_rounding
from algorithms.features.scan_features import ScanFeatures
from algorithms.progress import NoProgress
from algorithms.scans.coordinate_steps import CoordinateSteps
from algorithms.scans.rounding import HARMONICS, rounded_pieces
from tests.scenes.lines.feature_scenes import cloud, room

STEP_M = 0.01
SIZE_M = np.array([4.0, 3.0])
COLUMNS, ROWS = 8, 6
RUNS = 150


def fitted(rng: np.random.Generator, crossed: float, noise_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Round points of a plane that crosses some steps; give errors of tilts and offset, and what is said of them."""
    angle = rng.uniform(0.0, 2.0 * np.pi)
    towards = np.array([np.cos(angle), np.sin(angle)])
    slope = crossed * STEP_M / np.linalg.norm(SIZE_M * towards) * towards
    offset = rng.uniform(0.0, STEP_M)
    places = rng.uniform(-0.5, 0.5, (3000, 2)) * SIZE_M
    heights = np.rint((places @ slope + offset + rng.normal(0.0, noise_m, 3000)) / STEP_M) * STEP_M
    design = np.column_stack([-places, np.ones(3000)])
    found = np.linalg.lstsq(design, heights)[0]
    left = heights - design @ found
    normal = np.array([*found[:2], 1.0]) / np.linalg.norm([*found[:2], 1.0])
    first = np.array([1.0, 0.0, -found[0]]) / np.hypot(1.0, found[0])
    frame = np.concatenate([normal, [0.0, 0.0, found[2]], first, np.cross(normal, first), [0.1]])
    column, row = ((places / SIZE_M + 0.5) * (COLUMNS, ROWS)).astype(int).T
    sums = np.stack(
        [
            np.bincount(row * COLUMNS + column, values, minlength=ROWS * COLUMNS)
            for values in (np.ones(3000), places[:, 0], places[:, 1], left, left**2)
        ],
        axis=1,
    )
    steps = CoordinateSteps(np.full(3, STEP_M))
    sizes = (SIZE_M / (COLUMNS, ROWS))[None]
    rounding = patch_rounding(steps, frame[None], sums, np.array([0, len(sums)]), sizes, None)
    jacobian = np.column_stack([-sums[:, 1] / sums[:, 0], -sums[:, 2] / sums[:, 0], np.ones(len(sums))])
    white = np.linalg.inv(design.T @ design) * max(left.var(), STEP_M**2 / 12.0)
    covariance = white + rounding.plane_covariance(0, len(sums), jacobian, np.ones(len(sums)))
    return found - np.array([-slope[0], -slope[1], offset]), np.sqrt(np.diag(covariance))


@pytest.mark.slow
@pytest.mark.parametrize("crossed", [1.0, 2.5, 6.0, 30.0, 1000.0])
@pytest.mark.parametrize("noise_m", [0.0002, 0.002, 0.005])
def test_offset_and_tilts_err_as_they_say_however_many_steps_a_plane_crosses(crossed: float, noise_m: float) -> None:
    rng = np.random.default_rng(7)
    errors, stds = (np.array(each) for each in zip(*(fitted(rng, crossed, noise_m) for _ in range(RUNS)), strict=True))
    real, said = np.sqrt(np.mean(errors**2, axis=0)), np.sqrt(np.mean(stds**2, axis=0))
    assert (real < 1.25 * said).all()


@pytest.mark.slow
@pytest.mark.parametrize("noise_m", [0.0002, 0.002])
def test_planes_that_cross_less_than_a_step_err_as_they_say_on_the_average(noise_m: float) -> None:
    rng = np.random.default_rng(10)
    runs = [fitted(rng, rng.uniform(0.0, 1.0), noise_m) for _ in range(RUNS)]
    errors, stds = (np.array(each) for each in zip(*runs, strict=True))
    real, said = np.sqrt(np.mean(errors**2, axis=0)), np.sqrt(np.mean(stds**2, axis=0))
    assert (real < 1.25 * said).all()


@pytest.mark.parametrize("noise_m", [0.0002, 0.002])
def test_a_plane_on_one_step_is_known_to_the_step_over_root_twelve_less_what_noise_averages(noise_m: float) -> None:
    rng = np.random.default_rng(8)
    stds = np.array([fitted(rng, 0.0, noise_m)[1][2] for _ in range(20)])
    sawtooth = STEP_M * np.sqrt(np.sum(np.exp(-((2 * np.pi * HARMONICS * noise_m / STEP_M) ** 2)) / HARMONICS**2))
    assert np.sqrt(np.mean(stds**2)) > 0.9 * sawtooth / np.sqrt(2.0) / np.pi
    assert stds.max() < 1.05 * STEP_M / np.sqrt(12.0)


def test_a_plane_across_many_steps_averages_them() -> None:
    stds = fitted(np.random.default_rng(9), 1000.0, 0.0002)[1]
    assert stds[2] == pytest.approx(STEP_M / np.sqrt(12.0 * 3000.0), rel=0.1)


def test_pieces_one_step_apart_err_alike_and_half_a_step_apart_oppositely() -> None:
    positions = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, STEP_M], [2.0, 0.0, 0.5 * STEP_M]])
    up = np.tile([0.0, 0.0, 1.0], (3, 1))
    pieces = rounded_pieces(
        CoordinateSteps(np.array([0.0, 0.0, STEP_M])), positions, up, np.zeros((3, 2, 3)), np.zeros(3), None
    )
    covariance = pieces[0].covariance() / STEP_M**2
    assert covariance[0, :2] == pytest.approx([1.0 / 12.0, 1.0 / 12.0])
    assert covariance[0, 2] == pytest.approx(-1.0 / 24.0, rel=0.1)  # B2(1/2)/2, but for the harmonics left out


def rounded(points: np.ndarray, step_m: float = STEP_M) -> ScanFeatures:
    points = np.rint(points / step_m) * step_m
    return extract_features(cloud(points, None), FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0))


@pytest.fixture(scope="module")
def rounded_room() -> ScanFeatures:
    return rounded(room(np.random.default_rng(1)) + np.array([0.0037, -0.0043, 0.0031]))


def test_no_plane_of_a_rounded_room_is_stated_better_than_its_steps_allow(rounded_room: ScanFeatures) -> None:
    stds = np.sqrt(rounded_room.planes.covariances[:, 2, 2])
    assert len(stds) == 6
    assert stds.min() > 0.8 * STEP_M / np.sqrt(12.0)


def test_points_of_a_rounded_room_are_never_without_noise(rounded_room: ScanFeatures) -> None:
    assert rounded_room.planes.noise_std_m.min() >= 0.99 * STEP_M / np.sqrt(12.0)
    assert rounded_room.noise_std_m >= 0.99 * STEP_M / np.sqrt(12.0)


def test_lines_of_rounded_planes_are_as_uncertain(rounded_room: ScanFeatures) -> None:
    assert np.sqrt(rounded_room.lines.covariances[:, 2:, 2:].diagonal(0, 1, 2)).min() > 0.5 * STEP_M / np.sqrt(12.0)


def test_features_name_the_step(rounded_room: ScanFeatures) -> None:
    assert rounded_room.rounding is not None
    assert rounded_room.rounding.steps_m == pytest.approx(np.full(3, STEP_M))


def test_steps_far_below_the_noise_change_nothing() -> None:
    points = room(np.random.default_rng(2)) + np.random.default_rng(3).normal(0.0, 0.002, (1, 3))
    noisy = points + np.random.default_rng(4).normal(0.0, 0.002, points.shape)
    fine, finer = rounded(noisy, 1e-4), rounded(noisy, 1e-7)
    variances, others = (features.planes.covariances.diagonal(0, 1, 2) for features in (fine, finer))
    assert variances == pytest.approx(others, rel=0.05)
