"""Which edges of photos show which lines of scans, whatever the stated mount says (MATH 2.10).

Lines have many edges beside them, of which one or none is the right one. Rotations are therefore tried on a lattice;
about the best of them three pairs each, which determine a mount, are tried, and what most edges and lines support is
improved by all that fit it.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from algorithms.arrays import Array, Flags, Matrix6
from algorithms.probabilities import chi2_ppf

OUTLIER = float(chi2_ppf(0.999, 2))
"""Pairs that fit worse show different things."""
STEPS = 8
"""Rotations tried on each side of the stated one, about each axis."""
KEPT = 8
"""Rotations from which the mount is improved."""
TRIPLES = 400
"""Mounts tried from three pairs each about a rotation."""
ROUNDS = 8
"""Of reweighting; it has settled before."""
BETTER = 5
"""Of these, so many are improved."""
FAR = 10.0
"""Pairs whose T is so many times beyond the limit have no weight at all."""
CHUNK = 2_000_000
"""Gaps held at once."""


@dataclass(frozen=True, eq=False)
class FoundPlace:
    """The best place of a mount, and how good others are.

    Support is the sum of 1 - T / limit, T of the best partner, where that is positive, over the edges and over the
    lines, halved: neither many edges along one line nor many lines at one edge count as often as there are.
    """

    error: Float64[Array, "6"]
    """(6,) correction of the mount [rad, m]."""
    support: float
    other_support: float
    """Of the best rotation elsewhere."""
    chance: float
    """Mean over all rotations within reach: what edges give that are everywhere."""

    @property
    def rivalry(self) -> float:
        """Give how good the other place is, 0 by chance, 1 as good as this one."""
        return max(self.other_support - self.chance, 0.0) / max(self.support - self.chance, 1e-9)


@dataclass(frozen=True, eq=False)
class EdgeSearch:
    """Pairs of one mount, linearised about the stated one."""

    values: Float64[Array, "n 2"]
    """(n, 2) gaps [px]."""
    by_mount: Float64[Array, "n 2 6"]
    """(n, 2, 6) their derivatives."""
    noise: Float64[Array, "n 2 2"]
    """(n, 2, 2) covariance of each pair's gaps."""
    edges: Int64[Array, "n"]
    """(n,) number of the photo's edge, from 0; each has one line at most."""
    lines: Int64[Array, "n"]
    """(n,) number of the line as one photo shows it, from 0."""
    reach: Float64[Array, "6"]
    """(6,) largest errors of the mount [rad, m]."""

    def best(self) -> FoundPlace:
        """Give the correction of the mount that most edges support."""
        nodes = self._lattice()
        scores = self._scores(nodes, 1.0)
        starts: list[int] = []
        for k in np.argsort(-scores, kind="stable").tolist():
            if all(np.abs(nodes[k] - nodes[j]).max() > 1.5 * self._step for j in starts):
                starts.append(k)
            if len(starts) == KEPT:
                break
        rotations = [np.zeros(3), *(nodes[k] for k in starts)]
        found = [self._about(np.concatenate([rotation, np.zeros(3)])) for rotation in rotations]
        supports = [self.support(error) for error in found]
        first = int(np.argmax(supports))
        apart = [np.abs(error[:3] - found[first][:3]).max() > 0.5 * self._step for error in found]
        other = max((support for support, far in zip(supports, apart, strict=True) if far), default=0.0)
        return FoundPlace(found[first], supports[first], other, float(self._scores(nodes, 0.0).mean()))

    def misfits(self, error: Array, weights: Array) -> Float64[Array, "n"]:
        """Give T of each pair with the mount corrected by an error."""
        left = self.values + self.by_mount @ error
        return np.asarray(np.einsum("ni,nij,nj->n", left, weights, left))

    def support(self, error: Array) -> float:
        """Give how many edges have a line with the mount corrected by an error."""
        return float(self._supports(self.misfits(error, np.linalg.inv(self.noise))[:, None])[0])

    @property
    def _step(self) -> float:
        return float(self.reach[:3].max()) / STEPS

    def _lattice(self) -> Float64[Array, "nodes 3"]:
        steps = np.linspace(-1.0, 1.0, 2 * STEPS + 1)
        return np.stack(np.meshgrid(*(steps * each for each in self.reach[:3]), indexing="ij"), axis=-1).reshape(-1, 3)

    def _inflated(self, share: float) -> Float64[Array, "n 2 2"]:
        """Give the weights with what a share of the lattice's step and of unknown shifts may move."""
        spread = np.concatenate([np.full(3, 0.5 * self._step), 0.3 * self.reach[3:]]) * share
        moved = self.by_mount * spread
        return np.asarray(np.linalg.inv(self.noise + moved @ np.swapaxes(moved, 1, 2)))

    def _scores(self, nodes: Float64[Array, "nodes 3"], share: float) -> Float64[Array, "nodes"]:
        whitening = np.swapaxes(np.linalg.cholesky(self._inflated(share)), 1, 2)
        values = np.einsum("nij,nj->ni", whitening, self.values)
        turns = whitening @ self.by_mount[:, :, :3]
        scores = np.zeros(len(nodes))
        size = max(CHUNK // max(len(values), 1), 1)
        for first in range(0, len(nodes), size):
            some = nodes[first : first + size].T
            squares = sum((values[:, i, None] + turns[:, i] @ some) ** 2 for i in range(2))
            scores[first : first + size] = self._supports(np.asarray(squares))
        return scores

    def _supports(self, squares: Float64[Array, "n g"]) -> Float64[Array, "g"]:
        return 0.5 * sum(
            (
                np.maximum(1.0 - np.minimum.reduceat(squares[order], first, axis=0) / OUTLIER, 0.0).sum(axis=0)
                for order, first in (_runs(self.edges), _runs(self.lines))
            ),
            start=np.zeros(squares.shape[1]),
        )

    @property
    def _loose(self) -> Matrix6:
        return np.diag((0.5 * self.reach) ** -2.0)

    def _about(self, error: Float64[Array, "6"]) -> Float64[Array, "6"]:
        """Give the most supported mount of those that three pairs near one determine."""
        near = np.flatnonzero(self.misfits(error, self._inflated(1.0)) < OUTLIER)
        if len(near) == 0:
            return error
        draw = np.random.default_rng(len(near))
        chosen = near[draw.integers(len(near), size=(TRIPLES, 3))]
        weights = np.linalg.inv(self.noise)
        weighted = np.swapaxes(self.by_mount, 1, 2) @ weights
        normals = (weighted @ self.by_mount)[chosen].sum(axis=1) + self._loose
        rights = np.einsum("nij,nj->ni", weighted, self.values)[chosen].sum(axis=1)
        tried = np.concatenate([error[None], -np.linalg.solve(normals, rights[..., None])[..., 0]])
        left = self.values[:, None] + np.einsum("nij,gj->ngi", self.by_mount, tried)
        supports = self._supports(np.einsum("ngi,nij,ngj->ng", left, weights, left))
        order = np.argsort(-supports, kind="stable")[:BETTER]
        improved = [self._improved(tried[k], weights) for k in order.tolist()]
        return max(improved, key=self.support)

    def _improved(self, error: Array, weights: Float64[Array, "n 2 2"]) -> Float64[Array, "6"]:
        best, support = error, self.support(error)
        for _ in range(ROUNDS):
            squares = self.misfits(best, weights)
            shares = np.where(is_best(self.edges, squares), 1.0 / (1.0 + squares / OUTLIER) ** 2, 0.0)
            shares[squares > FAR * OUTLIER] = 0.0
            weighted = shares[:, None, None] * np.swapaxes(self.by_mount, 1, 2) @ weights
            normal = (weighted @ self.by_mount).sum(axis=0) + self._loose
            error = -np.linalg.solve(normal, np.einsum("nij,nj->i", weighted, self.values))
            improved = self.support(error)
            if improved <= support:
                break
            best, support = error, improved
        return np.asarray(best)


def _runs(numbers: Int64[Array, "n"]) -> tuple[Array, Array]:
    """Give an order in which equal numbers stand together, and where each run begins."""
    order = np.argsort(numbers, kind="stable")
    return order, np.unique(numbers[order], return_index=True)[1]


def is_best(edges: Int64[Array, "n"], squares: Float64[Array, "n"]) -> Flags:
    """Tell which pairs fit best of all pairs of their edge."""
    order = np.lexsort((squares, edges))
    best = np.zeros(len(squares), dtype=np.bool_)
    best[order[np.unique(edges[order], return_index=True)[1]]] = True
    return best


def largest_agreement(values: Float64[Array, "k 2"], covariance: Float64[Array, "m m"], limit: float) -> Flags:
    """Tell which of the pairs of one line agree with each other, the most there are.

    Pairs of a line share its errors: each may be far off by itself, but only by as much as the others. From each pair
    in turn a set grows by what it predicts best, given all that it has. The set whose pairs have the most support is
    taken.

    Parameters
    ----------
    values
        (k, 2) gaps [px].
    covariance
        (2 k, 2 k) of all of them together [px²].
    limit
        Of T, beyond which a pair does not agree.
    """
    best, most = np.zeros(len(values), dtype=np.bool_), -np.inf
    for first in range(len(values)):
        agree, support = _grown(first, values.ravel(), covariance, limit)
        if support > most:
            best, most = agree, support
    return best


def _grown(first: int, left: Array, noise: Array, limit: float) -> tuple[Flags, float]:
    """Grow a set from one pair; gaps of the others and their covariance are conditioned on those that it has."""
    rest, agree, support = np.arange(len(left) // 2), np.zeros(len(left) // 2, dtype=np.bool_), 0.0
    while len(rest):
        places = np.arange(len(rest))
        own, gaps = noise.reshape(len(rest), 2, len(rest), 2)[places, :, places], left.reshape(-1, 2, 1)
        squares = (gaps * np.linalg.solve(own, gaps)).sum(axis=(1, 2))
        k = int(np.argmin(squares)) if agree.any() else first
        if squares[k] >= limit:
            break
        agree[rest[k]] = True
        support += limit - float(squares[k])
        both, others = slice(2 * k, 2 * k + 2), np.delete(np.arange(len(left)), [2 * k, 2 * k + 1])
        gains = np.linalg.solve(noise[both, both], noise[both, others]).T
        left, noise = left[others] - gains @ left[both], noise[np.ix_(others, others)] - gains @ noise[both, others]
        rest = np.delete(rest, k)
    return agree, support
