"""What a hybrid network leaves free of its frame, and how that is fixed afterwards (MATH 6.2)."""

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from algorithms.adjustment.hybrid.network import Linearised, Network
from algorithms.adjustment.hybrid.scanner_equations import azk_and_rates, opk_and_rates
from algorithms.adjustment.hybrid.sparse_factor import Factor
from algorithms.adjustment.hybrid.state import Kind, Layout, State
from algorithms.arrays import Array
from algorithms.errors import DegenerateGeometryError
from algorithms.geometry.lines import bases_of
from algorithms.geometry.rotations import cross_matrices

MOTIONS = (
    "translation along X", "translation along Y", "translation along Z",
    "rotation about X", "rotation about Y", "rotation about Z", "scale",
)  # fmt: skip
FREE_SHARE = 1e-9
"""A common motion changes no observation when its effect is below this share of what its parts alone have."""
LEAST_CROSSING = 1e-12
"""Conditions whose smallest singular value against the free motions is below this share hold them not."""


def common_motions(layout: Layout, state: State) -> Array:
    """Give how the unknowns change with common translations, rotations and scale, (u, 7) (MATH 6.2)."""
    basis = np.zeros((layout.count + 1, 7))  # the last row takes what is constant

    def put(kind: Kind, part: slice, values: Array) -> None:
        basis[layout.columns[kind][:, part]] = values

    back = np.swapaxes(state.rotations, 1, 2)
    put(Kind.POSE, slice(0, 3), _padded(turns=back))
    put(Kind.POSE, slice(3, 6), _of_places(state.positions))
    put(Kind.MOUNT, slice(3, 6), _padded(scales=state.mount_positions))
    put(Kind.POINT, slice(0, 3), _of_places(state.points))
    if len(state.normals):
        across = np.swapaxes(bases_of(state.normals), 1, 2)
        put(Kind.PLANE, slice(0, 2), _padded(turns=-across @ cross_matrices(state.normals)))
        offsets = np.zeros((len(state.normals), 1, 7))
        offsets[:, 0, :3], offsets[:, 0, 6] = state.normals, state.offsets
        put(Kind.PLANE, slice(2, 3), offsets)
    if len(state.directions):
        across = np.swapaxes(bases_of(state.directions), 1, 2)
        put(Kind.LINE, slice(0, 2), _padded(turns=-across @ cross_matrices(state.directions)))
        put(Kind.LINE, slice(2, 4), across @ _of_places(state.anchors))
    return basis[:-1]


def _padded(turns: Array | None = None, scales: Array | None = None) -> Array:
    given = turns if turns is not None else scales
    if given is None:
        raise AssertionError
    values = np.zeros((len(given), given.shape[1], 7))
    if turns is not None:
        values[:, :, 3:6] = turns
    if scales is not None:
        values[:, :, 6] = scales
    return values


def _of_places(places: Array) -> Array:
    values = np.zeros((len(places), 3, 7))
    values[:, :, :3] = np.eye(3)
    values[:, :, 3:6] = -cross_matrices(places)
    values[:, :, 6] = places
    return values


@dataclass(frozen=True, eq=False)
class Defect:
    """Common motions that no observation sees."""

    basis: Array
    """(u, d) orthonormal combinations of `common_motions`, in units of N's diagonal; d = 0: none is free."""
    combinations: Array
    """(7, d) of which motions they consist."""
    columns: Array
    """(d,) unknowns that may be held instead."""

    @property
    def count(self) -> int:
        """Number of free motions (MATH 6.2)."""
        return int(self.basis.shape[1])

    def named(self) -> tuple[str, ...]:
        """Say which motions are free (MATH 6.2)."""
        if self.count == 0:
            return ()
        rows = linalg.qr(self.combinations.T, pivoting=True)[2][: self.count]
        return tuple(MOTIONS[k] for k in sorted(rows))


def defect_of(network: Network, linearised: Linearised, weights: Array, state: State) -> Defect:
    """Find the common motions that change no observation, and unknowns that hold them well (MATH 6.2).

    Parameters
    ----------
    network
        Observations and columns.
    linearised
        Their derivatives.
    weights
        (m,) of the rows.
    state
        Where they were taken.
    """
    motions = common_motions(network.layout, state)
    # a form is the same wherever it is; its linearisation at a misfit is not quite
    forms = np.repeat([each.is_form for each in network.observations], [len(e) * e.size for e in network.observations])
    roots = np.where(forms, 0.0, np.sqrt(weights))
    jacobian = linearised.jacobian
    sizes = np.sqrt(np.asarray(jacobian.multiply(jacobian).T @ weights))
    scaled = sizes[:, None] * motions
    lengths = np.linalg.norm(scaled, axis=0)
    there = lengths > 0.0
    if not there.any():
        return Defect(np.zeros((len(motions), 0)), np.zeros((7, 0)), np.zeros(0, dtype=np.int64))
    motions = motions[:, there] / lengths[there]
    scaled = scaled[:, there] / lengths[there]
    effect = roots[:, None] * (jacobian @ motions)
    own_values, own_vectors = np.linalg.eigh(scaled.T @ scaled)
    independent = own_values > 1e-12 * own_values[-1]
    whiten = own_vectors[:, independent] / np.sqrt(own_values[independent])
    # singular values, not eigenvalues of the square: those would drown in rounding
    _, values, rows = np.linalg.svd(np.linalg.qr(effect @ whiten, mode="r"))
    values = np.concatenate([values, np.zeros(len(rows) - len(values))])
    chosen = whiten @ rows[values < FREE_SHARE].T
    combinations = np.zeros((7, chosen.shape[1]))
    combinations[there] = chosen / lengths[there][:, None]
    basis = motions @ chosen
    if chosen.shape[1] == 0:
        return Defect(basis, combinations, np.zeros(0, dtype=np.int64))
    columns = linalg.qr((sizes[:, None] * basis).T, pivoting=True, mode="economic")[2][: chosen.shape[1]]
    return Defect(basis, combinations, np.asarray(columns, dtype=np.int64))


