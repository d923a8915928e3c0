"""The adjustment problem: observations, and the covariance they have together (MATH 3.1, 4)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeAlias, TypeVar

import numpy as np
from jaxtyping import Float64
from scipy import sparse

from algorithms.adjustment.observations import Observation
from algorithms.adjustment.observations.linearised import Derivative, Equations, FeatureNoise
from algorithms.adjustment.unknowns import Unknowns
from algorithms.arrays import Array, Scalars
from algorithms.errors import InvalidInputError

This = TypeVar("This", bound="Problem")

TargetPlaneCovariances: TypeAlias = Float64[Array, "target_planes 3 3"]
SourcePlaneCovariances: TypeAlias = Float64[Array, "source_planes 3 3"]


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """All residuals of a problem at one set of unknowns, stacked; m in number, u unknowns (MATH 3.1, 3.3)."""

    residuals: Array
    """(m,) contradictions [rad, m]."""
    jacobian: sparse.csr_array
    """(m, u) derivatives by the free unknowns."""
    private_covariances: tuple[Array, ...]
    """For each observation type (n, d, d): the covariance of each block that it shares with no other."""
    plane_jacobians: Mapping[int, sparse.csr_array]
    """For each station whose planes are shared: (m, 3p) derivatives by their errors (a1, a2, b)."""
    plane_roots: Mapping[int, sparse.csr_array]
    """For each of these stations: (3p, 3p) Cholesky factors of the planes' covariances."""
    photo_factors: Mapping[int, sparse.csr_array] = field(default_factory=dict)
    """For each station with photos: (m, 6q) factor F whose F Fᵀ is the covariance that comes through their mounts."""

    def selected(self, keep: Array) -> "LinearSystem":
        """Keep the blocks for which the mask (number of blocks,) is True."""
        rows = keep[self.block_of_row]
        pieces = np.split(keep, np.cumsum([n for n, _ in self.shapes])[:-1])
        chosen = LinearSystem(
            self.residuals[rows],
            self.jacobian[rows],
            tuple(blocks[piece] for blocks, piece in zip(self.private_covariances, pieces, strict=True)),
            {station: derivatives[rows] for station, derivatives in self.plane_jacobians.items()},
            self.plane_roots,
            {station: factor[rows] for station, factor in self.photo_factors.items()},
        )
        joint = self.joint_covariance
        if joint is not None:  # cut out rather than computed anew
            numbers = np.flatnonzero(rows)
            chosen.__dict__["joint_covariance"] = joint[np.ix_(numbers, numbers)]
        return chosen

    def moved(self, step: Array) -> "LinearSystem":
        """Give the residuals after a small step (u,) of the free unknowns; derivatives and covariances stay."""
        moved = replace(self, residuals=self.residuals + self.jacobian @ step)
        for name in ("dense_jacobian", "joint_covariance", "covariances", "block_of_row"):
            if name in self.__dict__:
                moved.__dict__[name] = self.__dict__[name]
        return moved

    @property
    def blocks_are_independent(self) -> bool:
        """Whether no two blocks share an error."""
        return not self.plane_jacobians and not self.photo_factors

    @cached_property
    def dense_jacobian(self) -> Array:
        """(m, u) derivatives by the free unknowns, zeros written out."""
        return np.asarray(self.jacobian.toarray())

    @cached_property
    def joint_covariance(self) -> Array | None:
        """(m, m) covariance of everything together, possibly singular; None where blocks are independent. O(m²)."""
        if self.blocks_are_independent:
            return None
        joint = np.zeros((len(self.residuals), len(self.residuals)))
        for station, derivatives in self.plane_jacobians.items():
            factor = derivatives @ self.plane_roots[station]
            joint += (factor @ factor.T).toarray()
        for factor in self.photo_factors.values():
            joint += (factor @ factor.T).toarray()
        for places, blocks in zip(self._rows_of_blocks, self.private_covariances, strict=True):
            joint[places[:, :, None], places[:, None, :]] += blocks
        return joint

    @cached_property
    def covariances(self) -> tuple[Array, ...]:
        """For each observation type (n, d, d): the covariance of each block by itself."""
        joint = self.joint_covariance
        if joint is None:
            return self.private_covariances
        return tuple(joint[places[:, :, None], places[:, None, :]] for places in self._rows_of_blocks)

    @property
    def shapes(self) -> list[tuple[int, int]]:
        """Number n and size d of the blocks of each type, in stacking order."""
        return [(blocks.shape[0], blocks.shape[1]) for blocks in self.private_covariances]

    @property
    def _rows_of_blocks(self) -> list[Array]:
        """Give for each type (n, d) row numbers in the stack."""
        starts = np.cumsum([0, *(n * d for n, d in self.shapes)])
        return [first + np.arange(n * d).reshape(n, d) for first, (n, d) in zip(starts, self.shapes, strict=False)]

    @cached_property
    def block_of_row(self) -> Array:
        """(m,) number of the block each residual belongs to."""
        numbers, first = [], 0
        for n, d in self.shapes:
            numbers.append(np.repeat(np.arange(first, first + n), d))
            first += n
        return np.concatenate(numbers)

    def split(self, stacked: Array) -> list[Array]:
        """Cut something stacked like the residuals, (m, ...), into one (n, d, ...) array for each type."""
        pieces, first = [], 0
        for n, d in self.shapes:
            pieces.append(stacked[first : first + n * d].reshape(n, d, *stacked.shape[1:]))
            first += n * d
        return pieces


