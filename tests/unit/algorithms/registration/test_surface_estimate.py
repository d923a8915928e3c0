"""The pose by surfaces alone: derivatives, what it leaves open, what it takes no notice of, and its covariance."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.errors import TooFewCorrespondencesError
from algorithms.features.scan_features import ScanFeatures, SurfaceSample
from algorithms.matching.polish import SurfaceGaps
from algorithms.registration.neighbourhood_covariance import neighbourhood_covariance
from algorithms.registration.surface_estimate import SurfaceEstimate, estimate_by_surfaces
from algorithms.registration.surface_options import SurfaceOptions
from tests.unit.service.use_cases.steps.test_feature_store import some_features

VOXEL_M = 0.15
ROOM_M = np.array([6.0, 4.5, 3.0])
NOISE_M = 0.002
POSE = RigidTransform.from_components([2.0, -1.0, 0.5], Rotation.from_rotvec([0.3, -0.8, 1.2]))
FAR = 10.0
OPTIONS = SurfaceOptions()


def room(walls: str, raster: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give points and normals of the inside of a box: x is the wall at its low end, X that at its high end.

    The points lie on a raster that starts anywhere, as those of two scans do.
    """
    points, normals = [], []
    for wall in walls:
        axis = "xyz".index(wall.lower())
        others = [k for k in range(3) if k != axis]
        u, v = (
            grid.ravel() for grid in np.meshgrid(*(np.arange(raster[k] * VOXEL_M, ROOM_M[k], VOXEL_M) for k in others))
        )
        sheet = np.zeros((len(u), 3))
        sheet[:, others] = np.column_stack([u, v])
        sheet[:, axis] = ROOM_M[axis] if wall.isupper() else 0.0
        normal = np.zeros(3)
        normal[axis] = -1.0 if wall.isupper() else 1.0
        points.append(sheet)
        normals.append(np.tile(normal, (len(u), 1)))
    return np.concatenate(points), np.concatenate(normals)


def scan(walls: str, rng: np.random.Generator, pose: RigidTransform, noise_m: float = NOISE_M) -> ScanFeatures:
    """See the room with noise along the normals, in the frame of an instrument."""
    points, normals = room(walls, rng.uniform(0.0, 1.0, 3))
    seen = points + normals * rng.normal(size=(len(points), 1)) * noise_m
    back = pose.inv()
    return features(back.apply(seen), back.rotation.apply(normals))


def features(points: np.ndarray, normals: np.ndarray) -> ScanFeatures:
    surface = SurfaceSample(points, normals, np.full(len(points), -1, dtype=np.int32), VOXEL_M)
    return replace(some_features(), surface=surface, sensor_m=None, seen=None, noise_std_m=NOISE_M)


def near(pose: RigidTransform, shift_m: float = 0.03) -> RigidTransform:
    """Start away from the answer, by a shift and a turn."""
    turn = Rotation.from_rotvec([0.004, -0.003, 0.005])
    return RigidTransform.from_components(np.asarray(pose.translation) + shift_m, turn * pose.rotation)


def error_of(estimate: SurfaceEstimate) -> np.ndarray:
    pose = estimate.pose.target_from_source
    turn = (pose.rotation * POSE.rotation.inv()).as_rotvec()
    return np.concatenate([turn, np.asarray(pose.translation) - np.asarray(POSE.translation)])


IDENTITY = RigidTransform.identity()


def estimated(walls: str = "xyzXYZ", seed: int = 1) -> SurfaceEstimate:
    rng = np.random.default_rng(seed)
    return estimate_by_surfaces(scan(walls, rng, IDENTITY), scan(walls, rng, POSE), near(POSE), OPTIONS)


