"""Hypotheses about gross errors: what a test value is, and when two of them cannot be told apart."""

from functools import cache

import numpy as np
import pytest
from scipy import linalg, stats

from algorithms.adjustment import snooping, solver
from algorithms.adjustment.gross_errors import GrossErrorSearch, log_probability
from algorithms.adjustment.observations.line_line import LineLine
from algorithms.adjustment.observations.plane_plane import PlanePlane
from algorithms.adjustment.pair_problem import PairProblem, by_station
from algorithms.adjustment.problem import LinearSystem, Problem
from algorithms.adjustment.snooping import SnoopingRules, adjust_and_snoop
from algorithms.adjustment.solver import Solution, solve
from algorithms.adjustment.unknowns import Unknowns
from algorithms.adjustment.weights import whitening_of
from tests.scenes.buildings.plane_rooms import observed_rooms, plane_rooms
from tests.scenes.lines.line_scenes import ObservedPair, observed_pair, one_line_shifted, room_lines

FREE = np.zeros((6, 0))


def solved(problem: Problem, start: Unknowns, *_: object) -> Solution:
    return solve(problem, start, FREE, 20)


def roughly_solved(problem: Problem, start: Unknowns, system: LinearSystem, rough: bool) -> Solution:
    return solve(problem, start, FREE, 20, linearised=(system, whitening_of(system)), rough=rough)


@cache
def independent() -> tuple[PairProblem, Solution]:
    rng = np.random.default_rng(1)
    pair = observed_pair(room_lines(rng), rng)
    problem = PairProblem((LineLine(pair.target, pair.source, pair.correspondences),))
    return problem, solved(problem, Unknowns.of_pair(pair.start))


def room_problem(pair: ObservedPair) -> PairProblem:
    planes = pair.planes
    assert isinstance(planes, PlanePlane)
    lines = LineLine(pair.target, pair.source, pair.correspondences)
    return PairProblem((lines, planes), by_station(planes.target.covariances, planes.source.covariances))


@cache
def rooms() -> tuple[PairProblem, Solution]:
    rng = np.random.default_rng(2)
    pair = observed_rooms(plane_rooms(rng), rng)
    problem = room_problem(pair)
    return problem, solved(problem, Unknowns.of_pair(pair.start))


def test_the_test_value_of_an_independent_line_is_the_drop_of_omega_when_it_is_left_out() -> None:
    problem, solution = independent()
    tests = GrossErrorSearch(solution).tests()
    for left_out in range(0, len(problem), 5):
        without = solved(problem.selected(np.arange(len(problem)) != left_out), solution.unknowns)
        # the weights of the others are evaluated at a pose that differs by fractions of a millimetre
        assert tests.statistics[left_out] == pytest.approx(solution.omega - without.omega, rel=0.02, abs=0.02)


def test_the_test_value_of_a_plane_is_the_drop_of_omega_when_its_errors_are_unknowns() -> None:
    _, solution = rooms()
    system, whitening = solution.system, solution.whitening
    tests = GrossErrorSearch(solution).tests()
    jacobian, residuals = whitening.apply(system.jacobian.toarray()), whitening.apply(system.residuals)
    checked = 0
    for k, plane in enumerate(tests.planes):
        if plane is None:
            continue
        station, number = plane
        design = system.plane_jacobians[station].toarray()[:, 3 * number : 3 * number + 3]
        extended = np.hstack([jacobian, whitening.apply(design)])
        extended = extended / np.linalg.norm(extended, axis=0)
        left = residuals - extended @ np.linalg.lstsq(extended, residuals, rcond=1e-9)[0]
        assert tests.statistics[k] == pytest.approx(solution.omega - left @ left, rel=1e-6, abs=1e-6)
        checked += 1
    assert checked > 5


def test_with_a_line_taken_out_the_tests_are_those_of_an_adjustment_without_it() -> None:
    problem, solution = independent()
    search = GrossErrorSearch(solution)
    taken_out = [3, 8]
    for block in taken_out:
        search.take_out(block)
    found = search.tests()
    others = np.setdiff1d(np.arange(len(problem)), taken_out)
    without = GrossErrorSearch(solved(problem.selected(np.isin(np.arange(len(problem)), others)), solution.unknowns))
    # the weights of the others are evaluated at a pose that differs by fractions of a millimetre
    np.testing.assert_allclose(found.statistics[others], without.tests().statistics, rtol=0.02, atol=0.02)
    assert (found.degrees[taken_out] == 0.0).all()
    assert [partner.block for partner in search.inseparable(0)] == [
        others[partner.block] for partner in without.inseparable(0)
    ]