@dataclass(frozen=True, eq=False)
class Problem:
    """Observations of poses and points, with their stochastic model (MATH 3.1, 3.3)."""

    observations: Sequence[Observation]
    """One or several entries of each type; blocks are numbered through in this order."""
    plane_covariances: Mapping[int, Array] = field(default_factory=dict)
    """For each station the (p, 3, 3) covariances of the planes that its features depend on, (a1, a2, b) of
    `Planes.covariances`. Features of a station that is not named here are treated as independent."""
    photo_covariances: Mapping[int, Array] = field(default_factory=dict)
    """For each station the (q, 6, 6) covariances of its photos' mounts (rotation vector, translation; MATH 2.5). All
    lines seen in a photo share its mount's error, which therefore does not vanish by averaging."""
    photo_additions: Mapping[int, Array] = field(default_factory=dict)
    """For each of these stations (q, 6, 6) what mounts turned out to be worse than stated, which the covariances of
    features do not contain: added to the covariance that their lines share."""
    std_scales: Scalars | None = None
    """(number of blocks,) factors on all standard deviations of a block (groups, robust weights); None: all 1."""

    def __len__(self) -> int:
        return sum(len(observation) for observation in self.observations)

    def selected(self: This, keep: Array) -> This:  # noqa: PYI019 - beartype cannot check Self
        """Keep the blocks for which the mask (number of blocks,) is True."""
        splits = np.cumsum([len(observation) for observation in self.observations])[:-1]
        parts = np.split(keep, splits)
        kept = tuple(part.selected(mask) for part, mask in zip(self.observations, parts, strict=True))
        scales = None if self.std_scales is None else self.std_scales[keep]
        return replace(self, observations=kept, std_scales=scales)

    def scaled(self: This, factors: Array) -> This:  # noqa: PYI019 - beartype cannot check Self
        """Multiply the standard deviations of each block by a factor, (number of blocks,)."""
        scales = factors if self.std_scales is None else self.std_scales * factors
        return replace(self, std_scales=np.asarray(scales, dtype=np.float64))

    def extent_m(self) -> float:
        """Give the largest coordinate that takes part, at least 1 m."""
        return max([1.0, *(part.extent_m() for part in self.observations)])

    def linearised(self, unknowns: Unknowns) -> LinearSystem:
        """Stack residuals, derivatives and covariances at the given values of the unknowns.

        Gauss-Helmert: the covariance of the contradictions is C = B Σ Bᵀ, B their derivatives by what was observed.
        Blocks that depend on the same plane share its error: there B goes through the planes' parameters.
        """
        parts = [part.equations(unknowns) for part in self.observations]
        noises = self._noises
        residuals = np.concatenate([part.residuals.ravel() for part in parts])
        alone = [_alone(part, own) for part, own in zip(parts, self._private_noises, strict=True)]
        jacobian = _jacobian(parts, unknowns, len(residuals))
        by_planes = {
            station: _by_shared(parts, noises, station, 3 * len(covariances), _planes_of)
            for station, covariances in self.plane_covariances.items()
        }
        by_photos = {
            station: _by_shared(parts, noises, station, 6 * len(covariances), _photos_of) @ self._photo_roots[station]
            for station, covariances in self.photo_covariances.items()
            if len(covariances)
        }
        if self.std_scales is not None:
            pieces = np.split(self.std_scales, np.cumsum([len(part) for part in self.observations])[:-1])
            alone = [np.square(piece)[:, None, None] * c for piece, c in zip(pieces, alone, strict=True)]
            by_row = np.concatenate([np.repeat(piece, c.shape[1]) for piece, c in zip(pieces, alone, strict=True)])
            by_planes = {k: sparse.csr_array(by_row[:, None] * derivatives) for k, derivatives in by_planes.items()}
            by_photos = {k: sparse.csr_array(by_row[:, None] * factor) for k, factor in by_photos.items()}
        return LinearSystem(residuals, jacobian, tuple(alone), by_planes, self._plane_roots, by_photos)

    @cached_property
    def _noises(self) -> list[tuple[FeatureNoise, ...]]:
        return [tuple(part.noises()) for part in self.observations]

    @cached_property
    def _plane_roots(self) -> dict[int, sparse.csr_array]:
        return {station: _roots(covariances, "a plane") for station, covariances in self.plane_covariances.items()}

    @cached_property
    def _photo_roots(self) -> dict[int, sparse.csr_array]:
        return {
            station: _roots(covariances + self.photo_additions.get(station, 0.0), "a mount")
            for station, covariances in self.photo_covariances.items()
            if len(covariances)
        }

    @cached_property
    def _private_noises(self) -> list[list[Array]]:
        """Give for each observation the covariances of what shared planes and photos do not explain of its features."""
        planes, photos = self.plane_covariances, self.photo_covariances
        return [
            [_private(noise, planes.get(noise.station), photos.get(noise.station, ())) for noise in noises]
            for noises in self._noises
        ]


