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


def field_of(columns: Array, heads: Array) -> TargetField:
    """Near and far targets in columns at azimuths, with a photo at each head angle, without errors."""
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
    return TargetField(
        LENS, WIDTH, HEIGHT, LENS.started(np.nan, WIDTH, HEIGHT), UNKNOWN, np.full(len(TRUTH), np.inf),
        [str(k) for k in range(count)], targets, np.tile(POLAR_STD_M**2 * np.eye(3), (count, 1, 1)),
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


def test_one_column_and_eight_head_angles_give_the_camera_as_well_as_128_targets(
    column: TargetField,
) -> None:
    field = field_of(AZIMUTHS, np.zeros(1))
    virtual, whole = _stds(calibrate(column, PLAIN, start_of(column))), _stds(calibrate(field, PLAIN, start_of(field)))
    ratios = {name: virtual[name] / whole[name] for name in whole}
    print(len(column.targets), len(column.photos), len(field.targets), len(field.photos), ratios)
    # claim 24 of the source; what does not hold of it stands in LIMITS
    assert max(ratios.values()) <= 1.1
