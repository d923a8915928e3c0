"""Straight edges of a photo: chapter 4.1 of M. Lichtenstein's dissertation (Aachen 2011) as one function."""

import numpy as np
from jaxtyping import UInt8

from algorithms.arrays import Array
from algorithms.errors import InvalidInputError
from algorithms.geometry.cameras import Camera
from algorithms.photos.images import grey_image
from algorithms.photos.line_detectors import DETECTORS
from algorithms.photos.line_measurement import measure_lines
from algorithms.photos.options import EdgeOptions
from algorithms.photos.segments import ImageSegments, no_segments
from algorithms.progress import Progress

LEAST_SIDE_PX = 8
"""Smaller photos show no edges."""


def detect_edges(
    image: UInt8[Array, "h w"] | UInt8[Array, "h w 3"],
    camera: Camera | None,
    options: EdgeOptions,
    *,
    progress: Progress,
) -> ImageSegments:
    """Find the straight edges of a photo and measure them.

    Parameters
    ----------
    image
        (h, w) grey or (h, w, 3) RGB.
    camera
        Interior orientation, whose lens distortion is removed from the edge points; None if there is none to remove.

    Returns
    -------
    The edges in ideal pixels, the longest first; none in a photo without edges.

    Raises
    ------
    InvalidInputError
        When the photo has no pixels or too many, or is not the camera's.
    """
    grey = grey_image(image)
    height, width = grey.shape
    if camera is not None and (camera.width, camera.height) != (width, height):
        raise InvalidInputError(
            "photo",
            f"has {width} by {height} pixels, its camera {camera.width} by {camera.height}",
            "give the photo in the size for which the camera was calibrated",
        )
    if min(height, width) < LEAST_SIDE_PX or np.ptp(grey) < options.min_contrast:
        return no_segments()
    progress.report(0.0, "looking for straight edges")
    pieces = DETECTORS[options.detector](grey, options)
    progress.report(0.4, f"measuring {len(pieces)} pieces of edges")
    segments = measure_lines(grey, pieces, camera, options)
    progress.report(1.0, f"{len(segments)} straight edges")
    return segments
