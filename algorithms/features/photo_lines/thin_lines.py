"""Joints, bars and painted lines that are a few pixels wide: both sides together are one line in the photo.

The blur of each side displaces the other, both outwards or both inwards by the same amount where their contrasts are
the same, so their middle stays where it is.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from algorithms.arrays import Array, Flags, Indices, Scalars
from algorithms.features.photo_lines.thin_lines_kernels import other_sides
from algorithms.photos.segments import ImageSegments

LARGEST_RATIO = 1.5
"""Largest ratio of the contrasts of both sides."""
UNEQUAL_PX = 0.16
"""The middle of a line of 1.5 px moves by so much times (ratio - 1 / ratio) of the contrasts, that of wider ones less
[px]; taken as a standard deviation."""


@dataclass(frozen=True, eq=False)
class ThinLines:
    """The edges of a photo, those that are both sides of a thin line replaced by its middle."""

    segments: ImageSegments
    """n edges in the order of the photo's; the longer side of a thin line is replaced by the middle."""
    half_widths_px: Scalars
    """(n,) half the distance of both sides; 0 of edges that are none of a thin line [px]."""
    spent: Flags
    """(n,) True for the shorter side of a thin line, which its middle has used up."""


def middles_of_thin_lines(segments: ImageSegments, widest_px: float) -> ThinLines:
    """Replace the longer side of each thin line by its middle.

    Parameters
    ----------
    segments
        Edges of a photo in ideal pixels.
    widest_px
        Sides further apart do not displace each other.
    """
    n = len(segments)
    single = np.flatnonzero(~segments.composite)
    found = other_sides(
        segments.centres[single],
        segments.directions[single],
        segments.extents[single],
        segments.contrasts[single],
        widest_px,
        LARGEST_RATIO,
    )
    first = np.flatnonzero(found >= 0)
    one, other = single[first], single[found[first]]
    longer = (segments.lengths[one] > segments.lengths[other]) | (
        (segments.lengths[one] == segments.lengths[other]) & (one < other)
    )
    one, other = one[longer], other[longer]
    spent = np.zeros(n, dtype=bool)
    spent[other] = True
    half_widths = np.zeros(n)
    middle, half_widths[one] = _middles(segments, one, other)
    columns = {}
    for name, values in middle.items():
        columns[name] = getattr(segments, name).copy()
        columns[name][one] = values
    return ThinLines(replace(segments, **columns), half_widths, spent)


def _middles(segments: ImageSegments, one: Indices, other: Indices) -> tuple[dict[str, Array], Scalars]:
    """Give the columns of `ImageSegments` that a middle has of its own, and half the distances of the sides."""
    directions = segments.directions[one] - segments.directions[other]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    normals = np.column_stack([-directions[:, 1], directions[:, 0]])
    # the part along which both run, seen from the middle between their centres
    start = 0.5 * (segments.centres[one] + segments.centres[other])
    ends = np.concatenate([segments.ends[one], segments.ends[other]], axis=1) - start[:, None]
    along = np.sort(np.einsum("nei,ni->ne", ends, directions).reshape(-1, 2, 2), axis=2)
    low, high = along[:, :, 0].max(axis=1), along[:, :, 1].min(axis=1)
    place = start + (0.5 * (low + high))[:, None] * directions
    across = []
    covariances = np.zeros((len(one), 2, 2))
    for side, sense in ((one, 1.0), (other, -1.0)):
        arm = np.einsum("ni,ni->n", place - segments.centres[side], segments.directions[side])
        at = segments.centres[side] + arm[:, None] * segments.directions[side]
        across.append(np.einsum("ni,ni->n", at - place, normals))
        covariances += 0.25 * _carried(segments.covariances[side], arm, sense)
    ratio = segments.contrasts[one] / segments.contrasts[other]
    covariances[:, 1, 1] += (UNEQUAL_PX * (ratio - 1.0 / ratio)) ** 2
    half = 0.5 * (high - low)
    return {
        "centres": place + (0.5 * (across[0] + across[1]))[:, None] * normals,
        "directions": directions,
        "extents": np.column_stack([-half, half]),
        "covariances": covariances,
    }, np.asarray(0.5 * np.abs(across[0] - across[1]))


def _carried(covariances: Float64[Array, "m 2 2"], arms: Scalars, sense: float) -> Float64[Array, "m 2 2"]:
    """Carry covariances of (angle, offset) along the edges, and into the sense of the middle."""
    transfer = np.zeros((len(arms), 2, 2))
    transfer[:, 0, 0] = 1.0
    transfer[:, 1, 0], transfer[:, 1, 1] = sense * arms, sense
    return np.asarray(transfer @ covariances @ np.swapaxes(transfer, 1, 2))
