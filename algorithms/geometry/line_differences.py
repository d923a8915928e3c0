"""How far pairs of uncertain lines in one frame differ: the four conditions of MATH 3.1 without a motion."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from algorithms.arrays import Array, Flags, Matrices4
from algorithms.geometry.lines import Lines

SMALLEST_COSINE = 0.5
"""Lines that differ by more than 60 degrees are compared as if they differed by that: finite, and far off any limit."""


def line_differences(first: Lines, second: Lines) -> tuple[Float64[Array, "n 4"], Matrices4]:
    """Give second minus first line, in the first one's (a1, a2, b1, b2), for n pairs.

    With d the second's direction turned to the first's side, q = d.d1, lam = ((c1 - c2).d1) / q, p = c2 + lam d:
    difference [E1ᵀ d / q; E1ᵀ (p - c1)], where the second line passes the first one's anchor.

    Returns
    -------
    The differences, and (n, 4, 4) their derivatives by the second's (a1, a2, b1, b2); those by the first's are minus
    the unit matrix, to first order in the difference.
    """
    cosines = np.einsum("ni,ni->n", second.directions, first.directions)
    signs = np.where(cosines < 0.0, -1.0, 1.0)
    moved = second.directions * signs[:, None]
    q = np.maximum(np.abs(cosines), SMALLEST_COSINE)
    lam = np.einsum("ni,ni->n", first.anchors - second.anchors, first.directions) / q
    points = second.anchors + lam[:, None] * moved
    projection = np.swapaxes(first.bases, 1, 2)
    tilts = np.einsum("nij,nj->ni", projection, moved)
    offsets = np.einsum("nij,nj->ni", projection, points - first.anchors)
    by_point = projection - tilts[:, :, None] * first.directions[:, None, :] / q[:, None, None]
    turned = by_point @ second.bases
    jacobians = np.zeros((len(first), 4, 4))
    jacobians[:, :2, :2] = turned * (signs / q)[:, None, None]
    jacobians[:, 2:, :2] = turned * (signs * lam)[:, None, None]
    jacobians[:, 2:, 2:] = turned
    return np.hstack([tilts / q[:, None], offsets]), jacobians


def lines_overlap(first: Lines, second: Lines, min_share: float) -> Flags:
    """Tell which of n pairs of seen pieces run beside each other for at least a share of the shorter one."""
    ends = np.stack(second.end_points, axis=1) - first.anchors[:, None, :]
    along = np.sort(np.einsum("nei,ni->ne", ends, first.directions), axis=1)
    common = np.minimum(along[:, 1], first.extents[:, 1]) - np.maximum(along[:, 0], first.extents[:, 0])
    return np.asarray(common >= min_share * np.minimum(first.lengths, second.lengths))


def lines_moved(lines: Lines, corrections: Float64[Array, "n 4"]) -> Lines:
    """Move lines by corrections of their (a1, a2, b1, b2), small enough for their covariances to stay as they are."""
    directions = lines.directions + np.einsum("nij,nj->ni", lines.bases, corrections[:, :2])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    e1 = lines.bases[:, :, 0] - np.einsum("ni,ni->n", lines.bases[:, :, 0], directions)[:, None] * directions
    e1 /= np.linalg.norm(e1, axis=1, keepdims=True)
    return replace(
        lines,
        anchors=lines.anchors + np.einsum("nij,nj->ni", lines.bases, corrections[:, 2:]),
        directions=directions,
        bases=np.stack([e1, np.cross(directions, e1)], axis=2),
    )