def test_derivatives_of_gaps_are_those_of_finite_differences() -> None:
    rng = np.random.default_rng(2)
    points, normals = rng.normal(size=(20, 3)), rng.normal(size=(20, 3))
    gaps = SurfaceGaps(points, normals, np.zeros(20), np.ones(20))
    centre, step = np.array([0.3, -0.2, 0.5]), 1e-6
    for k, column in enumerate(gaps.design(centre).T):
        motion = np.zeros(6)
        motion[k] = step
        moved = Rotation.from_rotvec(motion[:3]).apply(points - centre) + centre + motion[3:]
        difference = np.einsum("ij,ij->i", moved - points, normals) / step
        np.testing.assert_allclose(column, difference, atol=1e-5)


def test_a_room_is_laid_on_itself_to_a_fraction_of_its_noise() -> None:
    estimate = estimated()
    assert estimate.converged
    assert np.linalg.norm(error_of(estimate)[3:]) < 0.5 * NOISE_M


@pytest.mark.slow
def test_errors_of_many_rooms_are_as_large_as_their_covariances_say() -> None:
    count = 40
    estimates = [estimated(seed=seed) for seed in range(count)]
    nees = [float(error_of(each) @ np.linalg.solve(each.pose.covariance, error_of(each))) for each in estimates]
    # the common part (3 % of the spread) is promised on top of white noise, so the mean may only be lower
    assert np.mean(nees) < stats.chi2.ppf(0.995, 6 * count) / count
    assert np.mean(nees) > 2.0


def test_swapping_the_scans_inverts_the_pose() -> None:
    rng = np.random.default_rng(3)
    target, source = scan("xyzXYZ", rng, IDENTITY), scan("xyzXYZ", rng, POSE)
    there = estimate_by_surfaces(target, source, near(POSE), OPTIONS).pose.target_from_source
    back = estimate_by_surfaces(source, target, near(POSE).inv(), OPTIONS).pose.target_from_source
    np.testing.assert_allclose((there * back).as_matrix(), np.eye(4), atol=2e-4)


def test_a_corridor_leaves_the_shift_along_itself_open() -> None:
    null = estimated("yzYZ").pose.null_space
    assert null.shape == (6, 1)
    shift = null[3:, 0]
    np.testing.assert_allclose(np.abs(shift) / np.linalg.norm(shift), [1.0, 0.0, 0.0], atol=0.02)


def corridor_with_a_sill(seed: int, length_m: float) -> SurfaceEstimate:
    """Lay on each other two scans of a corridor with a strip across it, one row of points of some length."""
    rng = np.random.default_rng(seed)
    scans = []
    for pose in (IDENTITY, POSE):
        points, normals = room("xyzYZ", np.array([*rng.uniform(0.0, 1.0, 2), 0.5]))
        across = np.abs(normals[:, 0]) > 0.5
        kept = ~across | ((points[:, 2] < VOXEL_M) & (points[:, 1] < length_m))
        seen = points[kept] + normals[kept] * rng.normal(size=(np.count_nonzero(kept), 1)) * NOISE_M
        back = pose.inv()
        scans.append(features(back.apply(seen), back.rotation.apply(normals[kept])))
    return estimate_by_surfaces(scans[0], scans[1], near(POSE, 0.01), OPTIONS)


def test_less_than_a_hundredth_of_the_surface_determines_a_shift_as_well_as_is_promised() -> None:
    shifts = []
    for seed in range(20):
        estimate = corridor_with_a_sill(seed, 2.2)
        assert estimate.pose.null_space.shape == (6, 0)
        shifts.append(error_of(estimate)[3] / np.sqrt(estimate.pose.covariance[3, 3]))
    assert 0.4 < np.sqrt(np.mean(np.square(shifts))) < 1.2


def test_a_thousandth_of_the_surface_determines_nothing() -> None:
    assert corridor_with_a_sill(1, 0.3).pose.null_space.shape == (6, 1)


def test_what_is_open_stays_at_the_start() -> None:
    estimate = estimated("yzYZ")
    centre = estimate.centre_m
    source = near(POSE).inv().apply(centre)
    assert estimate.pose.target_from_source.apply(source)[0] == pytest.approx(centre[0], abs=0.01)