def test_with_planes_taken_out_a_test_value_is_the_further_drop_of_omega_when_its_errors_are_unknowns_too() -> None:
    _, solution = rooms()
    system, whitening = solution.system, solution.whitening
    search = GrossErrorSearch(solution)
    tests = search.tests()
    planes = [k for k, plane in enumerate(tests.planes) if plane is not None]
    residuals = whitening.apply(system.residuals)
    extended, omega = whitening.apply(system.jacobian.toarray()), solution.omega
    for k in planes[:4]:
        station, number = tests.planes[k] or (0, 0)
        design = system.plane_jacobians[station].toarray()[:, 3 * number : 3 * number + 3]
        extended = np.hstack([extended, whitening.apply(design)])
        scaled = extended / np.linalg.norm(extended, axis=0)
        left = residuals - scaled @ np.linalg.lstsq(scaled, residuals, rcond=1e-9)[0]
        statistic = float(search.tests().statistics[k])
        search.take_out(k)
        assert statistic == pytest.approx(omega - left @ left, rel=1e-6, abs=1e-6)
        omega = float(left @ left)


def test_planes_list_what_depends_on_them_and_a_matched_pair_counts_once() -> None:
    problem, solution = rooms()
    tests = GrossErrorSearch(solution).tests()
    members = [tuple(blocks) for blocks, plane in zip(tests.blocks, tests.planes, strict=True) if plane is not None]
    assert len(set(members)) == len(members)
    lines, planes = problem.observations
    for blocks, plane in zip(tests.blocks, tests.planes, strict=True):
        if plane is None or plane[0] != 0:
            continue
        edges = np.flatnonzero((lines.target.parents[lines.pairs[:, 0]] == plane[1]).any(axis=1))
        pairs = len(lines) + np.flatnonzero(planes.pairs[:, 0] == plane[1])
        assert blocks.tolist() == [*edges, *pairs]


def test_planes_without_any_line_are_tested_and_taken_out() -> None:
    pair = observed_rooms(plane_rooms(np.random.default_rng(2)), np.random.default_rng(2))
    problem = room_problem(pair)
    lines, planes = problem.observations
    only_planes = problem.selected(np.arange(len(problem)) >= len(lines))
    search = GrossErrorSearch(solved(only_planes, Unknowns.of_pair(pair.start)))
    search.take_out(0)
    tests = search.tests()
    assert len(tests.statistics) == len(planes)
    assert tests.degrees[0] == 0.0
    assert (tests.degrees[1:] > 0.0).all()


def test_without_errors_the_test_values_follow_chi_square() -> None:
    probabilities = []
    for seed in range(20):
        rng = np.random.default_rng(100 + seed)
        problem = room_problem(pair := observed_rooms(plane_rooms(rng), rng))
        tests = GrossErrorSearch(solved(problem, Unknowns.of_pair(pair.start))).tests()
        probabilities.append(np.exp(tests.log_p[tests.degrees > 0]))
    together = np.concatenate(probabilities)
    # 20 scenes of about 50 correlated hypotheses: the mean of a uniform number is known to 0.02
    assert together.mean() == pytest.approx(0.5, abs=0.05)
    assert (together < 0.01).mean() < 0.02


def test_a_plane_that_moved_is_rejected_with_all_that_depends_on_it_and_nothing_else() -> None:
    rng = np.random.default_rng(5)
    scene = plane_rooms(rng)
    moved = int(np.argmax(np.bincount(scene.edges.ravel()) * scene.matched))
    pair = observed_rooms(scene, rng, source_rooms=scene.with_plane_moved(moved, 0.05))
    problem = room_problem(pair)
    result = adjust_and_snoop(problem, Unknowns.of_pair(pair.start), SnoopingRules(0.001, 0.5), solved)
    pair_of_moved = np.flatnonzero(scene.matched) == moved
    depends = np.concatenate([(scene.edges == moved).any(axis=1), pair_of_moved])
    np.testing.assert_array_equal(~result.used, depends)
    assert {step.plane for step in result.steps} == {(0, int(problem.observations[1].pairs[pair_of_moved, 0][0]))}


def test_selected_correspondences_keep_the_covariance_they_have_together() -> None:
    problem, solution = rooms()
    keep = np.random.default_rng(3).random(len(problem)) < 0.6
    anew = problem.selected(keep).linearised(solution.unknowns)
    whole = problem.linearised(solution.unknowns)
    assert anew.joint_covariance is not None
    np.testing.assert_allclose(whole.selected(keep).joint_covariance, anew.joint_covariance, rtol=1e-12, atol=0.0)


def test_weights_of_lines_and_their_planes_are_those_of_the_combinations_that_are_not_bound() -> None:
    system = rooms()[1].system
    joint, whitening = system.joint_covariance, whitening_of(system)
    assert joint is not None
    roots = linalg.block_diag(*(np.linalg.inv(np.linalg.cholesky(c)) for blocks in system.covariances for c in blocks))
    values, vectors = np.linalg.eigh(roots @ joint @ roots.T)
    assert whitening.rank < 0.8 * len(joint)
    assert values[-whitening.rank] > 100 * values[-whitening.rank - 1]
    kept = vectors[:, -whitening.rank :] / np.sqrt(values[-whitening.rank :])
    expected = roots.T @ kept @ kept.T @ roots
    scale = np.sqrt(np.diag(expected))
    found = whitening.apply_transposed(whitening.apply(np.eye(len(joint))))
    np.testing.assert_allclose(found / scale / scale[:, None], expected / scale / scale[:, None], atol=1e-5)