def _alone(part: Equations, private_noises: Sequence[Array]) -> Array:
    """Give the covariances (n, d, d) that residuals have from what their features share with no others."""
    n, d = part.residuals.shape
    total = np.zeros((n, d, d))
    for own, factor in zip(private_noises, part.noise_jacobians, strict=True):
        total += factor @ own @ np.swapaxes(factor, 1, 2)
    return total


Shared: TypeAlias = Callable[[FeatureNoise], tuple[Array, Array]]
"""Gives the numbers (n, j) of what features share, -1 in rows that share nothing, and the (n, k, j s) derivatives."""


def _by_shared(
    parts: Sequence[Equations], noises: Sequence[Sequence[FeatureNoise]], station: int, columns: int, shared: Shared
) -> sparse.csr_array:
    """Give the sparse (m, columns) derivatives of all residuals by errors that a station's features share."""
    at_rows, at_columns, values, first = [], [], [], 0
    for part, of_part in zip(parts, noises, strict=True):
        n, d = part.residuals.shape
        for noise, jacobian in zip(of_part, part.noise_jacobians, strict=True):
            if noise.station != station:
                continue
            numbers, derivatives = shared(noise)
            size = derivatives.shape[2] // numbers.shape[1]
            for k in range(numbers.shape[1]):
                used = np.flatnonzero(numbers[:, k] >= 0)
                by_errors = jacobian[used] @ derivatives[used, :, size * k : size * (k + 1)]
                places = numbers[used, k, None] * size + np.arange(size)
                at_rows.append(np.repeat((first + used[:, None] * d + np.arange(d)).ravel(), size))
                at_columns.append(np.repeat(places, d, axis=0).ravel())
                values.append(by_errors.ravel())
        first += n * d
    if not values:
        return sparse.csr_array((first, columns))
    entries = (np.concatenate(values), (np.concatenate(at_rows), np.concatenate(at_columns)))
    return sparse.csr_array(sparse.coo_array(entries, shape=(first, columns)))


