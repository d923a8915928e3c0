"""Find out on which motions many small pieces of evidence agree."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Array, Indices, Matrices3, Points, Scalars, Vector3

QUATERNION_BIN = 0.04
"""Edge of the bins that rotations are gathered in before they are clustered (about 4.6 degrees)."""


@dataclass(frozen=True, eq=False)
class Motions:
    """h rigid motions target from source, with the votes each received."""

    rotations: Matrices3
    """(h, 3, 3) rotations."""
    translations_m: Points
    """(h, 3) translations [m]."""
    votes: Scalars
    """(h,) votes."""

    def __len__(self) -> int:
        return len(self.votes)

    def __getitem__(self, which: "Array | slice") -> "Motions":
        """Select motions by an index array, mask or slice."""
        return Motions(self.rotations[which], self.translations_m[which], self.votes[which])

    @property
    def poses(self) -> tuple[RigidTransform, ...]:
        """The motions one by one."""
        rotations = Rotation.from_matrix(self.rotations)
        return tuple(RigidTransform.from_components(t, r) for t, r in zip(self.translations_m, rotations, strict=True))

    @staticmethod
    def empty() -> "Motions":
        """Give no motions."""
        return Motions(np.empty((0, 3, 3)), np.empty((0, 3)), np.empty(0))


def motions_of(poses: Sequence[RigidTransform]) -> Motions:
    """Put poses together, with one vote each."""
    matrices = np.array([pose.as_matrix() for pose in poses]).reshape(-1, 4, 4)
    return Motions(matrices[:, :3, :3].copy(), matrices[:, :3, 3].copy(), np.ones(len(poses)))


def joined(parts: list[Motions]) -> Motions:
    """Put several sets of motions one after the other."""
    if not parts:
        return Motions.empty()
    return Motions(
        np.concatenate([part.rotations for part in parts]),
        np.concatenate([part.translations_m for part in parts]),
        np.concatenate([part.votes for part in parts]),
    )


def rotation_clusters(rotations: Matrices3, weights: Scalars, *, radius_rad: float, most: int) -> tuple[Array, Indices]:
    """Gather rotations around leaders: the best supported first.

    Parameters
    ----------
    rotations
        (n, 3, 3).
    weights
        (n,) votes.
    radius_rad
        Rotations nearer than this to a leader join it [rad].
    most
        At most so many clusters.

    Returns
    -------
    leaders
        (c, 3, 3) mean rotations, by falling votes.
    members
        (n,) number of the cluster of each rotation, -1 for none.
    """
    if len(rotations) == 0:
        return np.empty((0, 3, 3)), np.empty(0, dtype=np.int64)
    quaternions = np.asarray(Rotation.from_matrix(rotations, assume_valid=True).as_quat(canonical=True))
    keys = np.round(quaternions / QUATERNION_BIN).astype(np.int64)
    _, bins = np.unique(_row_keys(keys)[0], return_inverse=True)
    bin_votes = np.bincount(bins, weights=weights)
    means = np.stack([np.bincount(bins, weights=weights * quaternions[:, k]) for k in range(4)], axis=1)
    means = means / np.maximum(np.linalg.norm(means, axis=1, keepdims=True), 1e-12)
    leader_of_bin = np.full(len(means), -1, dtype=np.int64)
    limit = np.cos(0.5 * radius_rad)
    leaders = 0
    for b in np.argsort(-bin_votes, kind="stable"):
        if leader_of_bin[b] >= 0:
            continue
        near = (np.abs(means @ means[b]) >= limit) & (leader_of_bin < 0)
        leader_of_bin[near] = leaders
        leaders += 1
        if leaders == 4 * most:
            break
    members = leader_of_bin[bins]
    known = members >= 0
    sums = _sums_by(members[known], rotations[known] * weights[known][:, None, None], leaders)
    totals = np.bincount(members[known], weights=weights[known], minlength=leaders)
    order = np.argsort(-totals, kind="stable")[:most]
    renumber = np.full(leaders, -1, dtype=np.int64)
    renumber[order] = np.arange(len(order))
    members = np.where(known, renumber[np.maximum(members, 0)], -1)
    return nearest_rotations(sums[order]), members


def _sums_by(numbers: Indices, matrices: Matrices3, count: int) -> Array:
    """Add up the matrices of each number: (count, 3, 3)."""
    entries = matrices.reshape(-1, 9).T
    sums = np.stack([np.bincount(numbers, weights=entry, minlength=count) for entry in entries], axis=1)
    return sums.reshape(count, 3, 3)


def nearest_rotations(matrices: Array) -> Matrices3:
    """Give the proper rotation nearest to each matrix, (n, 3, 3)."""
    u, _, vt = np.linalg.svd(matrices)
    u[..., -1] *= np.sign(np.linalg.det(u @ vt))[..., None]
    return np.asarray(u @ vt)


def vote_motions(
    motions: Motions, centre_m: Vector3, *, radius_rad: float, radius_m: float, most_rotations: int, most: int
) -> Motions:
    """Find the motions on which most of the given ones agree.

    Rotations are clustered first (a building knows few of them), then, for each cluster, the images of the centre are
    counted in cells and their neighbours.

    Parameters
    ----------
    motions
        One motion per piece of evidence.
    centre_m
        A point amid the source's data: rotations differ least in its image [m].
    radius_rad, radius_m
        How near motions must be to vote together.
    most_rotations, most
        At most so many rotations and motions are kept.
    """
    _, members = rotation_clusters(motions.rotations, motions.votes, radius_rad=radius_rad, most=most_rotations)
    kept = np.flatnonzero(members >= 0)
    if len(kept) == 0:
        return Motions.empty()
    images = motions.rotations[kept] @ centre_m + motions.translations_m[kept]
    keys = np.column_stack([members[kept], np.floor(images / radius_m).astype(np.int64)])
    _, first, cell_of = np.unique(_row_keys(keys)[0], return_index=True, return_inverse=True)
    cells = keys[first]
    weights = motions.votes[kept]
    votes = np.bincount(cell_of, weights=weights)
    means = np.stack([np.bincount(cell_of, weights=weights * images[:, k]) / votes for k in range(3)], axis=1)
    summed = _with_neighbours(cells, votes)
    order = np.argsort(-summed, kind="stable")[:most]
    # The members' own rotations say more than the cluster's mean.
    sums = _sums_by(cell_of, motions.rotations[kept] * weights[:, None, None], len(cells))
    rotations = nearest_rotations(sums[order])
    translations = means[order] - rotations @ centre_m
    return Motions(rotations, translations, summed[order])


def _with_neighbours(cells: Array, votes: Scalars) -> Scalars:
    """Add to the votes of each cell those of its 26 neighbours with the same rotation."""
    keys, strides = _row_keys(cells)
    order = np.argsort(keys)
    ranked = keys[order]
    total = np.zeros(len(cells))
    for a in (-1, 0, 1):
        for b in (-1, 0, 1):
            for c in (-1, 0, 1):
                wanted = keys + a * strides[1] + b * strides[2] + c * strides[3]
                place = np.minimum(np.searchsorted(ranked, wanted), len(ranked) - 1)
                total += np.where(ranked[place] == wanted, votes[order[place]], 0.0)
    return total


def _row_keys(rows: Array) -> tuple[Array, Array]:
    """Give one integer for each row of integers, in the rows' order, and how it changes with each column.

    No row next to a given one has the number of another row.
    """
    low = rows.min(axis=0)
    span = rows.max(axis=0) - low + 3
    strides = np.append(np.cumprod(span[:0:-1])[::-1], 1).astype(np.int64)
    return (rows - low + 1) @ strides, strides