@pytest.mark.parametrize("seed", range(5))
def test_the_search_removes_the_same_whether_small_steps_are_taken_for_linear_or_not(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(40 + seed)
    scene = plane_rooms(rng)
    moved = int(rng.choice(np.flatnonzero(scene.matched)))
    pair = observed_rooms(scene, rng, source_rooms=scene.with_plane_moved(moved, 0.03))
    problem, start, found = room_problem(pair), Unknowns.of_pair(pair.start), []
    for limit in (solver.LINEAR_STEP, 0.0):
        monkeypatch.setattr(solver, "LINEAR_STEP", limit)
        monkeypatch.setattr(snooping, "LINEAR_STEP", limit)
        found.append(adjust_and_snoop(problem, start, SnoopingRules(0.001, 0.5), roughly_solved))
    quick, thorough = found
    assert [step.block for step in quick.steps] == [step.block for step in thorough.steps]
    assert not quick.used.all()
    np.testing.assert_allclose(quick.tests.statistics, thorough.tests.statistics, rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(quick.solution.pose.as_matrix(), thorough.solution.pose.as_matrix(), rtol=0.0, atol=1e-9)


def test_two_observations_that_only_check_each_other_are_named_as_inseparable() -> None:
    rng = np.random.default_rng(6)
    pair = observed_pair(room_lines(rng), rng)
    # two lines upright, all others level along one direction: shifts along it are known from these two alone
    directions = np.abs(pair.source.directions @ pair.source.directions[0])
    parallel = np.flatnonzero(directions > 0.99)
    across = np.flatnonzero(directions < 0.1)[:1]
    keep = np.sort(np.concatenate([parallel, across]))
    problem = PairProblem((LineLine(pair.target, pair.source, pair.correspondences[keep]),))
    solution = solved(problem, Unknowns.of_pair(pair.pose))
    search = GrossErrorSearch(solution)
    jacobian = solution.whitening.apply(solution.system.jacobian.toarray())
    residual_covariance = np.eye(len(jacobian)) - jacobian @ solution.cofactors @ jacobian.T
    for block in range(len(keep)):
        mine = slice(4 * block, 4 * block + 4)
        expected = []
        for other in range(len(keep)):
            theirs = slice(4 * other, 4 * other + 4)
            roots = [
                np.linalg.pinv(vectors * np.sqrt(np.maximum(values, 0.0)), rcond=1e-3)
                for values, vectors in (np.linalg.eigh(residual_covariance[s, s]) for s in (mine, theirs))
            ]
            crossed = roots[0] @ residual_covariance[mine, theirs] @ roots[1].T
            if other != block and np.linalg.norm(crossed, 2) > 0.9:
                expected.append(other)
        assert sorted(partner.block for partner in search.inseparable(block)) == expected


@pytest.mark.parametrize("degrees", [1, 2, 3, 4, 6, 24])
def test_logarithms_of_probabilities_are_those_of_chi_square(degrees: int) -> None:
    statistics = np.array([0.0, 0.5, 3.0, 40.0, 300.0, 1200.0])
    own = log_probability(statistics, np.full(6, float(degrees)))
    np.testing.assert_allclose(own, stats.chi2.logsf(statistics, degrees), rtol=1e-9, atol=1e-12)


def test_logarithms_of_tiny_probabilities_are_exact_for_two_and_four_degrees() -> None:
    statistics = np.array([1300.0, 5e3, 1e6])
    np.testing.assert_allclose(log_probability(statistics, np.full(3, 2.0)), -statistics / 2.0, rtol=1e-12)
    half = statistics / 2.0
    np.testing.assert_allclose(log_probability(statistics, np.full(3, 4.0)), np.log1p(half) - half, rtol=1e-12)


def test_what_nothing_controls_has_probability_one() -> None:
    assert log_probability(np.zeros(1), np.zeros(1)).tolist() == [0.0]


def test_the_b_method_removes_an_error_that_the_test_of_the_whole_line_at_the_same_level_lets_pass() -> None:
    rng = np.random.default_rng(8)
    pair = observed_pair(room_lines(rng), rng)
    problem = PairProblem((LineLine(pair.target, pair.source, pair.correspondences),))
    start = Unknowns.of_pair(pair.start)
    statistics = GrossErrorSearch(solved(problem, start)).tests().statistics
    k = int(np.argmax(statistics))
    # one offset is shifted until T of that line lies between the limits 13.54 and 18.47
    for size in np.linspace(0.0, 0.01, 200):
        shifted = one_line_shifted(pair, k, 2, size)
        problem = PairProblem((LineLine(shifted.target, shifted.source, shifted.correspondences),))
        statistics = GrossErrorSearch(solved(problem, start)).tests().statistics
        if 14.5 < statistics[k] < 17.5:
            break
    strict = adjust_and_snoop(problem, start, SnoopingRules(0.001, 0.5), solved)
    sensitive = adjust_and_snoop(problem, start, SnoopingRules(0.001, 0.5, b_method_power=0.8), solved)
    assert strict.used.all()
    assert np.flatnonzero(~sensitive.used).tolist() == [k]
    assert sensitive.steps[0].critical == pytest.approx(13.54, abs=0.005)
