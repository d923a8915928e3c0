"""What every registration method owes its user; driven by the union of methods."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from inspect import signature
from pkgutil import resolve_name
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.alshawa import adjust_alshawa
from algorithms.adjustment.options import AdjustmentOptions
from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.poses import PoseEstimate
from algorithms.matching.coarse_registration import match_features
from algorithms.matching.options import MatchingOptions
from algorithms.progress import NoProgress
from algorithms.registration import DEFAULT_METHOD, RegistrationMethod, pair_verdict
from algorithms.registration.auto import AutoMethod
from algorithms.registration.base import PairResult, PairStatus, RegistrationProblem
from algorithms.registration.lines_alshawa import LinesAlshawaMethod
from algorithms.registration.ndt import NdtMethod
from algorithms.registration.own_estimates import register_own_way
from algorithms.registration.own_procedures import OwnProcedure, Proposal
from algorithms.registration.targets import TargetsMethod
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import simulate_stations
from algorithms.simulation.scenes import SCENES

METHODS = tuple(method for method in get_args(RegistrationMethod) if method is not TargetsMethod)
"""All that register scans; what targets owe is in `test_target_registration.py`."""
SCANNER = VirtualScanner(rows=160, columns=400, mixed_pixels=False)
FAR_ORIGIN_M = np.array([500_000.0, 5_300_000.0, 400.0])
LARGEST_NEES = 22.5
"""99.9 % of chi-square with six degrees of freedom: one scene, one seed."""
QUICK = ("auto", "lines")
every_method = pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
quick_method = pytest.mark.parametrize(
    "method",
    [pytest.param(each, marks=[] if each.name in QUICK else [pytest.mark.slow]) for each in METHODS],
    ids=lambda method: method.name,
)
"""Every method, all but some with the slow tests."""
further_method = pytest.mark.parametrize(
    "method", [pytest.param(each, marks=pytest.mark.slow) for each in METHODS], ids=lambda method: method.name
)
"""Every method, with the slow tests: each registers once more."""


@pytest.fixture(scope="module", autouse=True)
def one_search_for_the_same_scans() -> Iterator[None]:
    """Let all methods share the search they start from or are verified against: it takes seconds every time."""
    with pytest.MonkeyPatch.context() as patch:
        searched = cache(match_features)
        patch.setattr(pair_verdict, "match_features", searched)
        yield


def extracted(scan: Any) -> ScanFeatures:
    return extract_features(scan, FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0))


@cache
def stations(name: str) -> tuple[tuple[ScanFeatures, ...], RigidTransform]:
    """Features of two stations of a scene and the true target_from_source."""
    scene = SCENES[name]()
    scans = simulate_stations(scene, scene.stations[:2], SCANNER, np.random.default_rng(3))
    return tuple(extracted(scan) for scan in scans), scene.stations[0].inv() * scene.stations[1]


@cache
def same_problem_again() -> RegistrationProblem:
    """The pipe hall in other objects: everything is searched anew."""
    return RegistrationProblem(*(replace(features) for features in stations("pipe_hall")[0]))


@cache
def far_problem() -> RegistrationProblem:
    """The pipe hall with a target in coordinates of a national grid."""
    (target, source), _ = stations("pipe_hall")
    return RegistrationProblem(replace(target, origin_m=FAR_ORIGIN_M), source)


@cache
def tilted_problem() -> tuple[RegistrationProblem, RigidTransform]:
    """The pipe hall seen by a second instrument that lies on its side, and the true target_from_source."""
    scene = SCENES["pipe_hall"]()
    tilt = RigidTransform.from_rotation(Rotation.from_euler("x", 90, degrees=True))
    poses = [scene.stations[0], scene.stations[1] * tilt]
    features = [extracted(scan) for scan in simulate_stations(scene, poses, SCANNER, np.random.default_rng(4))]
    return RegistrationProblem(*features), poses[0].inv() * poses[1]


@cache
def registered(method: Any, name: str, *, swapped: bool = False) -> PairResult:
    (target, source), _ = stations(name)
    problem = RegistrationProblem(source, target) if swapped else RegistrationProblem(target, source)
    return method().register(problem, progress=NoProgress())


def pose_of(result: PairResult) -> PoseEstimate:
    """Give the answer of a method, also of one that uses neither lines nor planes."""
    if result.final is not None:
        return result.final.pose
    assert result.fine is not None
    return result.fine.pose


def error_of(estimate: RigidTransform, truth: RigidTransform) -> np.ndarray:
    turn = (truth.rotation * estimate.rotation.inv()).as_rotvec()
    return np.concatenate([turn, np.asarray(truth.translation) - np.asarray(estimate.translation)])


@quick_method
def test_a_known_pose_is_recovered_and_accepted_with_an_honest_covariance(method: Any) -> None:
    result = registered(method, "pipe_hall")
    assert result.status is PairStatus.ACCEPTED
    error = error_of(pose_of(result).target_from_source, stations("pipe_hall")[1])
    assert error @ np.linalg.solve(pose_of(result).covariance, error) < LARGEST_NEES
    assert np.linalg.norm(error[3:]) < 0.002


@pytest.mark.parametrize("method", METHODS)
def test_the_work_of_a_method_is_a_function_of_problem_method_and_progress(method: Any) -> None:
    work = resolve_name(method.work)
    assert list(signature(work).parameters) == ["problem", "method", "progress"]
    assert get_type_hints(work)["method"] is method


@further_method
def test_the_same_input_gives_the_same_answer(method: Any) -> None:
    again = method().register(same_problem_again(), progress=NoProgress())
    first = registered(method, "pipe_hall")
    np.testing.assert_array_equal(
        pose_of(again).target_from_source.as_matrix(), pose_of(first).target_from_source.as_matrix()
    )


@further_method
def test_swapping_the_scans_inverts_the_answer(method: Any) -> None:
    there, back = (pose_of(registered(method, "pipe_hall", swapped=swapped)) for swapped in (False, True))
    difference = error_of(back.inverse().target_from_source, there.target_from_source)
    # of what is linearised, the square is left; other authors' estimators measure at the target's lines by definition
    part = 0.1 if registered(method, "pipe_hall").own_figures is None else 3.0
    assert (np.abs(difference) < part * np.sqrt(np.diag(there.covariance))).all()


@further_method
def test_swapping_the_scans_changes_neither_status_nor_estimator(method: Any) -> None:
    there, back = (registered(method, "pipe_hall", swapped=swapped) for swapped in (False, True))
    assert back.status is there.status
    assert (None if back.final is None else back.final.estimator) == (
        None if there.final is None else there.final.estimator
    )


@pytest.mark.slow
def test_swapping_scans_of_like_rooms_that_share_little_inverts_the_answer() -> None:
    scene = SCENES["office"]()
    scans = simulate_stations(scene, [scene.stations[k] for k in (1, 3)], SCANNER, np.random.default_rng(3))
    one, other = (extracted(scan) for scan in scans)
    there, back = (
        AutoMethod().register(RegistrationProblem(*pair), progress=NoProgress())
        for pair in ((one, other), (other, one))
    )
    assert back.status is there.status
    turned = pose_of(back).inverse()
    std = np.sqrt(np.diag(pose_of(there).covariance))
    difference = error_of(turned.target_from_source, pose_of(there).target_from_source)
    # of what is linearised, the square is left
    assert (np.abs(difference) < 0.01 * std).all()
    np.testing.assert_allclose(np.sqrt(np.diag(turned.covariance)), std, rtol=0.01)


@every_method
def test_parallel_pipes_are_degenerate_and_the_free_shift_is_named(method: Any) -> None:
    result = registered(method, "parallel_pipes")
    assert result.status is PairStatus.DEGENERATE
    assert "translation along" in result.free_directions[0]
    assert result.free_directions[0] in result.reasons[0]


@every_method
def test_a_single_plane_is_degenerate(method: Any) -> None:
    assert registered(method, "single_plane").status is PairStatus.DEGENERATE


@quick_method
def test_scans_of_different_places_are_never_accepted(method: Any) -> None:
    problem = RegistrationProblem(stations("pipe_hall")[0][0], stations("house")[0][1])
    result = method().register(problem, progress=NoProgress())
    assert not result.status.in_place
    assert result.reasons


@further_method
def test_far_coordinates_give_the_answer_of_near_ones(method: Any) -> None:
    far = pose_of(method().register(far_problem(), progress=NoProgress()))
    near = pose_of(registered(method, "pipe_hall"))
    shift = far.translation_m - near.translation_m
    np.testing.assert_allclose(shift, FAR_ORIGIN_M, atol=1e-8)  # the spacing of doubles there is 1e-9 m
    np.testing.assert_allclose(far.covariance, near.covariance, rtol=1e-6, atol=1e-18)


@pytest.mark.slow
def test_slices_of_levelled_scanners_are_no_answer_for_one_that_lies_on_its_side() -> None:
    problem, truth = tilted_problem()
    result = NdtMethod().register(problem, progress=NoProgress())
    if result.status is PairStatus.ACCEPTED:
        assert np.linalg.norm(error_of(pose_of(result).target_from_source, truth)[3:]) < 0.005
    assert result.reasons


@pytest.mark.parametrize(
    "method",
    [
        pytest.param(each, marks=[] if each is DEFAULT_METHOD else pytest.mark.slow)
        for each in METHODS
        if each is not NdtMethod
    ],
    ids=lambda method: method.name,
)
def test_a_tilted_instrument_changes_nothing(method: Any) -> None:
    problem, truth = tilted_problem()
    result = method().register(problem, progress=NoProgress())
    assert result.status is PairStatus.ACCEPTED
    error = error_of(pose_of(result).target_from_source, truth)
    assert error @ np.linalg.solve(pose_of(result).covariance, error) < LARGEST_NEES
    assert np.linalg.norm(error[3:]) < 0.005


@quick_method
def test_a_pose_that_is_not_the_rigorous_one_comes_with_it_and_with_what_the_method_claims(method: Any) -> None:
    result = registered(method, "pipe_hall")
    if result.own_figures is None:
        assert result.rigorous is None
        return
    assert result.rigorous is not None
    error = error_of(result.rigorous.target_from_source, stations("pipe_hall")[1])
    assert error @ np.linalg.solve(result.rigorous.covariance, error) < LARGEST_NEES
    if result.final is not None:  # it proposed a pose only, and the answer is the rigorous one
        assert result.rigorous is result.final.pose
        assert result.own_figures.pose is not result.rigorous
        assert result.own_figures.remarks
        return
    assert result.fine is not None
    # the rigorous estimate of the same lines is the best one: no direction may be known better by another
    excess = np.linalg.eigvalsh(result.fine.pose.covariance - result.rigorous.covariance)
    assert excess[0] > -1e-3 * excess[-1]
    assert sum(step.unknowns for step in result.own_figures.steps) == 6
    assert len(result.own_figures.lines) >= 3


def test_lines_of_one_direction_are_refused_though_the_scans_have_others() -> None:
    (target, source), truth = stations("pipe_hall")
    lines = registered(LinesAlshawaMethod, "pipe_hall").own_figures.lines  # type: ignore[union-attr]
    directions = target.lines.directions[lines[:, 0]]
    parallel = np.linalg.norm(np.cross(directions, directions[0]), axis=1) < 0.02
    assert parallel.sum() >= 3
    procedure = OwnProcedure(
        "of one direction",
        MatchingOptions(),
        AdjustmentOptions(),
        lambda _problem, _search: Proposal(lines[parallel], truth),
        adjust_alshawa,
    )
    result = register_own_way(RegistrationProblem(target, source), procedure, NoProgress())
    assert result.status is PairStatus.DEGENERATE
    assert "translation along" in result.free_directions[0]
    assert result.own_figures is None
    assert result.rigorous is not None
    assert result.rigorous.null_space.shape == (6, 1)
