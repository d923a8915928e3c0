"""Straight pieces grown from half circles: section 4.1.4 of M. Lichtenstein's dissertation (Aachen 2011).

Schneider (2010): the binary image is searched from the top left to the bottom right; from each edge pixel further ones
are looked for on a half circle of a given radius; pieces whose end is the start of the next and whose slopes agree
become one edge, and edges that nearly coincide are approximated by one. The dissertation recommends it for small parts
of a photo, because it takes long and sees only what is joined.
"""

import numpy as np
from jaxtyping import Bool, Float64, Int64

from algorithms.arrays import Array
from algorithms.photos.canny import canny
from algorithms.photos.images import GreyImage
from algorithms.photos.line_fit import lines_between
from algorithms.photos.line_merging import merge_collinear, without_doubles
from algorithms.photos.options import EdgeOptions
from algorithms.photos.segment_growing_kernels import grow_pieces, half_circle_pieces

RADIUS_PX = 6
"""Radius of the half circle: pixels define a direction to about 1/radius."""
HALF_RING_PX = 0.71
"""Pixels whose centres are closer to the circle than half a diagonal lie on it [px]."""
SLOPE_TOLERANCE_RAD = float(np.deg2rad(20.0))
"""Slopes of pieces of this length agree to that: a pixel more or less at their end."""
ACROSS_PX = 1.5
"""And their ends lie no further from the line so far [px]."""


def half_circle(radius: int) -> Int64[Array, "n 2"]:
    """Give the steps (x, y) to the pixels on a half circle below, from the right to before the left.

    So every direction is met from one of two pixels only.
    """
    y, x = np.mgrid[0 : radius + 1, -radius : radius + 1]
    on = (np.abs(np.hypot(x, y) - radius) < HALF_RING_PX) & ((y > 0) | (x > 0))
    return np.column_stack([x[on], y[on]])


def grow_segments(edges: Bool[Array, "h w"], least_px: float, max_gap_px: float) -> Float64[Array, "n 4"]:
    """Grow straight segments in a binary image of edges.

    Returns
    -------
    x and y of both ends of segments of at least `least_px`.
    """
    width = edges.shape[1]
    pieces = half_circle_pieces(edges, half_circle(RADIUS_PX))
    pixels = pieces[:, 1].astype(np.int64) * width + pieces[:, 0]
    order = np.argsort(pixels, kind="stable")
    grown = grow_pieces(pieces, edges.shape, pixels[order], order, SLOPE_TOLERANCE_RAD, ACROSS_PX, least_px)
    if len(grown) == 0:
        return grown
    lines = without_doubles(lines_between(grown.reshape(-1, 2, 2), 1.0, 1.0))
    lines = merge_collinear(lines, max_gap_px)
    ends = lines.centres[:, None] + lines.extents[:, :, None] * lines.directions[:, None]
    return np.asarray(ends.reshape(-1, 4))


def segment_growing(grey: GreyImage, options: EdgeOptions) -> Float64[Array, "n 4"]:
    """Find straight pieces by half circles in the Canny edges of a photo."""
    return grow_segments(canny(grey, options).edges, 0.7 * options.min_length_px, options.max_gap_px)
