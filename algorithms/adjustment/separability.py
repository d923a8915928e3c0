"""Which correspondences the tests cannot tell apart (MATH 4.5)."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.pair_problem import PairProblem
from algorithms.adjustment.problem import LinearSystem
from algorithms.adjustment.weights import whitening_of
from algorithms.arrays import Array, Flags, Matrix

INSEPARABLE = 0.9
"""Above this correlation of two test values either could be the wrong one (MATH 4.5)."""

UNCONTROLLED_SHARE = 1e-10
"""Variance share below which a combination of a block's residuals is not controlled at all."""


@dataclass(frozen=True)
class Partner:
    """A correspondence that may be the wrong one instead."""

    block: int
    """Number of the correspondence: lines first, then planes."""
    correlation: float
    """Largest correlation between a combination of its residuals and one of the other's, 0..1."""


def inseparable_partners(problem: PairProblem, used: Flags, pose: RigidTransform, block: int) -> tuple[Partner, ...]:
    """Find correspondences whose residuals are bound to those of one block (MATH 4.5, blocks instead of components).

    rho = (Qvv)_ij / sqrt(r_i r_j) becomes, for blocks, the largest canonical correlation: the largest singular value of
    S_i^(-1/2) S_ij S_j^(-1/2), S = C - J Q Jᵀ.

    Parameters
    ----------
    problem
        All correspondences.
    used
        (number of blocks,) True for those of the adjustment in question, the block among them.
    pose
        Pose between the problem's frames.
    block
        Number of the correspondence among all.

    Returns
    -------
    Partners with a correlation above `INSEPARABLE`, the most correlated first.
    """
    numbers = np.flatnonzero(used)
    system = problem.selected(used).at(pose)
    jacobian = system.jacobian.toarray()
    cofactors = _cofactors(system)
    place = int(np.flatnonzero(numbers == block)[0])
    mine = np.flatnonzero(system.block_of_row == place)
    crossed = -jacobian[mine] @ cofactors @ jacobian.T
    if system.joint_covariance is not None:
        crossed = crossed + system.joint_covariance[mine]
    roots = _residual_roots(system, cofactors)
    partners, first = [], 0
    for other, root in enumerate(roots):
        rows = slice(first, first + len(root))
        first += len(root)
        if other == place:
            continue
        correlation = float(np.linalg.norm(roots[place] @ crossed[:, rows] @ root.T, ord=2))
        if correlation > INSEPARABLE:
            partners.append(Partner(int(numbers[other]), min(correlation, 1.0)))
    return tuple(sorted(partners, key=lambda partner: -partner.correlation))


def _cofactors(system: LinearSystem) -> Matrix:
    """Give Q = N⁺ after scaling the diagonal of N to one."""
    whitened = whitening_of(system).apply(system.jacobian.toarray())
    scale = 1.0 / np.maximum(np.linalg.norm(whitened, axis=0), np.finfo(np.float64).tiny)
    scaled = whitened * scale
    return np.asarray(np.linalg.pinv(scaled.T @ scaled, rcond=1e-12, hermitian=True) * np.outer(scale, scale))


def _residual_roots(system: LinearSystem, cofactors: Matrix) -> list[Array]:
    """Give for each block a matrix that whitens its residuals after adjustment, uncontrolled parts left out."""
    roots: list[Array] = []
    for blocks, jacobians in zip(system.covariances, system.split(system.jacobian.toarray()), strict=True):
        left = blocks - jacobians @ cofactors @ np.swapaxes(jacobians, 1, 2)
        values, vectors = np.linalg.eigh(left)
        seen = values > UNCONTROLLED_SHARE * np.maximum(values[:, -1:], np.finfo(np.float64).tiny)
        inverse = np.where(seen, 1.0 / np.sqrt(np.where(seen, values, 1.0)), 0.0)
        roots.extend(inverse[:, :, None] * np.swapaxes(vectors, 1, 2))
    return roots
