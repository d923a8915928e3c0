"""Derivatives of every observation of a hybrid network against differences; laws of the sparse solver."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse
from scipy.spatial.transform import Rotation

from algorithms.adjustment.hybrid.congruence import congruence
from algorithms.adjustment.hybrid.datum import common_motions, defect_of
from algorithms.adjustment.hybrid.estimation import estimate
from algorithms.adjustment.hybrid.image_equations import ImageObservations
from algorithms.adjustment.hybrid.joint_poses import JointPoses
from algorithms.adjustment.hybrid.network import Network
from algorithms.adjustment.hybrid.observations import Observations, variances
from algorithms.adjustment.hybrid.point_equations import (
    Control,
    Differences,
    Distances,
    HeightDifferences,
    InPlane,
    ObservedUnknowns,
    OnLine,
)
from algorithms.adjustment.hybrid.reliability import object_test, observation_tests
from algorithms.adjustment.hybrid.scanner_equations import PolarObservations, StationCoordinates, Tilts
from algorithms.adjustment.hybrid.sparse_factor import Factor, Ordering
from algorithms.adjustment.hybrid.state import SIZES, Kind, Layout, State
from algorithms.errors import InvalidInputError


def some_state(seed: int = 1) -> State:
    rng = np.random.default_rng(seed)

    def turns(n: int) -> np.ndarray:
        return Rotation.random(n, rng=rng).as_matrix()

    def directions(n: int) -> np.ndarray:
        vectors = rng.normal(size=(n, 3))
        return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)

    cameras = np.zeros((1, 10))
    cameras[0] = [3000.0, 12.0, -7.0, 2e-9, -3e-16, 1e-23, 3e-7, -2e-7, 1e-4, -2e-4]
    return State(
        points=rng.uniform(-5.0, 5.0, (6, 3)),
        rotations=turns(2),
        positions=rng.uniform(-20.0, 20.0, (2, 3)),
        cameras=cameras,
        mount_rotations=np.concatenate([np.eye(3)[None], turns(1)]),
        mount_positions=np.array([[0.0, 0.0, 0.0], [0.1, -0.2, 0.3]]),
        scanners=np.array([[0.0, 0.0, 0.0, 0.0], [0.01, 2e-4, -1e-4, 3e-4]]),
        normals=directions(1),
        offsets=np.array([0.7]),
        directions=directions(1),
        anchors=rng.uniform(-1.0, 1.0, (1, 3)),
    )


def on_the_line(state: State) -> State:
    """Where points miss a line, the misfits turn with its basis, of which the derivatives know nothing."""
    points = state.anchors + np.linspace(-2.0, 3.0, 6)[:, None] * state.directions
    return replace(state, points=points)


def ints(*values: int) -> np.ndarray:
    return np.array(values, dtype=np.int64)


def covariances(n: int, size: int) -> np.ndarray:
    return np.tile(np.eye(size), (n, 1, 1))


POINTS = ints(0, 1, 2, 3, 4, 5)
ZEROS, HALF = np.zeros(6), ints(0, 1, 0, 1, 0, 1)
EVERY = {
    "polar": PolarObservations(
        variances(np.ones(6)), HALF, POINTS, ints(0, 0, 1, 1, 2, 2), np.full(6, 0.3), HALF, np.full(6, 0.1)
    ),
    "coordinates": StationCoordinates(covariances(6, 3), HALF, POINTS, np.zeros((6, 3))),
    "tilts": Tilts(variances(np.ones(2)), ints(0, 1), ints(0, 1), np.zeros(2)),
    "image": ImageObservations(
        variances(np.ones(6)), HALF, ints(0, 0, 0, 1, 1, 1), np.zeros(6, dtype=np.int64), POINTS, HALF,
        np.full((6, 2), 300.0), np.array([True, False] * 3),
    ),
    "control": Control(covariances(6, 3), POINTS, np.zeros((6, 3))),
    "joint poses": JointPoses(
        covariances(1, 6), 0, ints(1), Rotation.from_rotvec([[0.3, -0.2, 0.4]]).as_matrix(), np.array([[1.0, 2.0, 3.0]])
    ),
    "differences": Differences(covariances(3, 3), ints(0, 1, 2), ints(3, 4, 5), np.zeros((3, 3))),
    "distances": Distances(variances(np.ones(3)), ints(0, 1, 2), ints(3, 4, 5), np.ones(3), np.arange(3) == 0),
    "heights": HeightDifferences(variances(np.ones(3)), ints(0, 1, 2), ints(3, 4, 5), np.ones(3)),
    "plane": InPlane(variances(np.ones(6)), np.zeros(6, dtype=np.int64), POINTS),
    "line": OnLine(covariances(6, 2), np.zeros(6, dtype=np.int64), POINTS),
    "pose values": ObservedUnknowns(variances(np.ones(9)), Kind.POSE, ints(*[1] * 9), np.arange(9), np.zeros(9)),
    "mount values": ObservedUnknowns(variances(np.ones(9)), Kind.MOUNT, ints(*[1] * 9), np.arange(9), np.zeros(9)),
    "camera values": ObservedUnknowns(variances(np.ones(2)), Kind.CAMERA, ints(0, 0), ints(0, 4), np.zeros(2)),
    "scanner values": ObservedUnknowns(variances(np.ones(1)), Kind.SCANNER, ints(1), ints(2), np.zeros(1)),
    "point values": ObservedUnknowns(variances(np.ones(2)), Kind.POINT, ints(0, 3), ints(1, 2), np.zeros(2)),
}  # fmt: skip


def everything_free(state: State, at_points: np.ndarray | None = None) -> Layout:
    free = {kind: np.ones((state.count(kind), SIZES[kind]), dtype=bool) for kind in Kind}
    free[Kind.MOUNT][0] = False
    free[Kind.SCANNER][0] = False
    return Layout.of(free, np.full(len(state.positions), -1, dtype=np.int64) if at_points is None else at_points)


@pytest.mark.parametrize("name", EVERY)
def test_derivatives_agree_with_differences(name: str) -> None:
    state = on_the_line(some_state()) if name == "line" else some_state()
    layout = everything_free(state)
    network = Network((EVERY[name],), layout)
    analytic = network.linearised(state).jacobian.toarray()
    # parameters differ in size by many powers of ten: steps follow the columns
    sizes = np.linalg.norm(analytic, axis=0)
    for column in np.flatnonzero(sizes > 0.0):
        step = np.zeros(layout.count)
        step[column] = 1e-4 / max(sizes[column], 1.0) * max(1.0, 1.0 / sizes[column])
        plus, minus = (network.linearised(state.moved(layout, sign * step)).residuals for sign in (1.0, -1.0))
        np.testing.assert_allclose(
            (plus - minus) / (2.0 * step[column]), analytic[:, column], atol=2e-5 * sizes[column] + 1e-9
        )


@pytest.mark.parametrize(
    "name", ["polar", "coordinates", "joint poses", "image", "differences", "distances", "plane", "line"]
)
def test_a_common_motion_changes_no_observation(name: str) -> None:
    state = on_the_line(some_state()) if name == "line" else some_state()
    state = replace(state, scanners=np.zeros_like(state.scanners))
    part = EVERY[name]
    if isinstance(part, PolarObservations):
        part = replace(part, heights=np.zeros(6))
    if isinstance(part, Distances):
        part = replace(part, flat=np.zeros(3, dtype=bool))
    network = Network((part,), everything_free(state))
    linearised = network.linearised(state)
    motions = (
        common_motions(network.layout, state)[:, :3]
        if name == "differences"
        else (common_motions(network.layout, state)[:, :6])
    )
    scale = np.abs(linearised.jacobian.toarray()).max()
    np.testing.assert_allclose(linearised.jacobian @ motions, 0.0, atol=1e-10 * scale)
    if name == "image":
        np.testing.assert_allclose(linearised.jacobian @ common_motions(network.layout, state), 0.0, atol=1e-9 * scale)


def test_selected_inverse_and_solutions_are_those_of_the_dense_matrix() -> None:
    rng = np.random.default_rng(5)
    jacobian = sparse.csr_array(sparse.random_array((400, 90), density=0.04, rng=rng, format="csr"))
    weights = rng.uniform(0.1, 1.0, 400)
    weights[:80] = 0.0  # observations that are left out keep their place in the pattern
    dense = jacobian.toarray()
    inverse = np.linalg.inv(dense.T @ (weights[:, None] * dense))
    factor = Factor(jacobian, weights, Ordering.of(jacobian))
    first, second = (part.astype(np.int64) for part in (jacobian.T @ jacobian).nonzero())
    np.testing.assert_allclose(factor.elements(first, second), inverse[first, second], rtol=1e-9, atol=1e-11)
    rows = np.arange(400, dtype=np.int64)
    np.testing.assert_allclose(
        factor.row_products(jacobian, rows, rows), np.einsum("ij,jk,ik->i", dense, inverse, dense), rtol=1e-9
    )
    right = rng.normal(size=(90, 3))
    np.testing.assert_allclose(factor.solved(right), inverse @ right, rtol=1e-8, atol=1e-10)
    assert not factor.helped.any()


def test_derivatives_of_another_pattern_than_the_ordered_one_are_refused() -> None:
    ordering = Ordering.of(sparse.csr_array(np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 1.0]])))
    with pytest.raises(InvalidInputError, match="pattern"):
        Factor(sparse.csr_array(np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0]])), np.ones(2), ordering)


def test_a_zero_pivot_is_answered_by_a_fictitious_observation_and_named() -> None:
    jacobian = sparse.csr_array(np.array([[1.0, 1.0, 0.0], [2.0, 2.0, 0.0], [0.0, 0.0, 1.0]]))
    factor = Factor(jacobian, np.ones(3), Ordering.of(jacobian))
    assert factor.helped.sum() == 1
    assert factor.helped[:2].any()
    np.testing.assert_allclose(factor.solved(np.array([5.0, 5.0, 2.0]))[:2].sum(), 1.0)


def levelling(seed: int) -> tuple[Network, State]:
    """Height differences in a square with both diagonals: the heights themselves are free."""
    rng = np.random.default_rng(seed)
    ends = np.array([[0, 1], [1, 2], [2, 3], [3, 0], [0, 2], [1, 3]], dtype=np.int64)
    heights = np.array([0.0, 1.0, 3.0, 2.0])
    values = heights[ends[:, 1]] - heights[ends[:, 0]] + 0.001 * rng.normal(size=6)
    state = replace(some_state(), points=np.column_stack([np.arange(4.0), np.arange(4.0) ** 2, heights]))
    free = {kind: np.zeros((state.count(kind), SIZES[kind]), dtype=bool) for kind in Kind}
    free[Kind.POINT][:, 2] = True
    layout = Layout.of(free, np.array([-1, -1], dtype=np.int64))
    observed = HeightDifferences(variances(np.full(6, 0.001)), ends[:, 0].copy(), ends[:, 1].copy(), values)
    return Network((observed,), layout), state


def test_the_free_motion_of_a_levelling_network_is_the_shift_of_all_heights() -> None:
    network, state = levelling(1)
    defect = defect_of(network, network.linearised(state), np.ones(6), state)
    assert defect.named() == ("translation along Z",)
    found = estimate(network, state, np.ones(6), 10)
    assert found.converged
    assert found.redundancy == 3
    assert len(found.fictitious) == 0
    tests = observation_tests(network, found, np.ones(6), 0.001, 0.8)
    np.testing.assert_allclose(tests.redundancy, 0.5)  # the same for all by symmetry


def test_vectors_held_to_a_micrometre_over_kilometres_leave_nothing_but_rounding_and_that_counts_as_settled() -> None:
    rng = np.random.default_rng(7)
    state = replace(some_state(), points=rng.uniform(-1e4, 1e4, (6, 3)))
    free = {kind: np.zeros((state.count(kind), SIZES[kind]), dtype=bool) for kind in Kind}
    free[Kind.POINT][1:] = True
    ends = ints(0, 1, 2, 3, 4, 0, 1), ints(1, 2, 3, 4, 5, 3, 5)
    gaps = state.points[ends[1]] - state.points[ends[0]]
    lengths = np.linalg.norm(gaps, axis=1) + rng.normal(scale=0.005, size=7)
    network = Network(
        (
            Differences(np.tile(1e-12 * np.eye(3), (7, 1, 1)), *ends, gaps + rng.normal(scale=1e-6, size=(7, 3))),
            Distances(variances(np.full(7, 0.005)), *ends, lengths, np.zeros(7, dtype=bool)),
        ),
        Layout.of(free, np.array([-1, -1], dtype=np.int64)),
    )
    found = estimate(network, state, np.ones(28), 20)
    assert found.converged
    assert found.iterations < 10


def test_the_test_of_an_object_is_the_drop_of_the_squares_without_it() -> None:
    network, state = levelling(2)
    found = estimate(network, state, np.ones(6), 10)
    left_out = np.array([1.0, 0.0, 1.0, 1.0, 0.0, 1.0])
    without = estimate(network, state, left_out, 10)
    test = object_test(found, ints(1, 4), np.ones(6))
    assert test is not None
    assert test.degrees_of_freedom == 2
    np.testing.assert_allclose(test.statistic, found.omega - without.omega, rtol=1e-6)


def test_standardised_residuals_of_correlated_observations_have_a_unit_variance() -> None:
    covariance = np.array([[4.0, 1.5, 0.0], [1.5, 2.0, -0.5], [0.0, -0.5, 1.0]]) * 1e-6
    root = np.linalg.cholesky(covariance)
    rng, values, statistics = np.random.default_rng(3), [], []
    state = some_state()
    free = {kind: np.zeros((state.count(kind), SIZES[kind]), dtype=bool) for kind in Kind}
    free[Kind.POINT][:3] = True
    layout = Layout.of(free, np.array([-1, -1], dtype=np.int64))
    ends = ints(0, 1, 2, 0, 1, 2), ints(3, 4, 5, 4, 5, 3)
    true = state.points[ends[1]] - state.points[ends[0]]
    for _ in range(60):
        noise = rng.normal(size=(6, 3)) @ root.T
        network = Network((Differences(np.tile(covariance, (6, 1, 1)), *ends, true + noise),), layout)
        found = estimate(network, state, np.ones(18), 5)
        tests = observation_tests(network, found, np.ones(18), 0.001, 0.8)
        np.testing.assert_allclose(tests.redundancy.sum(), found.redundancy)
        values.append(tests.w)
        statistics.append(tests.statistics)
    assert np.mean(np.square(values)) == pytest.approx(1.0, abs=0.15)
    assert np.mean(statistics) == pytest.approx(3.0, abs=0.45)


def test_one_moved_point_among_twelve_is_found_and_the_others_are_congruent() -> None:
    rng = np.random.default_rng(4)
    points = rng.uniform(-10.0, 10.0, (12, 3))
    differences = 0.002 * rng.normal(size=(12, 3))
    differences[7] += [0.02, 0.0, -0.01]
    basis = np.concatenate([np.tile(np.eye(3), (12, 1)), np.concatenate([np.cross(np.eye(3), p).T for p in points])], 1)
    moved = (np.linalg.qr(basis)[0] @ rng.normal(size=6)).reshape(12, 3)  # another datum of the second epoch
    test = congruence(differences + 0.01 * moved, 0.002**2 * np.eye(36), np.linalg.qr(basis)[0], 0.001)
    assert test.order == (7,)
    assert np.abs(test.displacements[7] - [0.02, 0.0, -0.01]).max() < 0.01


def test_the_same_point_seen_by_all_types_is_the_one_that_made_the_observations() -> None:
    state = some_state(9)
    network = Network((EVERY["polar"], EVERY["image"]), everything_free(state))
    first = network.linearised(state)
    parts: list[Observations] = []
    for part, residuals in zip(network.observations, np.split(first.raw_residuals, [len(EVERY["polar"])]), strict=True):
        if isinstance(part, PolarObservations):
            parts.append(replace(part, values=part.values + residuals))
    again = Network(tuple(parts), network.layout).linearised(state)
    np.testing.assert_allclose(again.residuals, 0.0, atol=1e-12)
