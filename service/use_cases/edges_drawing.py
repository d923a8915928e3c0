"""The picture of a photo with its straight edges; only in computing processes, it needs OpenCV."""

import cv2
import numpy as np
from jaxtyping import UInt8

from algorithms.arrays import Array
from algorithms.photos.segments import ImageSegments

MAX_SIDE_PX = 4000
"""Larger photos are drawn smaller, so that browsers show them."""
FADED = 0.55
"""Part of the photo's contrast that is kept, so that the lines stand out."""
COLOR = (255, 90, 0)
END_COLOR = (0, 90, 255)
SUBPIXEL_BITS = 4


def edges_png(image: UInt8[Array, "h w 3"], segments: ImageSegments) -> bytes:
    """Draw the edges and their ends into the photo, faded to grey, and give it as PNG.

    Parameters
    ----------
    image
        RGB.
    segments
        Its edges; drawn where they lie in the photo as taken.
    """
    scale = min(1.0, MAX_SIDE_PX / max(image.shape[:2]))
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    if scale < 1.0:
        grey = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    faded = cv2.convertScaleAbs(grey, alpha=FADED, beta=255.0 * (1.0 - FADED))
    canvas = cv2.cvtColor(faded, cv2.COLOR_GRAY2BGR)
    # (0, 0) is the centre of the first pixel, in the photo and in the smaller picture
    ends = (segments.raw_ends + 0.5) * scale - 0.5
    fixed = np.rint(ends * (1 << SUBPIXEL_BITS)).astype(np.int64)
    thickness = max(1, round(max(canvas.shape[:2]) / 1500))
    for start, end in fixed.tolist():
        cv2.line(canvas, start, end, COLOR[::-1], thickness, cv2.LINE_AA, SUBPIXEL_BITS)
        for point in (start, end):
            cv2.circle(canvas, point, thickness << SUBPIXEL_BITS, END_COLOR[::-1], -1, cv2.LINE_AA, SUBPIXEL_BITS)
    done, data = cv2.imencode(".png", canvas)
    if not done:  # pragma: no cover - memory is the only limit
        raise MemoryError
    return bytes(data)
