"""Leaving out one group after another is solved as by a pseudo-inverse, and what may be singular is left alone."""

import numpy as np

from algorithms.registration.surface_kernels import changes_without


def test_solutions_without_a_group_are_those_of_a_pseudo_inverse() -> None:
    rng = np.random.default_rng(1)
    rows = rng.normal(size=(40, 9, 6))
    own, right = np.einsum("gni,gnj->gij", rows, rows), rng.normal(size=(40, 6))
    whole = own.sum(axis=0)
    changes, solved = changes_without(whole, own, right, 1e-6)
    assert solved.all()
    expected = np.einsum("gij,gj->gi", np.linalg.pinv(whole - own, hermitian=True), right)
    np.testing.assert_allclose(changes, expected, rtol=1e-10, atol=1e-14)


def test_a_group_that_alone_fixes_a_direction_is_left_alone() -> None:
    rng = np.random.default_rng(2)
    rows = rng.normal(size=(10, 9, 6))
    rows[:, :, 2] = 0.0
    rows[4, :, 2] = 1.0
    own = np.einsum("gni,gnj->gij", rows, rows)
    _, solved = changes_without(own.sum(axis=0), own, np.ones((10, 6)), 1e-6)
    assert list(np.flatnonzero(~solved)) == [4]