@dataclass(frozen=True, eq=False)
class DatumUnknowns:
    """Unknowns that carry the datum of a free network: the trace of their covariance is smallest."""

    points: Array
    """(n, 3) coordinates of points."""
    positions: Array
    """(p, 3) coordinates of stations."""
    angles: Array
    """(p,) all three angles of stations, a radian counting as a metre."""


def free_conditions(layout: Layout, state: State, chosen: DatumUnknowns, photos: Array, motions: Array) -> Array:
    """Give the columns F = E B of the conditions Fᵀ dx = 0 of a free network (MATH 6.2).

    Parameters
    ----------
    layout
        Columns.
    state
        Where the motions were taken.
    chosen
        What carries the datum.
    photos
        (p,) stations whose angles are α, ζ, κ; of the others ω, φ, κ.
    motions
        (u, d) free motions.
    """
    conditions = np.zeros_like(motions)
    for kind, mask, part in ((Kind.POINT, chosen.points, slice(0, 3)), (Kind.POSE, chosen.positions, slice(3, 6))):
        columns = layout.columns[kind][:, part]
        taken = columns[mask & (columns >= 0)]
        conditions[taken] = motions[taken]
    rates = np.where(photos[:, None, None], azk_and_rates(state.rotations)[1], opk_and_rates(state.rotations)[1])
    columns = layout.columns[Kind.POSE][:, :3]
    for k in np.flatnonzero(chosen.angles & (columns >= 0).all(axis=1)):
        conditions[columns[k]] = rates[k].T @ (rates[k] @ motions[columns[k]])
    return conditions


@dataclass(frozen=True, eq=False)
class Cofactors:
    """Q in a datum, element by element: S Q Sᵀ with S = I - B (FᵀB)⁻¹ Fᵀ (MATH 6.2; Baarda)."""

    factor: Factor
    """Normal equations under any conditions that hold the free motions."""
    moving: Array
    """(u, d) B (FᵀB)⁻¹."""
    conditions: Array
    """(u, d) F."""
    crossed: Array
    """(u, d) Q F."""
    inner: Array
    """(d, d) Fᵀ Q F."""

    @staticmethod
    def of(factor: Factor, basis: Array, conditions: Array) -> "Cofactors":
        """Carry Q into the datum Fᵀ dx = 0 (MATH 6.2).

        Raises
        ------
        DegenerateGeometryError
            The conditions do not hold every free motion.
        """
        u, d = basis.shape
        if d == 0:
            empty = np.zeros((u, 0))
            return Cofactors(factor, empty, empty, empty, np.zeros((0, 0)))
        crossing = conditions.T @ basis
        lengths = np.linalg.norm(conditions, axis=0)
        values = linalg.svdvals(crossing / np.where(lengths > 0.0, lengths, 1.0)[:, None])
        if not (lengths > 0.0).all() or values[-1] < LEAST_CROSSING * values[0]:
            raise DegenerateGeometryError(
                u - 1, ("a common motion that the chosen datum does not hold",),
                advice="let more coordinates, or others, carry the datum", parameters=u,
            )  # fmt: skip
        crossed = factor.solved(conditions)
        moving = np.linalg.solve(crossing.T, basis.T).T
        return Cofactors(factor, moving, conditions, crossed, conditions.T @ crossed)

    def elements(self, first: Array, second: Array) -> Array:
        """Give elements of Q whose unknowns meet in an observation (MATH 6.2)."""
        found = self.factor.elements(first, second)
        if self.moving.shape[1] == 0:
            return found
        # inner is symmetric: half of it goes to either side
        halved = self.crossed - 0.5 * (self.moving @ self.inner)
        found = found - np.einsum("...i,...i->...", self.moving[first], halved[second])
        return np.asarray(found - np.einsum("...i,...i->...", halved[first], self.moving[second]))

    def blocks(self, columns: Array) -> Array:
        """Give (n, k, k) covariances of blocks with columns (n, k); 0 where one is constant (MATH 6.2)."""
        free = columns >= 0
        safe = np.maximum(columns, 0)
        first = np.broadcast_to(safe[:, :, None], (*safe.shape, safe.shape[1]))
        both = free[:, :, None] & free[:, None, :]
        found = np.zeros(first.shape)
        found[both] = self.elements(first[both], np.swapaxes(first, 1, 2)[both])
        return found

    def times(self, right: Array) -> Array:
        """Give Q b, (u,) or (u, k), in the datum (MATH 6.2)."""
        if self.moving.shape[1] == 0:
            return self.factor.solved(right)
        inside = right - self.conditions @ (self.moving.T @ right)
        solved = self.factor.solved(inside)
        return np.asarray(solved - self.moving @ (self.conditions.T @ solved))
