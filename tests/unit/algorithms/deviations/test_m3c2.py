"""Distances along normals, and what the level of detection knows."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.deviations.joint_poses import JointPoses, exact_poses, of_pair, of_stations
from algorithms.deviations.m3c2 import M3C2, m3c2
from algorithms.deviations.options import Average, M3C2Options, WavesOf
from algorithms.deviations.orientation import Side
from algorithms.errors import InvalidInputError
from algorithms.geometry.poses import PoseEstimate
from tests.scenes.deviation_scenes import STATIONS_M, correlated_poses, pair_without_change, plain_m3c2, waving_floor

RADIUS_M, HALF_M, NORMALS_M = 0.1, 0.5, 0.3
CORES = np.arange(0, 2601, 217)
PLAIN = M3C2Options(RADIUS_M, HALF_M, (NORMALS_M,), waviness_std_m=0.0)
OF_PY4DGEO = np.array(
    [
        [0.0040861689, 0.0020595989, 8, 8],
        [0.0040411711, 0.0015010825, 19, 19],
        [0.0040196426, 0.0016363674, 20, 20],
        [0.0039939327, 0.0017350281, 18, 18],
        [0.0038973702, 0.0017481785, 17, 17],
        [0.0039984440, 0.0014726002, 21, 21],
        [0.0039343507, 0.0016201840, 20, 20],
        [0.0038697410, 0.0014228088, 20, 20],
        [0.0040333983, 0.0014870631, 21, 21],
        [0.0039771125, 0.0014052710, 21, 21],
        [0.0039791235, 0.0015135735, 21, 21],
        [0.0040845259, 0.0016839556, 19, 19],
    ]
)
"""Distance [m], level of detection [m] and numbers of points at the core points."""


def compared(first: np.ndarray, second: np.ndarray, cores: np.ndarray, options: M3C2Options = PLAIN) -> M3C2:
    return m3c2(first, second, cores, exact_poses(), options, rng=np.random.default_rng(1))


@pytest.mark.slow
def test_without_pose_errors_and_waves_it_is_the_plain_method() -> None:
    first, second = waving_floor(0.0), waving_floor(0.004)
    found = compared(first, second, first[CORES])
    expected = np.array([plain_m3c2(first, second, core, RADIUS_M, HALF_M, NORMALS_M) for core in first[CORES]])
    assert np.abs(found.distances_m - expected[:, 0]).max() < 1e-12
    assert np.abs(1.96 * found.std_m - expected[:, 1]).max() < 1e-12
    assert np.abs(found.normals - expected[:, 2:]).max() < 1e-7


def test_it_gives_the_numbers_of_py4dgeo() -> None:
    # py4dgeo 1.2.0: M3C2(epochs, corepoints=first[CORES], normal_radii=[0.3], cyl_radius=0.1, max_distance=0.5).run()
    # (with an even number of radii along the cylinder it loses the core point, which lies between two of its parts)
    first, second = waving_floor(0.0), waving_floor(0.004)
    found = compared(first, second, first[CORES])
    assert np.abs(found.distances_m - OF_PY4DGEO[:, 0]).max() < 1e-9
    assert np.abs(1.96 * found.std_m - OF_PY4DGEO[:, 1]).max() < 1e-9
    assert np.array_equal(np.column_stack(found.counts), OF_PY4DGEO[:, 2:])


def test_the_median_ignores_points_that_stand_before_the_surface() -> None:
    first, second = waving_floor(0.0), waving_floor(0.004)
    second[::10, 2] += 0.2
    means, medians = (
        compared(first, second, first[CORES], M3C2Options(RADIUS_M, HALF_M, (NORMALS_M,), average)).distances_m
        for average in (Average.MEAN, Average.MEDIAN)
    )
    assert np.median(np.abs(medians - 0.004)) < 0.002
    assert np.median(np.abs(means - 0.004)) > 0.01


def test_exchanged_clouds_turn_the_sign() -> None:
    first, second = waving_floor(0.0), waving_floor(0.004)
    cores, normals = first[CORES], np.tile([0.0, 0.0, 1.0], (len(CORES), 1))
    there, back = (
        m3c2(*clouds, cores, exact_poses(), PLAIN, normals=normals, rng=np.random.default_rng(1)).distances_m
        for clouds in ((first, second), (second, first))
    )
    assert np.abs(there + back).max() < 1e-12


def test_moving_everything_changes_no_distance() -> None:
    turn, shift = Rotation.from_rotvec([0.3, -0.2, 0.9]), np.array([40.0, -7.0, 3.0])
    first, second = waving_floor(0.0), waving_floor(0.004)
    here = compared(first, second, first[CORES])
    moved = [turn.apply(cloud) + shift for cloud in (first, second)]
    there = m3c2(
        *moved, moved[0][CORES], exact_poses(), PLAIN, stated=Side(point_m=turn.apply([1.0, 1.0, 50.0]) + shift),
        rng=np.random.default_rng(1),
    )  # fmt: skip
    assert np.abs(np.abs(here.distances_m) - np.abs(there.distances_m)).max() < 1e-9


def test_where_a_cloud_has_no_points_there_is_no_distance() -> None:
    first, second = waving_floor(0.0), waving_floor(0.0)[:1000]
    found = compared(first, second, first[CORES])
    assert found.measured.any()
    assert not found.measured.all()
    assert np.isnan(found.distances_m[~found.measured]).all()
    assert not found.significant[~found.measured].any()


def test_empty_clouds_and_impossible_sizes_are_refused() -> None:
    floor = waving_floor(0.0)
    with pytest.raises(InvalidInputError, match="no points"):
        compared(floor, floor[:0], floor[:1])
    with pytest.raises(InvalidInputError, match="positive lengths"):
        M3C2Options(cylinder_radius_m=0.0)
    with pytest.raises(InvalidInputError, match="alpha"):
        M3C2Options(alpha=1.0)


def test_errors_that_both_stations_share_make_no_distance() -> None:
    shared = np.kron(np.ones((2, 2)), np.diag([1e-8, 1e-8, 1e-8, 1e-6, 1e-6, 1e-6]))
    places, normals = np.array([[5.0, 1.0, 0.0], [0.0, 9.0, 2.0]]), np.array([[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    together = JointPoses(np.zeros((2, 3)), shared).variances_along(places, normals)
    apart = JointPoses(np.zeros((2, 3)), shared * np.kron(np.eye(2), np.ones((6, 6)))).variances_along(places, normals)
    assert np.abs(together).max() < 1e-18
    assert np.allclose(apart, 2.0 * (1e-6 + 1e-8 * np.linalg.norm(np.cross(places, normals), axis=1) ** 2))


def test_variances_are_those_of_drawn_poses() -> None:
    rng = np.random.default_rng(2)
    poses = JointPoses(STATIONS_M, correlated_poses(rng))
    place, normal = np.array([7.0, -3.0, 2.0]), np.array([0.6, 0.0, -0.8])
    drawn = rng.multivariate_normal(np.zeros(12), poses.covariance, 40_000)
    moves = [
        np.cross(drawn[:, 6 * k : 6 * k + 3], place - STATIONS_M[k]) + drawn[:, 6 * k + 3 : 6 * k + 6] for k in (0, 1)
    ]
    predicted = poses.variances_along(place[None], normal[None])[0]
    assert np.var((moves[1] - moves[0]) @ normal) == pytest.approx(predicted, rel=0.03)


def test_a_pair_is_a_network_whose_first_station_has_no_error() -> None:
    turned = RigidTransform.from_components([1.0, 2.0, 0.0], Rotation.from_rotvec([0.0, 0.0, 0.4]))
    pose = PoseEstimate(turned, correlated_poses(np.random.default_rng(3))[:6, :6])
    fixed = PoseEstimate(RigidTransform.identity(), np.zeros((6, 6)))
    pair, network = of_pair(pose), of_stations(fixed, pose, np.zeros((6, 6)))
    assert np.array_equal(pair.covariance, network.covariance)
    place, normal = np.array([[4.0, 4.0, 1.0]]), np.array([[0.0, 0.0, 1.0]])
    expected = normal[0] @ pose.position_covariance_m2(place[0]) @ normal[0]
    assert pair.variances_along(place, normal)[0] == pytest.approx(expected)


@pytest.mark.parametrize(
    "matrix", [np.diag([*np.ones(11), -1.0]), np.triu(np.ones((12, 12))), np.full((12, 12), np.nan)]
)
def test_what_is_no_covariance_is_refused(matrix: np.ndarray) -> None:
    with pytest.raises(InvalidInputError, match="joint covariance"):
        JointPoses(np.zeros((2, 3)), matrix)


@pytest.mark.parametrize("waves", list(WavesOf))
def test_errors_that_neighbouring_points_share_are_measured(waves: WavesOf) -> None:
    pair = pair_without_change(4, points=8000, pose_share=0.0)
    found = m3c2(
        pair.first, pair.second, pair.first[::40], pair.poses, M3C2Options(0.08, 0.3, (0.3,), waves=waves),
        stated=Side(point_m=np.zeros(3)), rng=np.random.default_rng(4),
    ).waviness  # fmt: skip
    assert found.samples >= 20
    assert found.std_m == pytest.approx(np.sqrt(2.0) * 0.001, rel=0.2)


@pytest.mark.parametrize("waves", list(WavesOf))
def test_a_third_of_the_scene_that_changed_makes_no_waves(waves: WavesOf) -> None:
    pair = pair_without_change(5, points=8000, waves_m=0.0, pose_share=0.0)
    pair.second[pair.second[:, 0] > 2.0] += [0.0, 0.0, 0.02]
    pair.second[pair.second[:, 1] > 2.0] += [0.0, 0.02, 0.0]
    found = m3c2(
        pair.first, pair.second, pair.first[::40], pair.poses, M3C2Options(0.08, 0.3, (0.3,), waves=waves),
        stated=Side(point_m=np.zeros(3)), rng=np.random.default_rng(5),
    ).waviness  # fmt: skip
    assert found.std_m < 5e-4


def test_few_points_are_judged_by_student() -> None:
    first, second = waving_floor(0.0)[::4], waving_floor(0.0)[1::4]
    found = compared(first, second, first[::31], M3C2Options(0.06, HALF_M, (NORMALS_M,), waviness_std_m=0.0))
    few = found.measured & (found.counts[0] + found.counts[1] <= 8)
    assert few.any()
    assert (found.levels_of_detection_m[few] > 2.2 * found.std_m[few]).all()
