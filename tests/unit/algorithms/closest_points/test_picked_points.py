"""The pose of picked points: closed form, honest covariance, refusals."""

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Points
from algorithms.closest_points.picked_points import picked_pose
from algorithms.errors import DegenerateGeometryError, TooFewCorrespondencesError

STD_M = 0.05
POSE = RigidTransform.from_components([12.0, -3.0, 1.5], Rotation.from_rotvec([0.2, -0.4, 2.2]))
SOURCE = np.array([[4.0, 1.0, 0.0], [-6.0, 3.0, 2.0], [1.0, -8.0, 1.0], [3.0, 4.0, -2.0]])


def picks(rng: np.random.Generator, count: int = 4, std_m: float = STD_M) -> tuple[Points, Points]:
    target = POSE.apply(SOURCE[:count]) + rng.normal(scale=std_m, size=(count, 3))
    return target, SOURCE[:count] + rng.normal(scale=std_m, size=(count, 3))


def error_of(estimate: RigidTransform) -> np.ndarray:
    turn = (estimate.rotation * POSE.rotation.inv()).as_rotvec()
    return np.concatenate([turn, np.asarray(estimate.translation) - np.asarray(POSE.translation)])


def test_three_exact_picks_give_the_pose() -> None:
    picked = picked_pose(POSE.apply(SOURCE[:3]), SOURCE[:3], STD_M)
    assert np.abs(error_of(picked.pose.target_from_source)).max() < 1e-12
    assert np.abs(picked.residuals_m).max() < 1e-12
    assert not picked.contradictory


def test_the_covariance_is_honest() -> None:
    """Squared errors in units of the covariance are chi-square, six degrees of freedom, and the statistic with 3n-6."""
    rng = np.random.default_rng(5)
    tries, errors, statistics = 200, [], []
    for _ in range(tries):
        picked = picked_pose(*picks(rng), STD_M)
        error = error_of(picked.pose.target_from_source)
        errors.append(error @ np.linalg.solve(picked.pose.covariance, error))
        statistics.append(picked.statistic)
    for values, degrees in ((errors, 6), (statistics, 6)):
        low, high = stats.chi2.interval(0.999, degrees * tries)
        assert low < np.sum(values) < 1.02 * high  # second-order terms of turns of a gon
    assert np.mean(np.array(statistics) > picked.critical) < 0.01


def test_exchanged_scans_give_the_inverse() -> None:
    target, source = picks(np.random.default_rng(1))
    forth, back = picked_pose(target, source, STD_M).pose, picked_pose(source, target, STD_M).pose.inverse()
    assert back.target_from_source.as_matrix() == pytest.approx(forth.target_from_source.as_matrix(), abs=1e-12)
    assert back.covariance == pytest.approx(forth.covariance, rel=0.05, abs=1e-6)


def test_moving_the_target_moves_the_answer() -> None:
    target, source = picks(np.random.default_rng(2))
    move = RigidTransform.from_components([1.0, 2.0, 3.0], Rotation.from_rotvec([0.5, 0.1, -0.3]))
    moved = picked_pose(np.asarray(move.apply(target)), source, STD_M).pose.target_from_source
    expected = move * picked_pose(target, source, STD_M).pose.target_from_source
    assert moved.as_matrix() == pytest.approx(expected.as_matrix(), abs=1e-12)


@pytest.mark.parametrize("count", [0, 2])
def test_two_picks_are_too_few(count: int) -> None:
    with pytest.raises(TooFewCorrespondencesError):
        picked_pose(SOURCE[:count], SOURCE[:count], STD_M)


def test_picks_on_a_line_leave_the_turn_about_it_free_and_say_so() -> None:
    line = np.array([[0.0, 0.0, 0.0], [0.02, 5.0, 0.0], [0.0, 9.0, 0.01]])
    with pytest.raises(DegenerateGeometryError, match=r"rotation about .*one line") as caught:
        picked_pose(line, line, STD_M)
    assert caught.value.rank == 5


def test_picks_in_one_place_leave_all_turns_free() -> None:
    with pytest.raises(DegenerateGeometryError) as caught:
        picked_pose(np.zeros((4, 3)), np.zeros((4, 3)), STD_M)
    assert caught.value.rank == 3


def test_mixed_up_and_mirrored_picks_contradict_each_other() -> None:
    target = POSE.apply(SOURCE)
    assert picked_pose(target[[1, 0, 2, 3]], SOURCE, STD_M).contradictory
    assert picked_pose(target * [1.0, 1.0, -1.0], SOURCE, STD_M).contradictory


def test_one_wrong_pick_stands_out_by_its_residual() -> None:
    source = np.vstack([SOURCE, SOURCE[:, [1, 2, 0]] + 1.0])
    target = np.asarray(POSE.apply(source))
    target[2] += [0.0, 0.0, 1.0]
    picked = picked_pose(target, source, STD_M)
    assert picked.contradictory
    assert np.argmax(np.linalg.norm(picked.residuals_m, axis=1)) == 2
