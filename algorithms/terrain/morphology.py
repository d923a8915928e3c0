"""Openings of height grids by discs."""

import cv2
import numpy as np
from jaxtyping import Float32

from algorithms.arrays import Array

Heights32 = Float32[Array, "rows columns"]
CROSS = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], dtype=np.uint8)
DIAMOND_SHARE = 0.6
"""Of a disc's radius that its diamond has; the rest is a square. Their sum is an octagon close to the disc."""


def disc_erosion(heights: Heights32, radius: int) -> Heights32:
    """Give the lowest height within an octagon of a radius around each cell; O(cells · radius)."""
    square, diamond = _parts(radius)
    out = heights
    if square:
        out = cv2.erode(out, np.ones((2 * square + 1, 2 * square + 1), np.uint8), borderType=cv2.BORDER_REPLICATE)
    if diamond:
        out = cv2.erode(out, CROSS, iterations=diamond, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(out, dtype=np.float32)


def disc_dilation(heights: Heights32, radius: int) -> Heights32:
    """Give the highest height within an octagon of a radius around each cell."""
    return -disc_erosion(-heights, radius)


def disc_opening(heights: Heights32, radius: int) -> Heights32:
    """Remove what is narrower than a disc from above: erosion, then dilation."""
    return disc_dilation(disc_erosion(heights, radius), radius)


def _parts(radius: int) -> tuple[int, int]:
    diamond = round(DIAMOND_SHARE * radius)
    return radius - diamond, diamond
