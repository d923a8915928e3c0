"""What the profile fit of an edge leaves besides noise, and repeats along the edge.

An edge nearly along the rows or columns of the sensor lies at the same place between the centres of pixels all along
it; what the fitted profile misses of the true one then moves the whole edge, or turns it where the place changes once
or twice. Over many pixels crossed it averages out. Grey values that belong to another edge near by do the same.
"""

import numpy as np
from jaxtyping import Float64

from algorithms.arrays import Array, Scalars
from algorithms.photos.line_fit import PATCH_PX, EdgeLines, PlacedPatches

SAMPLING_PX = 0.02
"""Standard deviation of the place of an edge in one position between the centres of pixels, measured on rendered photos
of buildings [px]."""
REMAINING_PX = 0.002
"""The same of any edge, besides: light that is not even, rounding to grey levels [px]."""
END_PX = 0.04
"""The same at the ends of an edge, along the last patch that counts: there other edges begin [px]."""
NEIGHBOUR_PX = 0.02
"""The same where another edge is so near that the profile had to be cut off before it [px]."""


def systematic_covariances(
    lines: EdgeLines, placed: PlacedPatches, cut: Array, displacement_stds: Scalars
) -> Float64[Array, "n 2 2"]:
    """Give the covariance (n, 2, 2) of (angle, offset) of edges that does not shrink with their length.

    A displacement A sin(2 π k u + φ) along the edge, u from -1/2 to 1/2, any φ, moves the fitted line by A sin(π k)/
    (π k) and its ends by 6 A (cos(π k)/(2 π k) - sin(π k)/(2 π² k²)) against each other's middle; k is the number of
    rows or columns crossed. One of n patches displaced by D at an end moves the line by D/n and its ends by 3 D/n.

    Parameters
    ----------
    placed
        The patches of the lines.
    cut
        (n,) edges with another one so near that their profile was cut off before it.
    """
    crossed = np.maximum(_crossed(placed, len(lines)), 1e-3)
    turn = np.pi * crossed
    shift = SAMPLING_PX * np.sin(turn) / turn
    tip = 3.0 * SAMPLING_PX * (np.cos(turn) - np.sin(turn) / turn) / turn
    common = REMAINING_PX**2 + np.where(cut, NEIGHBOUR_PX**2, 0.0) + displacement_stds**2
    end = END_PX * PATCH_PX / np.maximum(lines.lengths, PATCH_PX)
    covariances = np.zeros((len(lines), 2, 2))
    covariances[:, 0, 0] = (tip**2 + common + 9.0 * end**2) * (2.0 / np.maximum(lines.lengths, 1.0)) ** 2
    covariances[:, 1, 1] = shift**2 + common + end**2
    return covariances


def _crossed(placed: PlacedPatches, count: int) -> Scalars:
    """Give how many rows or columns, whichever are fewer, each edge crosses in the photo as taken."""
    owners, centres = placed.patches.owners, placed.patches.centres
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, owners, centres)
    np.maximum.at(high, owners, centres)
    numbers = np.bincount(owners, minlength=count)
    # from the first patch's centre to the last one's is one patch less than the edge
    return np.asarray((high - low).min(axis=1) * numbers / np.maximum(numbers - 1.0, 1.0))
