"""The solver: any unknowns, any datum, honest about what is not determined."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import linalg, sparse
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment import solver
from algorithms.adjustment.datum import (
    DatumSelection,
    free_network_conditions,
    held_columns,
    motion_basis,
    s_transformation,
)
from algorithms.adjustment.hybrid.factor_kernels import normal_of_blocks
from algorithms.adjustment.network_adjustment import adjust_network
from algorithms.adjustment.observations.levelling import Levelling
from algorithms.adjustment.observations.point_point import PointPoint
from algorithms.adjustment.observations.polar import Polar, PolarComponent
from algorithms.adjustment.problem import Problem
from algorithms.adjustment.robust_weights import robust_adjustment, weight_factor
from algorithms.adjustment.solver import Solution, solve
from algorithms.adjustment.testing import redundancy_numbers
from algorithms.adjustment.unknowns import UnknownKind, Unknowns
from algorithms.adjustment.variance_components import estimate_variance_components
from algorithms.errors import DegenerateGeometryError, InvalidInputError
from algorithms.geometry.point_sets import PointSet

STDS = np.array([0.0005, 0.0005, 0.003])  # rad, rad, m
POSE = RigidTransform.from_components([4.0, -1.0, 0.2], Rotation.from_rotvec([0.02, -0.01, 1.9]))


def all_pairs(n: int) -> np.ndarray:
    return np.repeat(np.arange(n, dtype=np.int64)[:, None], 2, axis=1)


def network(seed: int, *, noise: float = 1.0, stations: int = 4, points: int = 12) -> tuple[Problem, Unknowns]:
    """Stations that all measure all points completely, and start values some centimetres off."""
    rng = np.random.default_rng(seed)
    poses = RigidTransform.from_components(
        rng.uniform(-4.0, 4.0, (stations, 3)), Rotation.from_euler("z", rng.uniform(0.0, 6.0, (stations, 1)))
    )
    objects = rng.uniform(-10.0, 10.0, (points, 3))
    truth = Unknowns(poses, objects, np.zeros(stations, dtype=bool), np.zeros(points, dtype=bool))
    station, point, component = (
        a.ravel() for a in np.meshgrid(np.arange(stations), np.arange(points), np.arange(3), indexing="ij")
    )
    exact = Polar(station, point, component.astype(np.int32), np.zeros(len(station)), STDS[component])
    values = exact.equations(truth).residuals[:, 0] + noise * exact.stds * rng.normal(size=len(station))
    return Problem((replace(exact, values=values),)), truth.moved(0.02 * rng.normal(size=truth.count))


def free(problem: Problem, start: Unknowns, *_: object) -> Solution:
    return solve(problem, start, free_network_conditions(start, DatumSelection.of_everything(start)), 30)


def test_small_steps_change_residuals_as_the_derivatives_say() -> None:
    problem, start = network(6)
    system = problem.linearised(start)
    step = 1e-5 * np.random.default_rng(6).normal(size=start.count)
    anew = problem.linearised(start.moved(step))
    # Second-order terms: the square of the step.
    np.testing.assert_allclose(system.moved(step).residuals, anew.residuals, atol=1e-8)
    assert np.abs(anew.residuals - system.residuals).max() > 1e-6


def test_a_rough_solution_is_within_hundredths_of_a_standard_deviation_of_the_final_one() -> None:
    problem, start = network(7)
    conditions = free_network_conditions(start, DatumSelection.of_everything(start))
    near = solve(problem, start, conditions, 30).unknowns
    shaken = near.moved(1e-4 * np.random.default_rng(7).normal(size=start.count))
    final, rough = (solve(problem, shaken, conditions, 30, rough=each) for each in (False, True))
    apart = np.linalg.norm(final.system.residuals - rough.system.residuals) / np.sqrt(len(final.system.residuals))
    assert apart < 0.05 * STDS.min()


@pytest.mark.parametrize(("away", "is_small"), [(1e-6, True), (1e-2, False)])
def test_a_rough_solution_tells_the_step_to_it_where_all_was_taken_for_linear(away: float, is_small: bool) -> None:
    problem, start = network(8)
    conditions = free_network_conditions(start, DatumSelection.of_everything(start))
    near = solve(problem, start, conditions, 30)
    shaken = near.unknowns.moved(away * np.random.default_rng(8).normal(size=start.count))
    rough = solve(problem, shaken, conditions, 30, rough=True)
    assert near.linear_step is None
    assert (rough.linear_step is not None) == is_small
    if rough.linear_step is not None:
        reached = shaken.moved(rough.linear_step)
        np.testing.assert_allclose(reached.points, rough.unknowns.points, atol=1e-9)
        np.testing.assert_allclose(reached.poses.as_matrix(), rough.unknowns.poses.as_matrix(), atol=1e-9)


def test_a_network_without_noise_is_recovered_up_to_its_datum() -> None:
    problem, start = network(1, noise=0.0)
    solution = free(problem, start)
    assert solution.converged
    assert solution.omega < 1e-12


def test_residuals_and_redundancy_do_not_depend_on_the_datum() -> None:
    problem, start = network(2)
    fixed = replace(start, pose_is_fixed=np.array([True, False, False, False]))
    one, other = free(problem, start), solve(problem, fixed, np.zeros((fixed.count, 0)), 30)
    assert one.redundancy == other.redundancy == 4 * 12 * 3 - 4 * 6 - 12 * 3 + 6
    np.testing.assert_allclose(one.system.residuals, other.system.residuals, atol=1e-9)
    np.testing.assert_allclose(redundancy_numbers(one), redundancy_numbers(other), atol=1e-6)


def test_a_free_network_has_the_smallest_trace_of_all_datums() -> None:
    problem, start = network(3)
    everything = DatumSelection.of_everything(start)
    points_only = replace(everything, positions=np.zeros(4, dtype=bool), rotations=np.zeros(4, dtype=bool))
    inner = solve(problem, start, free_network_conditions(start, points_only), 30)
    rows = inner.unknowns.first_columns(UnknownKind.POINT, np.arange(12, dtype=np.int64))
    first, last = int(rows[0]), inner.unknowns.count
    for columns in ([24, 25, 26, 28, 29, 32], [30, 31, 32, 34, 35, 38]):
        held = solve(problem, start, held_columns(start, np.array(columns)), 30)
        of_points = [np.trace(s.cofactors[first:last, first:last]) for s in (inner, held)]
        assert of_points[0] < of_points[1]


def test_the_s_transformation_gives_the_covariance_of_another_datum() -> None:
    problem, start = network(4)
    solution = free(problem, start)
    columns = np.array([24, 25, 26, 28, 29, 32])
    held = held_columns(solution.unknowns, columns)
    other = solve(problem, solution.unknowns, held, 30)
    s = s_transformation(motion_basis(solution.unknowns), held)
    np.testing.assert_allclose(s @ solution.cofactors @ s.T, other.cofactors, atol=1e-13)


def test_a_datum_that_leaves_a_motion_free_is_refused() -> None:
    problem, start = network(5)
    with pytest.raises(DegenerateGeometryError):
        solve(problem, start, held_columns(start, np.array([24, 25, 26, 27, 28])), 30)
    with pytest.raises(DegenerateGeometryError):
        s_transformation(motion_basis(start), np.repeat(held_columns(start, np.array([24])), 6, axis=1))


def test_a_point_that_nobody_measured_is_refused_and_named() -> None:
    problem, start = network(6)
    polar = problem.observations[0]
    unseen = Problem((polar.selected(polar.points != 3),))
    with pytest.raises(DegenerateGeometryError, match="57 of 60 parameters, free: point 3"):
        adjust_network(unseen, start, DatumSelection.of_everything(start))


def test_a_network_without_datum_is_refused_and_its_common_motion_named() -> None:
    problem, start = network(6)
    with pytest.raises(DegenerateGeometryError, match="54 of 60 parameters, free: a common motion"):
        adjust_network(problem, start, None)


@pytest.mark.parametrize("coupled_share", [1.0, 0.0], ids=["sparse", "by blocks"])
def test_normal_equations_of_many_unknowns_agree_with_dense_ones(
    coupled_share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, start = network(7)
    dense = free(problem, start)
    monkeypatch.setattr(solver, "MOST_DENSE", 0)
    monkeypatch.setattr(solver, "COUPLED_SHARE", coupled_share)
    other = free(problem, start)
    np.testing.assert_allclose(other.unknowns.points, dense.unknowns.points, atol=1e-10)
    np.testing.assert_allclose(other.cofactors, dense.cofactors, atol=1e-14)


def test_blocks_of_any_size_are_summed_to_normal_equations() -> None:
    rng = np.random.default_rng(1)
    sizes = np.array([1, 3, 3, 40, 2])
    roots = [rng.normal(size=(d, d)) for d in sizes]
    derivatives = sparse.random_array((int(sizes.sum()), 60), density=0.2, format="csr", rng=rng)
    found = normal_of_blocks(
        sizes, np.concatenate([root.ravel() for root in roots]), derivatives.indptr, derivatives.indices,
        derivatives.data, 60,
    )  # fmt: skip
    white = linalg.block_diag(*roots) @ derivatives.toarray()
    np.testing.assert_allclose(found, white.T @ white, atol=1e-12)


def test_a_step_that_would_overshoot_is_damped() -> None:
    # a point known from three distances, started almost in the plane of the stations, where they hardly tell its height
    stations = RigidTransform.from_components(
        [[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0]], Rotation.identity(3)
    )
    true = np.array([[3.0, 4.0, 2.0]])
    numbers = np.arange(3, dtype=np.int64)
    exact = Polar(
        numbers,
        np.zeros(3, dtype=np.int64),
        np.full(3, PolarComponent.DISTANCE, dtype=np.int32),
        np.zeros(3),
        np.full(3, 1e-3),
    )
    at_truth = Unknowns(stations, true, np.ones(3, dtype=bool), np.zeros(1, dtype=bool))
    problem = Problem((replace(exact, values=exact.equations(at_truth).residuals[:, 0]),))
    start = replace(at_truth, points=np.array([[3.0, 4.0, 0.01]]))
    solution = solve(problem, start, np.zeros((3, 0)), 50)
    assert solution.converged
    np.testing.assert_allclose(solution.unknowns.points, true, atol=1e-8)


@pytest.mark.parametrize("apart", [0.0, 1e-3, 0.1])
def test_lines_of_sight_that_do_not_meet_are_refused_instead_of_followed_to_infinity(apart: float) -> None:
    # directions say less of a point the farther it is, so the sum of squares falls all the way
    stations = RigidTransform.from_components([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0]], Rotation.identity(2))
    sights = Polar(
        np.array([0, 0, 1, 1], dtype=np.int64),
        np.zeros(4, dtype=np.int64),
        np.tile(np.array([PolarComponent.HORIZONTAL, PolarComponent.ZENITH], dtype=np.int32), 2),
        0.5 * np.array([np.pi + apart, np.pi, np.pi - apart, np.pi]),
        np.full(4, 1e-4),
    )
    start = Unknowns(stations, np.array([[5.0, 20.0, 0.01]]), np.ones(2, dtype=bool), np.zeros(1, dtype=bool))
    with pytest.raises(
        DegenerateGeometryError, match=r"2 of 3 parameters, free: .* along which the adjustment runs away"
    ):
        solve(Problem((sights,)), start, np.zeros((3, 0)), 60)


def test_two_targets_and_the_vertical_determine_a_pose_that_neither_does_alone() -> None:
    coordinates = np.array([[3.0, 1.0, 0.5], [-2.0, 4.0, 1.5]])
    # a levelled pair: the vertical of both instruments is the z axis
    pose = RigidTransform.from_components(POSE.translation, Rotation.from_euler("z", 1.9))
    targets = PointPoint(
        PointSet.with_std(pose.apply(coordinates), 0.001), PointSet.with_std(coordinates, 0.001), all_pairs(2)
    )
    level = Levelling.of_levelled(5e-5, 5e-5)
    start = Unknowns.of_pair(RigidTransform.from_components([3.9, -0.9, 0.1], Rotation.from_euler("z", 1.8)))
    with pytest.raises(DegenerateGeometryError):
        solve(Problem((level,)), start, np.zeros((6, 0)), 30)
    together = solve(Problem((targets, level)), start, np.zeros((6, 0)), 30)
    assert together.redundancy == 6 + 2 - 6
    np.testing.assert_allclose(together.pose.as_matrix(), pose.as_matrix(), atol=1e-9)
    stds = np.sqrt(np.diag(together.cofactors))
    assert stds[:2].max() < 1e-4  # rad: what the inclinometers give, sqrt(2) 5e-5


def test_three_stations_with_a_closed_loop_are_better_known_than_a_chain() -> None:
    rng = np.random.default_rng(8)
    poses = [RigidTransform.identity(), POSE, POSE * POSE]
    world = rng.uniform(-5.0, 5.0, (10, 3))
    seen = [PointSet.with_std(p.inv().apply(world) + 0.002 * rng.normal(size=(10, 3)), 0.002) for p in poses]
    edges = {(i, j): PointPoint(seen[i], seen[j], all_pairs(10), i, j) for i, j in ((0, 1), (1, 2), (0, 2))}
    start = Unknowns(
        RigidTransform.concatenate(poses), np.empty((0, 3)), np.array([True, False, False]), np.zeros(0, dtype=bool)
    )
    chain = solve(Problem((edges[0, 1], edges[1, 2])), start, np.zeros((12, 0)), 30)
    loop = solve(Problem(tuple(edges.values())), start, np.zeros((12, 0)), 30)
    assert loop.redundancy == chain.redundancy + 30
    assert np.trace(loop.cofactors[9:, 9:]) < np.trace(chain.cofactors[9:, 9:])


def test_the_weight_factor_is_a_quarter_at_its_half_width_and_as_steep_as_asked() -> None:
    distances, h, slant = np.array([0.0, 4.0]), 4.0, 2.0
    np.testing.assert_allclose(weight_factor(distances, h), [1.0, 0.25])
    by_step = (weight_factor(np.array([h + 1e-6]), h, slant) - weight_factor(np.array([h - 1e-6]), h, slant)) / 2e-6
    np.testing.assert_allclose(by_step, -1.0 / slant, rtol=1e-6)


def test_robust_weights_mark_all_gross_errors_and_hardly_a_good_observation() -> None:
    problem, start = network(9)
    polar = problem.observations[0]
    wrong = np.zeros(len(polar))
    wrong[[5, 40, 77, 100]] = [30.0, -15.0, 60.0, 12.0]
    result = robust_adjustment(Problem((replace(polar, values=polar.values + wrong * polar.stds),)), start, free)
    assert result.marked[[5, 40, 77, 100]].all()
    # the last half width is 3: of 140 good observations 0.4 lie beyond it; single tests bring them back
    assert result.marked.sum() <= 6
    assert result.half_widths[-2:] == (4.0, 3.0)
    assert list(result.half_widths) == sorted(result.half_widths, reverse=True)


def test_variance_components_need_a_group_for_every_observation() -> None:
    problem, start = network(10)
    with pytest.raises(InvalidInputError, match="groups"):
        estimate_variance_components(problem, np.zeros(3, dtype=np.int64), start, free)


def test_a_group_without_enough_redundancy_keeps_its_a_priori_standard_deviation() -> None:
    problem, start = network(11)
    groups = np.zeros(len(problem), dtype=np.int64)
    groups[:5] = 1
    components = estimate_variance_components(problem, groups, start, free)
    assert components.estimated.tolist() == [1.0, 0.0]
    assert components.factors[1] == 1.0
