"""Two stations by survey targets, alone and together with lines, planes and surfaces."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from algorithms.geometry.point_sets import PointSet
from algorithms.matching.coarse_registration import CoarseRegistration
from algorithms.progress import NoProgress
from algorithms.registration import auto_registration
from algorithms.registration.auto import AutoMethod
from algorithms.registration.base import PairResult, PairStatus, RegistrationProblem
from algorithms.registration.target_fit import fitted_targets
from algorithms.registration.targets import TargetsMethod
from algorithms.targets.common_points import TargetSet
from tests.unit.algorithms.registration.test_auto_registration import POSE, scan

STD_M = 0.001
PLACES = np.array(
    [[0.5, 0.4, 0.3], [5.5, 0.6, 2.4], [5.2, 4.1, 0.4], [0.4, 4.0, 2.6], [3.0, 2.2, 1.2], [2.0, 4.2, 1.9]]
)
NAMES = ("1", "2", "3", "4", "5", "6")


@pytest.fixture(autouse=True)
def search_that_finds_the_pose(monkeypatch: pytest.MonkeyPatch) -> None:
    found = CoarseRegistration(POSE, 12, 0.8, 0.8, 0.0, 0.9, None, 0.0, 0, 100, True, False, ())
    monkeypatch.setattr(auto_registration, "searched", lambda *_: found)


def problem(
    seed: int = 1,
    places: np.ndarray = PLACES,
    names: tuple[str | None, ...] = NAMES,
    moved: tuple[int, float] | None = None,
    *,
    scans_at: RigidTransform = POSE,
) -> RegistrationProblem:
    """Give a room with targets, of which one was moved by some metres between the scans."""
    rng = np.random.default_rng(seed)
    seen = [places + STD_M * rng.normal(size=places.shape), places + STD_M * rng.normal(size=places.shape)]
    if moved is not None:
        seen[1][moved[0], 0] += moved[1]
    seen[1] = POSE.inv().apply(seen[1])
    target, source = (TargetSet(names[: len(places)], PointSet.with_std(each, STD_M)) for each in seen)
    return RegistrationProblem(scan(RigidTransform.identity(), 1), scan(scans_at, 2), None, target, source)


def by_targets(given: RegistrationProblem) -> PairResult:
    return TargetsMethod().register(given, progress=NoProgress())


def by_everything(given: RegistrationProblem) -> PairResult:
    return AutoMethod().register(given, progress=NoProgress())


def error_of(result: PairResult) -> np.ndarray:
    assert result.final is not None
    pose = result.final.reduced.target_from_source
    turn = (POSE.rotation * pose.rotation.inv()).as_rotvec()
    return np.concatenate([turn, np.asarray(POSE.translation) - np.asarray(pose.translation)])


@pytest.mark.parametrize("names", [NAMES, (None,) * 6], ids=["names", "distances"])
def test_targets_alone_give_an_accepted_pose_with_an_honest_covariance(names: tuple[str | None, ...]) -> None:
    result = by_targets(problem(names=names))
    assert result.status is PairStatus.ACCEPTED, result.reasons
    assert result.final is not None
    assert result.final.estimator == "targets"
    error = error_of(result)
    assert error @ np.linalg.solve(result.final.reduced.covariance, error) < 22.5


@pytest.mark.slow
def test_errors_of_the_pose_of_targets_are_as_large_as_the_covariance_says() -> None:
    nees = []
    for seed in range(100):
        fit = fitted_targets(problem(seed))
        turn = (POSE.rotation * fit.pose.rotation.inv()).as_rotvec()
        error = np.concatenate([turn, np.asarray(POSE.translation) - fit.pose.translation_m])
        nees.append(error @ np.linalg.solve(fit.pose.covariance, error))
    assert abs(np.mean(nees) - 6.0) < 1.1  # three standard deviations of the mean


def test_a_target_that_was_moved_is_left_out_and_named() -> None:
    result = by_targets(problem(moved=(3, 0.02)))
    assert result.targets is not None
    assert result.targets.used.tolist() == [True, True, True, False, True, True]
    assert "left out as gross errors: 4" in result.reasons[0]
    assert np.linalg.norm(error_of(result)[3:]) < 0.004


def test_exchanged_names_are_left_out() -> None:
    given = problem()
    assert given.source_points is not None
    exchanged = replace(given.source_points, names=("2", "1", "3", "4", "5", "6"))
    result = by_targets(replace(given, source_points=exchanged))
    assert result.targets is not None
    assert not result.targets.used[:2].any()
    assert result.targets.used[2:].all()


def test_targets_on_a_line_leave_a_turn_free_and_it_is_named() -> None:
    line = np.array([[0.5, 0.5, 1.0], [2.0, 2.0, 1.0], [4.0, 4.0, 1.0], [3.0, 3.0, 1.0]])
    result = by_targets(problem(places=line))
    assert result.status is PairStatus.DEGENERATE
    assert "rotation about the line" in result.free_directions[0]


def test_two_targets_are_too_few_and_the_reason_says_how_many_are_there() -> None:
    result = by_targets(problem(places=PLACES[:2]))
    assert result.status is PairStatus.REJECTED
    assert "2" in result.reasons[0]
    assert "3" in result.reasons[0]


def test_three_targets_that_surfaces_do_not_control_are_doubtful() -> None:
    result = by_targets(problem(places=PLACES[:3]))
    assert result.status is PairStatus.DOUBTFUL
    assert any("would not show" in reason for reason in result.reasons)


@pytest.mark.slow
def test_swapping_the_scans_inverts_the_answer_of_targets() -> None:
    given = problem(moved=(2, 0.03))
    there = by_targets(given)
    back = by_targets(RegistrationProblem(given.source, given.target, None, given.source_points, given.target_points))
    assert there.final is not None
    assert back.final is not None
    assert back.status is there.status
    np.testing.assert_allclose(
        back.final.reduced.inverse().target_from_source.as_matrix(),
        there.final.reduced.target_from_source.as_matrix(),
        atol=1e-6,
    )


@pytest.mark.slow
def test_targets_join_planes_and_surfaces_and_make_the_pose_better() -> None:
    given = problem()
    alone = by_everything(replace(given, target_points=None, source_points=None))
    joined = by_everything(given)
    assert alone.final is not None
    assert joined.final is not None
    assert joined.final.estimator == f"{alone.final.estimator}+targets"
    assert joined.status is PairStatus.ACCEPTED, joined.reasons
    assert {part.name for part in joined.final.parts} > {"targets"}
    np.testing.assert_allclose(sum(part.share for part in joined.final.parts), 1.0)
    assert (np.diag(joined.final.reduced.covariance) < np.diag(alone.final.reduced.covariance)).all()
    error = error_of(joined)
    assert error @ np.linalg.solve(joined.final.reduced.covariance, error) < 22.5


def test_targets_that_contradict_the_surfaces_are_named_and_never_accepted() -> None:
    shifted = RigidTransform.from_translation([0.0, 0.05, 0.0]) * POSE
    result = by_everything(problem(scans_at=shifted))
    assert not result.status.in_place
    assert any("targets and" in reason and "contradict each other" in reason for reason in result.reasons)


def test_two_common_targets_take_no_part_and_the_reasons_say_so() -> None:
    result = by_everything(problem(places=PLACES[:2]))
    assert any(reason.startswith("targets take no part") for reason in result.reasons)