def _planes_of(noise: FeatureNoise) -> tuple[Array, Array]:
    return noise.plane_numbers, noise.plane_jacobians


def _photos_of(noise: FeatureNoise) -> tuple[Array, Array]:
    if noise.photo_numbers is None or noise.photo_jacobians is None:
        n, k = noise.total.shape[:2]
        return np.full((n, 1), -1, dtype=np.int64), np.zeros((n, k, 6))
    return noise.photo_numbers, noise.photo_jacobians


def _private(noise: FeatureNoise, planes: Array | None, mounts: Sequence[Array] | Array) -> Array:
    """Give the covariances (n, k, k) of what is not explained by planes and mounts of known covariance.

    Taking a known part from the total leaves what remains of the total. Where all is known on which a feature depends,
    its private covariance itself is taken, which rounding cannot make indefinite.
    """
    own = noise.total.copy()
    all_known = np.ones(len(own), dtype=bool)
    for (numbers, derivatives), covariances in ((_planes_of(noise), planes), (_photos_of(noise), mounts)):
        size = derivatives.shape[2] // numbers.shape[1]
        for k in range(numbers.shape[1]):
            used = np.flatnonzero(numbers[:, k] >= 0)
            if covariances is None or len(covariances) == 0:
                all_known[used] = False
                continue
            by_errors = derivatives[used, :, size * k : size * (k + 1)]
            own[used] -= by_errors @ covariances[numbers[used, k]] @ np.swapaxes(by_errors, 1, 2)
    if noise.private is not None:
        own[all_known] = noise.private[all_known]
    elif planes is not None:
        own[(noise.plane_numbers >= 0).all(axis=1)] = 0.0
    return own


def _roots(covariances: Array, of_what: str) -> sparse.csr_array:
    """Lay the Cholesky factors of (n, s, s) covariances on the diagonal of a sparse matrix."""
    try:
        roots = np.linalg.cholesky(covariances)
    except np.linalg.LinAlgError as error:
        raise InvalidInputError(f"covariance of {of_what}", "it is not positive definite") from error
    n, size = covariances.shape[:2]
    blocks = sparse.bsr_array((roots, np.arange(n), np.arange(n + 1)), shape=(size * n, size * n))
    return sparse.csr_array(blocks)


AnyProblem = TypeVar("AnyProblem", bound=Problem)
"""A problem or one of its special kinds, which stays what it is."""


def _jacobian(parts: Sequence[Equations], unknowns: Unknowns, m: int) -> sparse.csr_array:
    """Lay the derivatives of all blocks into one sparse matrix; those of fixed unknowns are left out."""
    rows, columns, values, first = [], [], [], 0
    for part in parts:
        n, d = part.residuals.shape
        for derivative in part.derivatives:
            at, places, filled = _entries(derivative, unknowns)
            rows.append(
                np.broadcast_to(first + filled[:, None, None] * d + np.arange(d)[:, None], places.shape).ravel()
            )
            columns.append(places.ravel())
            values.append(at.ravel())
        first += n * d
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return sparse.csr_array(sparse.coo_array(entries, shape=(m, unknowns.count)))


def _entries(derivative: Derivative, unknowns: Unknowns) -> tuple[Array, Array, Array]:
    """Give values (k, d, s), columns (k, d, s) and block numbers (k,) of the blocks whose unknowns are free."""
    start = unknowns.first_columns(derivative.kind, derivative.numbers)
    filled = np.flatnonzero(start >= 0)
    values = derivative.jacobians[filled]
    columns = np.broadcast_to(start[filled, None, None] + np.arange(values.shape[2]), values.shape)
    return values, columns, filled
