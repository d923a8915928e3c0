"""Motions along a direction of which planes say nothing: surface slid along surface until most of it meets.

Two stations far apart in a street or in a large hall have planes in common, but hardly any across the street: the
facades and the pavement fix the rotation and two components of the translation. What fixes the third are many small
pieces that make no plane for both stations: reveals, steps, pillars, cars. So the surface that faces along the open
direction is moved along it, with the other two components as the planes have them, and every meeting of a point with a
point of the other scan in the same cell across counts for the offset between them.
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from algorithms.arrays import Array
from algorithms.geometry.rotations import cross_matrix
from algorithms.matching.plane_triples import OffsetVotes
from algorithms.matching.votes import Motions, joined
from algorithms.scans.surface_index import SurfaceIndex

MOST_OFFSETS = 3
"""So many of the strongest offsets along each of the two known directions are combined."""
MOST_PLACES = 6
"""So many of the places along the open direction go on."""
LEAST_COSINE = 0.6
"""A surface faces along a direction when its normal is within 53 degrees of it."""
SEARCHED_POINTS, FACING_POINTS = 20_000, 1000
"""Of so many surface points of each scan the first so many that face along the direction are used."""
CELL_M, BIN_M = 0.4, 0.15
"""Edge of the cells across the direction, and width of the bins along it [m]."""


def sliding_motions(votes: Sequence[OffsetVotes], target: SurfaceIndex, source: SurfaceIndex) -> Motions:
    """Slide the source along each direction that two others leave open.

    Parameters
    ----------
    votes
        What planes say of rotations and offsets.
    target, source
        The two scans.

    Returns
    -------
    Motions with as many votes as points of both scans meet.
    """
    return joined(
        [_slid(each, pair, target, source) for each in votes for pair in combinations(range(len(each.axes)), 2)]
    )


def _slid(votes: OffsetVotes, pair: tuple[int, int], target: SurfaceIndex, source: SurfaceIndex) -> Motions:
    """Slide across two of the axes, from each combination of their strongest offsets."""
    from algorithms.matching import sliding_kernels as kernels

    axes = votes.axes[list(pair)]
    along = cross_matrix(axes[0]) @ axes[1]
    along /= np.linalg.norm(along)
    frame = np.array([along, axes[0], cross_matrix(along) @ axes[0]])
    known = [votes.offsets_m[number][:MOST_OFFSETS] for number in pair]
    sides = np.column_stack([np.repeat(known[0], len(known[1])), np.tile(known[1], len(known[0]))])
    starts: Array = np.linalg.solve(axes @ axes.T, sides.T).T @ axes
    offsets, counts = np.empty((2, len(starts), MOST_PLACES))
    kernels.slide(
        target.points[:SEARCHED_POINTS], target.normals[:SEARCHED_POINTS],
        source.points[:SEARCHED_POINTS], source.normals[:SEARCHED_POINTS],
        frame, frame @ votes.rotation, starts @ frame.T,
        np.array([LEAST_COSINE, FACING_POINTS, CELL_M, BIN_M]), offsets, counts,
    )  # fmt: skip
    translations = starts[:, None, :] + offsets[:, :, None] * along
    found = counts > 0.0
    rotations = np.broadcast_to(votes.rotation, (int(found.sum()), 3, 3)).copy()
    return Motions(rotations, translations[found], counts[found])
