"""Residuals by blocks along and across strips: errors that the corrections cannot follow (MATH 12.5).

Patches of one second or of one side of a swath share what is wrong with them. A shift of each block is tested as if it
were one more unknown; all of a strip's blocks together tell whether its residuals are those of independent patches.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Int64
from scipy import linalg, sparse

from algorithms.arrays import Array, Matrix
from algorithms.probabilities import chi2_sf
from algorithms.strips.block import Block, Equations, State, positive_solution

PER_BLOCK = 12
"""Wished ties of a block along a strip."""
MOST_BLOCKS = 16
"""Most blocks along a strip."""
SIDES = 3
"""Blocks across a strip."""
CONTROLLED = 0.1
"""Share of the information on the shift of blocks that residuals keep at least, where they tell anything."""
SIGNIFICANCE = 0.01
"""Probability with which independent residuals are called correlated."""


@dataclass(frozen=True)
class BlockTest:
    """Shifts of blocks of residuals against their standard deviations, as if patches were independent."""

    statistic: float
    """Sum of the squares over their variances."""
    degrees: int

    @property
    def factor(self) -> float:
        """Variance of blocks over that of independent patches; 1 where no block is controlled."""
        return self.statistic / self.degrees if self.degrees else 1.0

    @property
    def significant(self) -> bool:
        """Whether residuals of a block have more in common than chance."""
        return self.degrees > 0 and float(chi2_sf(self.statistic, self.degrees)) < SIGNIFICANCE


def along_strips(block: Block, used: Array) -> Int64[Array, "k"]:
    """Assign ties to blocks of equal counts in the order of time; -1: to none."""
    return _numbered(block, used, block.ties.times_s.mean(axis=1), None)


def across_strips(block: Block, used: Array) -> Int64[Array, "k"]:
    """Assign ties to blocks of equal counts from left to right; -1: to none."""
    middles, times, sides = block.ties.anchors_m.mean(axis=1), block.ties.times_s.mean(axis=1), np.zeros(len(used))
    for strip, path in enumerate(block.paths):
        own = block.ties.strips == strip
        sides[own] = (middles[own] - path.centres(times[own])) @ path.axes[:, 1]
    return _numbered(block, used, sides, SIDES)


def block_test(
    block: Block, state: State, at: Equations, weights: Array, control: Array, prior: Matrix, numbers: Array
) -> BlockTest:
    """Test shifts of blocks of ties.

    Parameters
    ----------
    block, state, at
        The adjusted block, and its equations there.
    weights, control
        (k,) and (m,) of ties and control points.
    prior
        (u, u) weights of what is expected of the unknowns.
    numbers
        (k,) block of each tie; -1: none.
    """
    known = np.flatnonzero(numbers >= 0)
    if len(known) == 0:
        return BlockTest(0.0, 0)
    normals = block.frames[block.ties.patches[known]][:, :, 2]
    columns = 3 * numbers[known][:, None] + np.arange(3)
    shifts = sparse.csr_array(
        (normals.ravel(), (np.repeat(3 * known, 3), columns.ravel())),
        shape=(3 * len(numbers), 3 * (int(numbers.max()) + 1)),
    )
    reduced = block.reduced(
        replace(at, jacobian=sparse.csr_array(sparse.hstack([at.jacobian, shifts]))), weights, control
    )
    u = block.count
    mixed, own = reduced.normal[:u, u:], reduced.normal[u:, u:]
    inner = reduced.normal[:u, :u] + prior
    solved = positive_solution(inner, np.column_stack([mixed, reduced.right[:u] - prior @ block.whole_vector(state)]))
    controlled = own - mixed.T @ solved[:, :-1]
    found = reduced.right[u:] - mixed.T @ solved[:, -1]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(own), 1e-12 * float(np.diag(own).max())))
    values, vectors = linalg.eigh(scale[:, None] * controlled * scale)
    told = values > CONTROLLED
    parts = (vectors.T @ (scale * found))[told]
    return BlockTest(float((parts**2 / values[told]).sum()), int(told.sum()))


def _numbered(block: Block, used: Array, order: Array, count: int | None) -> Int64[Array, "k"]:
    numbers, first = np.full(len(used), -1, dtype=np.int64), 0
    for strip in range(len(block.paths)):
        own = np.flatnonzero(used & (block.ties.strips == strip))
        blocks = min(MOST_BLOCKS, len(own) // PER_BLOCK) if count is None else count
        if blocks < 2 or len(own) < 2 * blocks:
            continue
        ranks = np.argsort(np.argsort(order[own], kind="stable"), kind="stable")
        numbers[own] = first + ranks * blocks // len(own)
        first += blocks
    return numbers
