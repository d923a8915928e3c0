"""Which records of a scan and of photos may show one line, and in what they can be compared."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from algorithms.arrays import Array, Matrices4, Points, Scalars
from algorithms.geometry.line_differences import line_differences, lines_overlap
from algorithms.geometry.lines import Lines

SHARED_RANK = 1e-9
"""Least share of the largest eigenvalue at which a direction of a covariance counts; rounding leaves about 1e-16."""


@dataclass(frozen=True, eq=False)
class NearPairs:
    """n pairs of lines that run beside each other."""

    first: Int64[Array, "n"]
    """(n,) number in the first set."""
    second: Int64[Array, "n"]
    """(n,) number in the second set."""
    differences: Float64[Array, "n 4"]
    """(n, 4) second minus first line in the first one's (a1, a2, b1, b2)."""
    jacobians: Matrices4
    """(n, 4, 4) derivatives of these by the second one's (a1, a2, b1, b2)."""
    places: Scalars
    """(n,) where the middle of the second piece lies along the first line [m]."""


def near_pairs(
    first: Lines, second: Lines, max_angle_rad: float, max_distances_m: Float64[Array, "m"], min_overlap: float
) -> NearPairs:
    """Find the pairs of lines that could be the same one.

    Parameters
    ----------
    first, second
        Lines in one frame.
    max_angle_rad
        Largest angle between them.
    max_distances_m
        (m,) largest distance of the middle of each second piece from the first line.
    min_overlap
        Least share of the shorter seen piece along which both run.
    """
    j, i = np.nonzero(np.abs(second.directions @ first.directions.T) > np.cos(max_angle_rad))
    a, b = first[i], second[j]
    differences, jacobians = line_differences(a, b)
    places = np.einsum("ni,ni->n", middles(b) - a.anchors, a.directions)
    apart = np.linalg.norm(differences[:, 2:] + places[:, None] * differences[:, :2], axis=1)
    near = np.flatnonzero((apart <= max_distances_m[j]) & lines_overlap(a, b, min_overlap))
    return NearPairs(i[near], j[near], differences[near], jacobians[near], places[near])


def middles(lines: Lines) -> Points:
    """Give the middles (n, 3) of the seen pieces [m]."""
    return np.asarray(lines.anchors + lines.extents.mean(axis=1)[:, None] * lines.directions)


def rounding_covariances(lengths: Scalars, places: Scalars, std_m: float) -> Matrices4:
    """Give the covariance of what rounded edges and uneven surfaces add to differences, at places along the lines."""
    covariances = np.zeros((len(lengths), 4, 4))
    tilt = (2.0 * std_m / np.maximum(lengths, 1e-3)) ** 2
    for axis in range(2):
        covariances[:, axis, axis] = tilt
        covariances[:, axis, 2 + axis] = covariances[:, 2 + axis, axis] = -places * tilt
        covariances[:, 2 + axis, 2 + axis] = std_m**2 + places**2 * tilt
    return covariances


def without_shared(shared: Float64[Array, "4 4"], half_length_m: float) -> Float64[Array, "k 4"]:
    """Give the combinations of (a1, a2, b1, b2) that errors with a covariance of low rank do not touch.

    Parameters
    ----------
    shared
        (4, 4) covariance of these errors.
    half_length_m
        Half the line's length, which makes tilts comparable with offsets.

    Returns
    -------
    (k, 4), k = 4 - rank: rows H with H shared Hᵀ = 0. For a line of a photo and its surface's errors these are tilt
    and offset across the projecting plane.
    """
    scale = np.array([half_length_m, half_length_m, 1.0, 1.0])
    values, vectors = np.linalg.eigh(scale[:, None] * shared * scale)
    return np.asarray(vectors[:, values <= SHARED_RANK * max(float(values[-1]), 0.0)].T * scale)


def across_surfaces(shared: Matrices4, half_lengths_m: Scalars) -> Float64[Array, "n 2 4"]:
    """Give for n lines the two combinations of (a1, a2, b1, b2) that errors with these covariances touch least.

    For lines of photos and their surfaces, whose errors have rank two, these are `without_shared`.
    """
    scale = np.column_stack(
        [half_lengths_m, half_lengths_m, np.ones_like(half_lengths_m), np.ones_like(half_lengths_m)]
    )
    _, vectors = np.linalg.eigh(scale[:, :, None] * shared * scale[:, None, :])
    return np.asarray(np.swapaxes(vectors[:, :, :2], 1, 2) * scale[:, None, :])
