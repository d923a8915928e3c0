"""Pictures of photos with their straight edges and with lines in space; only in computing processes, with OpenCV."""

from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from jaxtyping import UInt8
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Flags, Points
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.cameras import Camera
from algorithms.geometry.lines import LineSource
from algorithms.photos.segments import ImageSegments
from algorithms.scans.range_image import Visibility, visibility

MAX_SIDE_PX = 4000
"""Larger photos are drawn smaller, so that browsers show them."""
FADED = 0.55
"""Part of the photo's contrast that is kept, so that the lines stand out."""
COLOR = (255, 90, 0)
END_COLOR = (0, 90, 255)
SUBPIXEL_BITS = 4
LINE_COLORS = {
    LineSource.PLANE_INTERSECTION: (0, 150, 70),
    LineSource.CYLINDER_AXIS: (150, 0, 170),
    LineSource.PHOTO_EDGE: COLOR,
}
SAMPLES = 65
"""Places along a line in space: it may be bent by the lens, and hidden in parts."""


def edges_png(image: UInt8[Array, "h w 3"], segments: ImageSegments) -> bytes:
    """Draw the edges and their ends into the photo, faded to grey, and give it as PNG.

    Parameters
    ----------
    image
        RGB.
    segments
        Its edges; drawn where they lie in the photo as taken.
    """
    canvas, scale = _faded(image)
    thickness = _thickness(canvas)
    for start, end in _fixed(segments.raw_ends, scale):
        cv2.line(canvas, start, end, COLOR[::-1], thickness, cv2.LINE_AA, SUBPIXEL_BITS)
        for point in (start, end):
            cv2.circle(canvas, point, thickness << SUBPIXEL_BITS, END_COLOR[::-1], -1, cv2.LINE_AA, SUBPIXEL_BITS)
    return _png(canvas)


def lines_png(
    image: UInt8[Array, "h w 3"], camera: Camera, scan_from_camera: RigidTransform, features: ScanFeatures
) -> bytes:
    """Draw the lines of a station into a photo taken there, each kind in its colour, and give it as PNG.

    Parameters
    ----------
    image
        RGB.
    camera
        Interior orientation.
    scan_from_camera
        Pose of the camera in the scan's frame, full coordinates.
    features
        Of the station; parts of lines that the scanner could not see are left out.
    """
    canvas, scale = _faded(image)
    thickness, lines = _thickness(canvas), features.lines
    for k in range(len(lines)):
        along = np.linspace(lines.extents[k, 0], lines.extents[k, 1], SAMPLES)
        points = lines.anchors[k] + along[:, None] * lines.directions[k]
        in_camera = scan_from_camera.inv().apply(points + features.origin_m)
        shown = _shown(points, in_camera, features, camera)
        places = np.zeros((SAMPLES, 2))
        places[shown] = camera.image_from_camera(in_camera[shown])
        fixed = _fixed(places, scale)
        color = LINE_COLORS[LineSource(int(lines.sources[k]))][::-1]
        for (start, ours), (end, theirs) in pairwise(zip(fixed, shown.tolist(), strict=True)):
            if ours and theirs:
                cv2.line(canvas, start, end, color, thickness, cv2.LINE_AA, SUBPIXEL_BITS)
    return _png(canvas)


def _shown(points: Points, in_camera: Points, features: ScanFeatures, camera: Camera) -> Flags:
    """Tell which places along a line lie in the photo and are not hidden from the scanner."""
    shown = camera.projectable(in_camera)
    shown[shown] = camera.inside(camera.image_from_camera(in_camera[shown]))
    if features.seen is not None:
        shown &= visibility(points, features.seen) != int(Visibility.HIDDEN)
    return shown


def _faded(image: UInt8[Array, "h w 3"]) -> tuple[UInt8[Array, "h w 3"], float]:
    """Give the photo in light grey, as OpenCV orders colours, and its scale."""
    scale = min(1.0, MAX_SIDE_PX / max(image.shape[:2]))
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    if scale < 1.0:
        grey = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    faded = cv2.convertScaleAbs(grey, alpha=FADED, beta=255.0 * (1.0 - FADED))
    return np.asarray(cv2.cvtColor(faded, cv2.COLOR_GRAY2BGR), dtype=np.uint8), scale


def _thickness(canvas: Array) -> int:
    return max(1, round(int(max(canvas.shape[:2])) / 1500))


def _fixed(pixels: Array, scale: float) -> list[Any]:
    """Give pixels of the photo as OpenCV's fixed-point pixels of the picture."""
    # (0, 0) is the centre of the first pixel, in the photo and in the smaller picture
    places = (pixels + 0.5) * scale - 0.5
    fixed: list[Any] = np.rint(places * (1 << SUBPIXEL_BITS)).astype(np.int64).tolist()
    return fixed


def _png(canvas: Array) -> bytes:
    done, data = cv2.imencode(".png", canvas)
    if not done:  # pragma: no cover - memory is the only limit
        raise MemoryError
    return bytes(data)
