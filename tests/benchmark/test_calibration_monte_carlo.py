"""Standard deviations of a calibration against the scatter of many; a column of targets against a field (U-10)."""

import os

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from algorithms.adjustment.hybrid.estimation import estimate
from algorithms.arrays import Array
from algorithms.calibration.lenses import LENSES
from algorithms.calibration.solution import Calibration, CalibrationOptions, calibrate
from algorithms.calibration.starting import start_of
from algorithms.calibration.target_field import HeadMount, TargetField

pytestmark = pytest.mark.benchmark
DRAWS = int(os.environ.get("TIELINE_DRAWS", "300"))
WIDTH, HEIGHT, NOISE_PX, POLAR_STD_M, HEAD_STD_RAD = 1280, 960, 0.1, 0.001, 1e-5
DIRECTION_STD_RAD = 1e-5
"""Of a fine scan of a retro-reflective target."""
LENS = LENSES["opencv"]
UNKNOWN = np.isin(LENS.names, ("f", "cx", "cy", "k1", "k2", "p1", "p2"))
TRUTH = LENS.started(1000.0, WIDTH, HEIGHT)
TRUTH[[1, 2, 3, 5]] += (8.0, -6.0, -0.15, 0.001)
MOUNT_TURN = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
MOUNT_TURN = MOUNT_TURN @ Rotation.from_rotvec([0.01, -0.02, 0.03]).as_matrix()
MOUNT_PLACE = np.array([0.05, 0.02, 0.25])
PLAIN = CalibrationOptions(scaled_stds=False, gross_errors=False)
AZIMUTHS = np.linspace(-0.5, 0.5, 8)
HEIGHTS = np.linspace(-0.36, 0.42, 8)


def field_of(columns: Array, heads: Array, polar: tuple[float, float] | None = None) -> TargetField:
    """Near and far targets in columns at azimuths, with a photo at each head angle, without errors.

    `polar` has the standard deviations of a fine scan's range [m] and direction [rad]; None: all axes have one of 1 mm.
    """
    targets = np.array([
        distance * np.array([np.cos(a + shift), np.sin(a + shift), h])
        for shift, distance in ((0.0, 3.0), (0.03, 10.0)) for a in columns for h in HEIGHTS
    ])  # fmt: skip
    photos, points, images = [], [], []
    for k, angle in enumerate(heads):
        seen = (targets @ Rotation.from_euler("Z", angle).as_matrix() - MOUNT_PLACE) @ MOUNT_TURN
        image = LENS.image(seen, TRUTH)
        shown = np.flatnonzero(((image > 0.0) & (image < [WIDTH - 1, HEIGHT - 1])).all(axis=1))
        photos.append(np.full(len(shown), k))
        points.append(shown)
        images.append(image[shown])
    measured = np.concatenate(images)
    count = len(targets)
    covariances = np.tile(POLAR_STD_M**2 * np.eye(3), (count, 1, 1))
    if polar is not None:
        along = targets[:, :, None] * targets[:, None, :] / np.square(targets).sum(axis=1)[:, None, None]
        across_m2 = np.square(polar[1]) * np.square(targets).sum(axis=1)
        covariances = polar[0] ** 2 * along + across_m2[:, None, None] * (np.eye(3) - along)
    return TargetField(
        LENS, WIDTH, HEIGHT, LENS.started(np.nan, WIDTH, HEIGHT), UNKNOWN, np.full(len(TRUTH), np.inf),
        [str(k) for k in range(count)], targets, covariances,
        [str(k) for k in range(len(heads))], np.concatenate(photos), np.concatenate(points), measured,
        np.full(measured.shape, NOISE_PX), HeadMount(heads, HEAD_STD_RAD),
    )  # fmt: skip


def _stds(done: Calibration) -> dict[str, float]:
    return dict(zip(done.names, np.sqrt(np.diag(done.covariance)).tolist(), strict=True))


@pytest.fixture(scope="module")
def column() -> TargetField:
    return field_of(np.zeros(1), -AZIMUTHS)


def test_standard_deviations_are_the_scatter(column: TargetField) -> None:
    exact = calibrate(column, PLAIN)
    start, network = exact.state, exact.network
    rng = np.random.default_rng(12)
    image, control, heads = network.observations
    errors = np.empty((DRAWS, len(exact.names)))
    white = np.empty(DRAWS)
    for k in range(DRAWS):
        drawn = (
            NOISE_PX * rng.normal(size=image.values.shape),
            POLAR_STD_M * rng.normal(size=control.values.shape),
            HEAD_STD_RAD * rng.normal(size=heads.values.shape),
        )
        for part, noise in zip((image, control, heads), drawn, strict=True):
            part.values[:] += noise
        found = estimate(network, start, np.ones(len(network.stds)), 20)
        for part, noise in zip((image, control, heads), drawn, strict=True):
            part.values[:] -= noise
        moved = np.append(found.state.cameras[0] - TRUTH, 0.0)[: len(TRUTH)][UNKNOWN]
        turn = Rotation.from_matrix(MOUNT_TURN.T @ found.state.mount_rotations[1]).as_rotvec()
        errors[k] = np.concatenate([moved, turn, found.state.mount_positions[1] - MOUNT_PLACE])
        white[k] = errors[k] @ np.linalg.solve(exact.covariance, errors[k])
    ratios = np.sqrt(np.mean(np.square(errors), axis=0)) / np.sqrt(np.diag(exact.covariance))
    print({name: round(float(ratio), 3) for name, ratio in zip(exact.names, ratios, strict=True)})
    print("normalised squared error per parameter", white.mean() / len(exact.names))
    spread = 3.0 / np.sqrt(2.0 * DRAWS)
    assert (np.abs(ratios - 1.0) < spread).all()
    assert abs(np.sqrt(white.mean() / len(exact.names)) - 1.0) < 0.05


def column_by_field(polar: tuple[float, float]) -> dict[str, float]:
    """Give standard deviations from one column and eight head angles, in those from 128 targets and one photo."""
    one, field = field_of(np.zeros(1), -AZIMUTHS, polar), field_of(AZIMUTHS, np.zeros(1), polar)
    virtual, whole = _stds(calibrate(one, PLAIN, start_of(one))), _stds(calibrate(field, PLAIN, start_of(field)))
    ratios = {name: virtual[name] / whole[name] for name in whole}
    told = {name: round(ratio, 2) for name, ratio in ratios.items()}
    print(f"range {1e3 * polar[0]} mm, direction {1e6 * polar[1]:.0f} urad, {len(one.targets)} fine scans: {told}")
    return ratios


def test_one_column_and_eight_head_angles_give_the_camera_as_well_as_128_targets() -> None:
    # the scanner of the source measures directions precisely above all
    assert max(column_by_field((0.0005, DIRECTION_STD_RAD)).values()) <= 1.1


@pytest.mark.parametrize("range_std_m", [0.001, 0.002, 0.005])
def test_coarse_ranges_to_one_column_cost_the_height_of_the_camera_above_the_head_alone(range_std_m: float) -> None:
    ratios = column_by_field((range_std_m, DIRECTION_STD_RAD))
    assert ratios.pop("mount Z") > 1.1  # the ranges of 16 targets do not average as those of 128 do
    assert max(ratios.values()) <= 1.1
