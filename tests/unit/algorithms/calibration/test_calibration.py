"""Calibrations of rigs whose camera is known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from algorithms.arrays import Array
from algorithms.calibration.comparison import Halves, compare_halves, compare_with_earlier
from algorithms.calibration.lenses import LENSES
from algorithms.calibration.one_camera import with_turned
from algorithms.calibration.projection import differences, format_grid, projection_map
from algorithms.calibration.solution import Calibration, CalibrationOptions, calibrate
from algorithms.calibration.structure import require_structure
from algorithms.calibration.target_field import HeadMount, TargetField
from algorithms.errors import DegenerateGeometryError, InvalidInputError

WIDTH, HEIGHT = 1280, 960
NOISE_PX = 0.1
LENS = LENSES["opencv"]
TRUTH = LENS.started(1000.0, WIDTH, HEIGHT)
TRUTH[[1, 2, 3, 5]] += (8.0, -6.0, -0.15, 0.001)
UNKNOWN = np.isin(LENS.names, ("f", "cx", "cy", "k1", "p1"))
PLAIN = CalibrationOptions(scaled_stds=False, gross_errors=False)


def _field(targets: Array, photos: Array, points: Array, images: Array, **others: object) -> TargetField:
    start = LENS.started(np.nan, WIDTH, HEIGHT)
    count = int(photos.max()) + 1
    field = TargetField(
        LENS, WIDTH, HEIGHT, start, UNKNOWN, np.full(len(start), np.inf), [f"T{k}" for k in range(len(targets))],
        targets, np.zeros((len(targets), 3, 3)), [f"P{k}" for k in range(count)], photos, points, images,
        np.full(images.shape, NOISE_PX),
    )  # fmt: skip
    return replace(field, **others)


def board_rig(
    tilt_rad: float,
    photos: int = 6,
    noise_px: float = NOISE_PX,
    *,
    seed: int = 4,
    noise_seed: int | None = None,
    cameras: dict[int, Array] | None = None,
    tilts: dict[int, float] | None = None,
) -> TargetField:
    """Photos of a flat board, each turned about its normal and tilted by up to an angle about either axis."""
    rng = np.random.default_rng(seed)
    board = np.array([[0.05 * j, 0.05 * i, 0.0] for i in range(5) for j in range(7)]) - [0.15, 0.1, 0.0]
    images = []
    for k in range(photos):
        turn = Rotation.from_euler(
            "ZXY", [1.5 * k, *((tilts or {}).get(k, tilt_rad) * rng.uniform(-1.0, 1.0, 2))]
        ).as_matrix()
        place = np.array([*rng.uniform(-0.05, 0.05, 2), rng.uniform(0.35, 0.5)])
        images.append(LENS.image(board @ turn.T + place, (cameras or {}).get(k, TRUTH)))
    noise = rng if noise_seed is None else np.random.default_rng(noise_seed)
    images = np.concatenate(images) + noise_px * noise.normal(size=(photos * len(board), 2))
    return _field(board, np.repeat(np.arange(photos), len(board)), np.tile(np.arange(len(board)), photos), images)


AXES = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # the camera looks along x of the head
MOUNT_TURN = AXES @ Rotation.from_rotvec([0.01, -0.02, 0.03]).as_matrix()
MOUNT_PLACE = np.array([0.05, 0.02, 0.25])
POLAR_STD_M = 0.002


def mounted_rig(
    rng: np.random.Generator, columns: int, rows: int, heads: Array, *, noisy: bool = True, head_std: float = 2e-5
) -> TargetField:
    """A field of near and far targets before a scanner, photographed at head angles; the middle of it is at x."""
    azimuths = np.linspace(-0.45, 0.45, columns) if columns > 1 else np.zeros(1)
    heights = np.linspace(-0.38, 0.38, rows)
    grid = np.array([
        distance * np.array([np.cos(a), np.sin(a), h])
        for shift, distance in ((0.0, 3.0), (0.03, 9.0)) for a in azimuths + shift for h in heights
    ])  # fmt: skip
    photos, points, images = [], [], []
    for k, angle in enumerate(heads + head_std * rng.normal(size=len(heads)) * noisy):
        in_head = grid @ Rotation.from_euler("Z", angle).as_matrix()
        seen = (in_head - MOUNT_PLACE) @ MOUNT_TURN
        inside = np.flatnonzero(seen[:, 2] > 0.3)
        shown = LENS.image(seen[inside], TRUTH)
        kept = ((shown > 0.0) & (shown < [WIDTH - 1, HEIGHT - 1])).all(axis=1)
        photos.append(np.full(kept.sum(), k))
        points.append(inside[kept])
        images.append(shown[kept])
    image = np.concatenate(images)
    std = POLAR_STD_M * np.ones(len(grid))
    targets = grid + noisy * std[:, None] * rng.normal(size=grid.shape)
    image += noisy * NOISE_PX * rng.normal(size=image.shape)
    return _field(
        targets, np.concatenate(photos), np.concatenate(points), image,
        target_covariances=np.square(std)[:, None, None] * np.eye(3), mount=HeadMount(heads, head_std),
    )  # fmt: skip


@pytest.fixture(scope="module")
def tilted() -> Calibration:
    return calibrate(board_rig(0.6, photos=8), PLAIN)


def test_without_noise_the_camera_is_found_exactly_and_without_start_values() -> None:
    found = calibrate(board_rig(0.6, noise_px=0.0), PLAIN)
    np.testing.assert_allclose(found.parameters, TRUTH, rtol=1e-8, atol=1e-8)


def test_a_camera_is_found_within_its_standard_deviations(tilted: Calibration) -> None:
    free = np.flatnonzero(UNKNOWN)
    errors = tilted.parameters[free] - TRUTH[free]
    statistic = errors @ np.linalg.solve(tilted.covariance, errors)
    assert statistic < 20.5  # chi-square of 5, one of a thousand
    assert tilted.names == ["f", "cx", "cy", "k1", "p1"]


@pytest.mark.slow
def test_photos_from_one_direction_are_refused_with_the_principal_distance_named() -> None:
    with pytest.raises(DegenerateGeometryError) as refused:
        calibrate(board_rig(0.0), PLAIN)
    assert any(text.startswith("f") for text in refused.value.free_directions)
    assert "tilted by 20 to 45 degrees" in refused.value.advice


def test_a_target_in_one_photo_only_is_refused_by_name_and_one_without_photos_too() -> None:
    field = board_rig(0.6)
    free = np.full((3, 3), np.nan)
    covariances = field.target_covariances.copy()
    covariances[[3, 4]] = free
    kept = (field.points != 4) & ~((field.points == 3) & (field.photos > 0))
    lacking = replace(
        field, target_covariances=covariances, photos=field.photos[kept], points=field.points[kept],
        images=field.images[kept], image_stds=field.image_stds[kept],
    )  # fmt: skip
    with pytest.raises(DegenerateGeometryError, match=r"target T3: one photo .* target T4: no photo") as refused:
        require_structure(lacking)
    whole = 5 + 6 * 6 + 6
    assert (refused.value.rank, "of 47 parameters" in str(refused.value)) == (whole - 4, True)


def test_without_known_targets_the_datum_is_missing() -> None:
    field = board_rig(0.6)
    free = np.full_like(field.target_covariances, np.nan)
    with pytest.raises(DegenerateGeometryError, match="no datum"):
        require_structure(replace(field, target_covariances=free))


def test_mount_and_camera_are_found_from_photos_at_head_angles() -> None:
    field = mounted_rig(np.random.default_rng(1), 5, 5, np.radians([-12.0, 0.0, 15.0]), noisy=False)
    found = calibrate(field, PLAIN)
    np.testing.assert_allclose(found.parameters, TRUTH, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(found.state.mount_rotations[1], MOUNT_TURN, atol=1e-9)
    np.testing.assert_allclose(found.state.mount_positions[1], MOUNT_PLACE, atol=1e-8)
    assert found.names[-6:] == [f"mount {p}" for p in ("rotation x", "rotation y", "rotation z", "X", "Y", "Z")]


def test_a_gross_error_is_left_out() -> None:
    field = board_rig(0.6, photos=4)
    images = field.images.copy()
    images[17, 0] += 3.0
    found = calibrate(replace(field, images=images))
    assert np.flatnonzero(~found.used).tolist() == [17]


@pytest.mark.parametrize("share", [0.0, 0.05, 0.15])
def test_gross_errors_change_neither_the_noise_nor_the_trust_in_the_camera(share: float) -> None:
    scales, statistics = [], []
    for seed in range(4):
        field, rng = board_rig(0.6, photos=8, seed=seed), np.random.default_rng(seed)
        wrong = rng.random(len(field.images)) < share
        images = field.images + wrong[:, None] * rng.uniform(-30.0, 30.0, field.images.shape)
        found = calibrate(replace(field, images=images, image_stds=5.0 * field.image_stds))
        errors = found.parameters[UNKNOWN] - TRUTH[UNKNOWN]
        scales.append(float(np.median(found.field.image_stds)))
        statistics.append(float(errors @ np.linalg.solve(found.covariance, errors)))
    assert abs(np.mean(scales) / NOISE_PX - 1.0) < 0.05
    assert 8.2 < sum(statistics) < 37.6  # chi-square of 20, two of a hundred


def test_a_photo_that_is_given_twice_counts_once() -> None:
    field = board_rig(0.6, photos=6)
    copied = np.random.default_rng(1).normal(scale=0.1 * NOISE_PX, size=field.images.shape)  # compressed once more
    twice = replace(
        field, photo_names=[*field.photo_names, *(f"copy of {name}" for name in field.photo_names)],
        photos=np.concatenate([field.photos, field.photos + 6]), points=np.tile(field.points, 2),
        images=np.concatenate([field.images, field.images + copied]), image_stds=np.tile(field.image_stds, (2, 1)),
    )  # fmt: skip
    once, found = calibrate(field), calibrate(twice)
    assert found.repeated == [(f"copy of {name}", name) for name in field.photo_names]
    np.testing.assert_array_equal(found.covariance, once.covariance)


def test_photos_of_one_place_with_noise_of_their_own_all_count() -> None:
    first, second = board_rig(0.6, photos=6), board_rig(0.6, photos=6, noise_seed=9)
    both = replace(
        first, photo_names=[f"P{k}" for k in range(12)], photos=np.concatenate([first.photos, second.photos + 6]),
        points=np.tile(first.points, 2), images=np.concatenate([first.images, second.images]),
        image_stds=np.tile(first.image_stds, (2, 1)),
    )  # fmt: skip
    assert not calibrate(both).repeated


@pytest.mark.parametrize("others", [[1], [1, 4, 6], [0, 2, 3, 5, 7]])
def test_photos_with_another_zoom_are_named(others: list[int]) -> None:
    zoomed = TRUTH * np.where(np.array(LENS.names) == "f", 1.08, 1.0)
    field = board_rig(0.6, photos=8, cameras=dict.fromkeys(others, zoomed))
    names = ", ".join(f"P{k}" for k in others)
    with pytest.raises(InvalidInputError, match=f"2 principal distances.*10[78][0-9][.0-9]* px: {names}"):
        calibrate(field)


@pytest.mark.parametrize("share", [0.0, 0.08])
@pytest.mark.parametrize("turned", [[], [2], [1, 3, 6], [4, 5, 6, 7]])
def test_photos_that_were_turned_are_turned_back_and_named(turned: list[int], share: float) -> None:
    field, rng = with_turned(board_rig(0.6, photos=8), turned), np.random.default_rng(2)
    wrong = rng.random(len(field.images)) < share
    images = field.images + wrong[:, None] * rng.uniform(-30.0, 30.0, field.images.shape)
    found = calibrate(replace(field, images=images))
    assert found.turned == [f"P{k}" for k in turned]
    errors = found.parameters[UNKNOWN] - TRUTH[UNKNOWN]
    assert errors @ np.linalg.solve(found.covariance, errors) < 20.5


def test_a_photo_that_tells_neither_zoom_nor_turn_is_not_named() -> None:
    frontal = {1: 0.001}
    zoomed = TRUTH * np.where(np.array(LENS.names) == "f", 1.08, 1.0)
    with pytest.raises(InvalidInputError) as refused:
        calibrate(board_rig(0.6, photos=8, tilts=frontal, cameras=dict.fromkeys([2, 5], zoomed)))
    assert "px: P2, P5)" in str(refused.value)
    assert calibrate(with_turned(board_rig(0.6, photos=8, tilts=frontal), [3, 6])).turned == ["P3", "P6"]


def test_the_projection_is_surest_where_targets_were_seen(tilted: Calibration) -> None:
    image = format_grid(WIDTH, HEIGHT)
    found = projection_map(tilted, image, 5.0)
    middle = np.argmin(np.linalg.norm(image - [640, 480], axis=1))
    assert found.stds[middle] == pytest.approx(found.stds.min(), rel=0.3)
    assert found.stds[0] > 1.5 * found.stds[middle]
    assert found.object_stds[middle] == pytest.approx(5.0 * found.stds[middle] / 1000.0, rel=0.05)


def test_cameras_that_differ_by_a_motion_only_do_not_differ() -> None:
    image = format_grid(WIDTH, HEIGHT)
    same = differences((LENS, TRUTH), (LENS, TRUTH), image)
    np.testing.assert_allclose(same, 0.0, atol=1e-9)
    shifted = TRUTH.copy()
    shifted[1] += 5.0
    # a principal point 5 px away is a turn of 5 mrad, up to what that turn bends
    apart = np.linalg.norm(differences((LENS, TRUTH), (LENS, shifted), image), axis=1)
    assert apart.max() < 2.0


def test_halves_of_the_photos_agree_with_what_is_expected_of_them(tilted: Calibration) -> None:
    halves = compare_halves(tilted.field, tilted.state)
    assert isinstance(halves, Halves)
    assert 0.1 < halves.ratio < 2.0
    assert isinstance(compare_halves(board_rig(0.6, photos=4), tilted.state), str)


def test_a_camera_that_changed_is_told_from_one_that_did_not(tilted: Calibration) -> None:
    none = np.zeros(len(TRUTH))
    same = compare_with_earlier(tilted, LENS, TRUTH, none)
    moved = TRUTH.copy()
    moved[0] += 8.0
    other = compare_with_earlier(tilted, LENS, moved, none)
    assert same.p_value > 0.001 > other.p_value
