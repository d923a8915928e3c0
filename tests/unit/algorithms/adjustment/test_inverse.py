"""The inverse of normal equations, element by element, is that of the dense matrix."""

import numpy as np
import pytest
from scipy import sparse
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment import inverse, solver
from algorithms.adjustment.inverse import DenseInverse, EnlargedInverse, Information, Inverse
from algorithms.adjustment.observations.relative_poses import RelativePoses
from algorithms.adjustment.problem import Problem
from algorithms.errors import DegenerateGeometryError
from algorithms.network.links import StationLink
from algorithms.network.pose_graph import tree_poses, unknowns_of
from tests.scenes.buildings.station_networks import station_network

COUNT = 40
AROUND = [(k, (k + 1) % COUNT) for k in range(COUNT)]


def ring(rng: np.random.Generator, count: int = COUNT) -> np.ndarray:
    """Give normal equations of blocks of three unknowns in a ring, which are observed with their neighbours only."""
    normal = np.zeros((3 * count, 3 * count))
    for k in range(count):
        columns = np.concatenate([3 * k + np.arange(3), 3 * ((k + 1) % count) + np.arange(3)])
        rows = rng.normal(size=(8, 6)) * [1.0, 10.0, 100.0, 1.0, 10.0, 100.0]
        normal[np.ix_(columns, columns)] += rows.T @ rows
    return normal


@pytest.fixture
def always_sparse(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inverse, "MOST_DENSE", 0)
    monkeypatch.setattr(solver, "MOST_DENSE", 0)


def both(rng: np.random.Generator) -> tuple[Inverse, np.ndarray]:
    normal = ring(rng)
    return Information(sparse.csc_array(normal)).inverse(), np.linalg.inv(normal)


@pytest.mark.usefixtures("always_sparse")
def test_blocks_of_the_selected_inverse_are_those_of_the_dense_one() -> None:
    sparse_inverse, dense = both(np.random.default_rng(1))
    columns = np.array([[3 * a, 3 * a + 1, 3 * b + 2] for a, b in AROUND])
    expected = dense[columns[:, :, None], columns[:, None, :]]
    np.testing.assert_allclose(sparse_inverse.blocks(columns), expected, rtol=1e-9, atol=1e-15)


@pytest.mark.usefixtures("always_sparse")
def test_blocks_of_unknowns_that_meet_nowhere_are_found_by_whole_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inverse, "COLUMNS_AT_ONCE", 7)
    sparse_inverse, dense = both(np.random.default_rng(2))
    columns = np.random.default_rng(3).permuted(np.tile(np.arange(3 * COUNT), (30, 1)), axis=1)[:, :4]
    expected = dense[columns[:, :, None], columns[:, None, :]]
    np.testing.assert_allclose(sparse_inverse.blocks(columns), expected, rtol=1e-9, atol=1e-15)


@pytest.mark.usefixtures("always_sparse")
def test_the_whole_inverse_and_its_products_are_those_of_the_dense_one() -> None:
    sparse_inverse, dense = both(np.random.default_rng(4))
    np.testing.assert_allclose(sparse_inverse.whole(), dense, rtol=1e-9, atol=1e-15)
    right = np.random.default_rng(5).normal(size=(3 * COUNT, 2))
    np.testing.assert_allclose(sparse_inverse.times(right), dense @ right, rtol=1e-9, atol=1e-12)


def test_few_unknowns_are_inverted_as_a_whole() -> None:
    normal = ring(np.random.default_rng(6), 5)
    np.testing.assert_allclose(Information(normal).inverse().whole() @ normal, np.eye(15), atol=1e-11)


def test_what_further_unknowns_add_is_added_to_every_block() -> None:
    rng = np.random.default_rng(7)
    dense, by_others = np.linalg.inv(ring(rng)), rng.normal(size=(3 * COUNT, 2))
    covariance = np.array([[2.0, 0.5], [0.5, 1.0]])
    enlarged = EnlargedInverse(DenseInverse(dense), by_others, covariance)
    expected = dense + by_others @ covariance @ by_others.T
    columns = np.array([[0, 5], [7, 8]])
    np.testing.assert_allclose(enlarged.whole(), expected, rtol=1e-13)
    np.testing.assert_allclose(enlarged.blocks(columns), expected[columns[:, :, None], columns[:, None]], rtol=1e-12)
    np.testing.assert_allclose(enlarged.times(by_others), expected @ by_others, rtol=1e-10)


@pytest.mark.parametrize("most_dense", [0, 300])
def test_a_sum_of_which_one_part_knows_the_first_unknowns_only(
    most_dense: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(inverse, "MOST_DENSE", most_dense)
    rng = np.random.default_rng(8)
    many, few = ring(rng), ring(rng, 10)
    expected = 0.7 * many
    expected[:30, :30] += 0.2 * few
    mixed = Information(sparse.csc_array(many)).mixed(0.7, Information(few), 0.2)
    np.testing.assert_allclose(mixed.dense, expected, rtol=1e-13)


@pytest.mark.usefixtures("always_sparse")
def test_a_matrix_that_is_not_positive_definite_is_refused() -> None:
    normal = ring(np.random.default_rng(9))
    normal[4, 4] = 0.0
    with pytest.raises(np.linalg.LinAlgError, match="not positive definite"):
        Information(sparse.csc_array(normal)).inverse()


@pytest.mark.usefixtures("always_sparse")
@pytest.mark.parametrize("most_decomposed", [0, 1800])
def test_what_is_free_among_many_unknowns_is_found_by_the_factor_too(
    most_decomposed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(solver, "MOST_DECOMPOSED", most_decomposed)
    network = station_network(np.random.default_rng(10), 5)
    links = [link for link in network.links if 4 not in link.stations]
    with pytest.raises(DegenerateGeometryError) as raised:
        adjust_four_of_five(links)
    assert raised.value.rank == 18
    free = raised.value.null_space
    assert free is not None
    assert np.linalg.matrix_rank(free[18:]) == 6
    assert np.abs(free[:18]).max() < 1e-9 * np.abs(free).max()


def adjust_four_of_five(links: list[StationLink]) -> None:
    """Adjust the registrations of four of five stations; the last one is held by nothing."""
    start = tree_poses(links, 0)
    observed = RelativePoses(
        np.array([link.target for link in links]),
        np.array([link.source for link in links]),
        RigidTransform.concatenate([link.target_from_source.target_from_source for link in links]),
        np.array([link.target_from_source.covariance for link in links]),
    )
    unknowns = unknowns_of([*(start[k] for k in range(4)), RigidTransform.identity()])
    solver.solve(Problem((observed,)), unknowns, np.zeros((unknowns.count, 0)), 5)