def test_a_piece_that_was_moved_by_a_decimetre_bends_nothing() -> None:
    rng = np.random.default_rng(4)
    target, source = (scan("xyzXYZ", rng, IDENTITY) for _ in range(2))
    moved = source.surface.points.copy()
    piece = (moved[:, 0] < 0.2) & (moved[:, 1] < 1.5)
    moved[piece, 0] += 0.1
    estimate = estimate_by_surfaces(target, features(moved, source.surface.normals), IDENTITY, OPTIONS)
    assert np.abs(estimate.pose.translation_m).max() < 0.5 * NOISE_M


def test_points_that_are_left_out_take_no_part() -> None:
    rng = np.random.default_rng(5)
    target, source = scan("xyzXYZ", rng, IDENTITY), scan("xyzXYZ", rng, IDENTITY)
    along_x = tuple(np.abs(each.index.normals[:, 0]) > 0.5 for each in (target, source))
    estimate = estimate_by_surfaces(target, source, IDENTITY, OPTIONS, left_out=(along_x[0], along_x[1]))
    assert estimate.pose.null_space.shape == (6, 1)


def test_scans_apart_have_too_little_in_common() -> None:
    rng = np.random.default_rng(6)
    target, source = scan("xyzXYZ", rng, IDENTITY), scan("xyzXYZ", rng, IDENTITY)
    with pytest.raises(TooFewCorrespondencesError):
        estimate_by_surfaces(target, source, RigidTransform.from_translation([100.0, 0.0, 0.0]), OPTIONS)


def one_parameter(groups: int, in_group: int, rng: np.random.Generator) -> tuple[float, float]:
    """Estimate a mean of misfits that are the same within a neighbourhood; give estimate and stated variance."""
    places = np.repeat(FAR * np.arange(groups), in_group)
    positions = np.column_stack([places + 0.01, np.full(len(places), 0.01), np.full(len(places), 0.01)])
    gaps = np.repeat(rng.normal(size=groups), in_group)
    mean = gaps.mean()
    normals = np.tile([0.0, 0.0, 1.0], (len(places), 1))
    found = neighbourhood_covariance(
        np.ones((len(places), 1)), np.ones(len(places)), gaps - mean, positions, normals,
        slopes=np.ones(len(places)), edge_m=0.5, shifts=np.ones((1, 1)),
    )  # fmt: skip
    return float(mean), float(found.variances[0])


@pytest.mark.parametrize("groups", [8, 25])
def test_misfits_of_a_neighbourhood_count_as_one_however_many_they_are(groups: int) -> None:
    rng = np.random.default_rng(7)
    drawn = np.array([one_parameter(groups, 50, rng) for _ in range(100)])
    stated = drawn[:, 1].mean() * groups
    # Student's variance with as many degrees of freedom, which is what few neighbourhoods deserve
    assert stated == pytest.approx((groups - 1.0) / (groups - 3.0), rel=0.2)
    assert drawn[:, 0].var() * groups == pytest.approx(1.0, rel=0.4)


def test_misfits_that_are_alike_over_eight_metres_count_as_one() -> None:
    rng = np.random.default_rng(9)
    blocks, in_block = 16, 400
    stated, means = [], []
    for _ in range(60):
        places = rng.uniform(0.0, 8.0, blocks * in_block) + 16.0 * np.repeat(np.arange(blocks), in_block)
        positions = np.column_stack([places, np.zeros((len(places), 2))])
        gaps = np.repeat(rng.normal(size=blocks), in_block) + 0.1 * rng.normal(size=len(places))
        ones = np.ones((len(places), 1))
        found = neighbourhood_covariance(
            ones, ones[:, 0], gaps - gaps.mean(), positions, np.tile([0.0, 0.0, 1.0], (len(places), 1)),
            slopes=ones[:, 0], edge_m=0.5, shifts=np.ones((1, 1)),
        )  # fmt: skip
        stated.append(float(found.variances[0]))
        means.append(gaps.mean())
    assert 0.8 < np.mean(stated) / np.var(means) < 2.0


def test_two_neighbourhoods_control_nothing() -> None:
    assert one_parameter(2, 50, np.random.default_rng(8))[1] == np.inf
