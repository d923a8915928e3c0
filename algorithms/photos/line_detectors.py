"""Ways from the grey values of a photo to first straight pieces."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

import cv2
import numpy as np

from algorithms.errors import InvalidInputError
from algorithms.photos.edge_chains import Pieces, edge_chains
from algorithms.photos.hough import canny_hough, canny_hough_probabilistic
from algorithms.photos.images import GreyImage
from algorithms.photos.options import EdgeDetector, EdgeOptions
from algorithms.photos.segment_growing import segment_growing


def lsd(grey: GreyImage, options: EdgeOptions) -> Pieces:
    """Find straight pieces by the line segment detector of R. Grompone von Gioi et al. (2012) as OpenCV has it.

    Its pieces lie about 0.1 px beside the edges; the profile fit that follows removes that.

    Raises
    ------
    InvalidInputError
        When the OpenCV at hand comes without it: it left the main module more than once.
    """
    create = getattr(cv2, "createLineSegmentDetector", None)
    if create is None:
        raise InvalidInputError("detector", "this OpenCV has no line segment detector", "choose edge-chains")
    found = create(cv2.LSD_REFINE_STD).detect(grey)[0]
    pieces = np.zeros((0, 4)) if found is None else np.asarray(found, dtype=np.float64).reshape(-1, 4)
    lengths = np.hypot(pieces[:, 2] - pieces[:, 0], pieces[:, 3] - pieces[:, 1])
    return np.asarray(pieces[lengths >= 0.5 * options.min_length_px])


DETECTORS: Mapping[EdgeDetector, Callable[[GreyImage, EdgeOptions], Pieces]] = MappingProxyType(
    {
        "edge-chains": edge_chains,
        "lsd": lsd,
        "canny-hough": canny_hough,
        "canny-hough-probabilistic": canny_hough_probabilistic,
        "segment-growing": segment_growing,
    }
)
"""All ways by name."""
