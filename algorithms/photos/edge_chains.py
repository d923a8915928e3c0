"""Straight pieces from chains of edge pixels.

Edge pixels are linked along the edge and the chains cut where they bend, as in the edge drawing detectors (C. Akinlar,
C. Topal, EDLines, Pattern Recognition Letters 32 (2011), doi:10.1016/j.patrec.2011.06.001), here on Canny's edges. The
same is done in the photo at half size, where noise is half as strong: faint edges are only found there.
"""

from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
from jaxtyping import Float64

from algorithms.arrays import Array, Flags
from algorithms.photos.canny import EdgeImage, canny
from algorithms.photos.edge_chains_kernels import cut_chains, link_pixels, peak_positions
from algorithms.photos.images import GreyImage, halved
from algorithms.photos.options import EdgeOptions

LEAST_PART = 0.7
"""Pieces of at least this part of the least length are kept: they may be joined or go on."""
WINDOW_PX = 8
"""Points a straight piece starts with."""
TOLERANCE_PX = 1.0
"""Points further from the line do not belong to a piece [px]."""
LEAST_LEVEL_PX = 32
"""Photos narrower than this are not halved."""
COVERED = 0.6
"""A piece of the half photo is known already when so much of it lies on pieces of the full one."""
MARK_PX = 5
"""Width of the marks that pieces of the full photo leave [px]."""

Pieces = Float64[Array, "n 4"]
"""n straight pieces, x and y of both ends in the photo as taken [px]."""


def straight_chains(image: EdgeImage, least_length_px: float) -> Pieces:
    """Link the edge pixels and give the straight pieces of the chains."""
    least = max(WINDOW_PX, int(0.5 * least_length_px))
    rows, columns, splits = link_pixels(image.edges, image.gx, image.gy, least)
    points = peak_positions(rows, columns, image.gx, image.gy)
    pieces = cut_chains(points, splits, WINDOW_PX, TOLERANCE_PX)
    lengths = np.hypot(pieces[:, 2] - pieces[:, 0], pieces[:, 3] - pieces[:, 1])
    return np.asarray(pieces[lengths >= LEAST_PART * least_length_px])


def covered(pieces: Pieces, others: Float64[Array, "m 4"], shape: tuple[int, int]) -> Flags:
    """Tell which pieces run for the most part on others at least half as long, in a photo of `shape` rows, columns.

    Where noise has broken an edge of the full photo into many short pieces, the long one is wanted as well.
    """
    marks = np.zeros(shape, dtype=np.float32)
    lengths = np.hypot(others[:, 2] - others[:, 0], others[:, 3] - others[:, 1])
    ends = np.rint(others).astype(np.int32).reshape(-1, 2, 2)
    # the longest are drawn last, on top of the others
    for k in np.argsort(lengths, kind="stable"):
        cv2.line(marks, ends[k, 0], ends[k, 1], float(lengths[k]), MARK_PX)
    steps = np.linspace(0.02, 0.98, 25)
    x = np.rint(pieces[:, None, 0] + steps * (pieces[:, None, 2] - pieces[:, None, 0])).astype(np.int64)
    y = np.rint(pieces[:, None, 1] + steps * (pieces[:, None, 3] - pieces[:, None, 1])).astype(np.int64)
    on = marks[np.clip(y, 0, shape[0] - 1), np.clip(x, 0, shape[1] - 1)]
    own = np.hypot(pieces[:, 2] - pieces[:, 0], pieces[:, 3] - pieces[:, 1])
    return np.asarray((on >= 0.5 * own[:, None]).mean(axis=1) >= COVERED)


def edge_chains(grey: GreyImage, options: EdgeOptions) -> Pieces:
    """Find straight pieces in the photo, and those that only the photo at half size shows."""
    if min(grey.shape) < LEAST_LEVEL_PX:
        return straight_chains(canny(grey, options), options.min_length_px)
    # most of the work is done by compiled code without the interpreter lock
    with ThreadPoolExecutor(max_workers=1) as thread:
        later = thread.submit(lambda: straight_chains(canny(halved(grey), options), 0.5 * options.min_length_px))
        pieces = straight_chains(canny(grey, options), options.min_length_px)
        small = 2.0 * later.result() + 0.5
    return np.concatenate([pieces, small[~covered(small, pieces, grey.shape)]])
