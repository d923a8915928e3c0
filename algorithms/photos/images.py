"""Photos as grey values, their noise, and the same photo at half its size."""

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from algorithms.arrays import Array
from algorithms.errors import InvalidInputError

MAX_SIDE_PX = 32_000
"""Larger photos are refused: OpenCV addresses their pixels with 16 bits in places."""
MAX_PIXELS = 400_000_000
NOISE_MASK = np.array([[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]]) / 6.0
"""Blind to planes and to straight steps along rows and columns; unit response to white noise (Immerkær 1996)."""
MEDIAN_TO_STD = 1.4826
LEAST_NOISE = 0.3
"""Rounding to whole grey levels leaves at least this standard deviation, 1/√12 [grey levels]."""

GreyImage = UInt8[Array, "h w"]
SmoothImage = Float32[Array, "h w"]


def grey_image(image: UInt8[Array, "h w"] | UInt8[Array, "h w 3"]) -> GreyImage:
    """Turn an RGB or grey photo into grey values (ITU-R BT.601 weights).

    Raises
    ------
    InvalidInputError
        When the photo has no pixels or too many.
    """
    height, width = image.shape[:2]
    if height == 0 or width == 0:
        raise InvalidInputError("photo", f"has {width} by {height} pixels", "give an image with pixels")
    if max(height, width) > MAX_SIDE_PX or height * width > MAX_PIXELS:
        raise InvalidInputError(
            "photo", f"has {width} by {height} pixels", f"at most {MAX_SIDE_PX} a side and {MAX_PIXELS} in all"
        )
    if image.ndim == 2:
        return np.ascontiguousarray(image)
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2GRAY))


def noise_std(grey: GreyImage) -> float:
    """Estimate the standard deviation of the photo's noise [grey levels].

    Median of the absolute response to a mask that planes and straight steps leave at zero (J. Immerkær, Fast noise
    variance estimation, Computer Vision and Image Understanding 64 (1996)), the median in place of his mean so that
    texture counts little. At least the rounding to whole grey levels.
    """
    if min(grey.shape) < 3:
        return LEAST_NOISE
    # every pixel of a large photo is not needed for a median
    step = max(1, int(np.sqrt(grey.size / 1e6)))
    rows = [grey[i : i + 3] for i in range(0, grey.shape[0] - 2, 3 * step)]
    response = np.concatenate([cv2.filter2D(rows3, cv2.CV_32F, NOISE_MASK)[1, 1:-1] for rows3 in rows])
    saturated = np.concatenate([(r[1, 1:-1] == 0) | (r[1, 1:-1] == 255) for r in rows])
    if saturated.all():
        return LEAST_NOISE
    values = np.abs(response[~saturated])
    return max(LEAST_NOISE, MEDIAN_TO_STD * float(np.median(values)))


def halved(grey: GreyImage) -> UInt8[Array, "half_h half_w"]:
    """Average blocks of 2 by 2 pixels: half the noise, the same contrast; odd last rows and columns are left out.

    The centre of pixel (i, j) of the half image is the point (2 i + 0.5, 2 j + 0.5) of the full one.
    """
    height, width = grey.shape[0] // 2 * 2, grey.shape[1] // 2 * 2
    return np.asarray(
        cv2.resize(grey[:height, :width], (width // 2, height // 2), interpolation=cv2.INTER_AREA), dtype=np.uint8
    )
