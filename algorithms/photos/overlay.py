"""A photo with its edges and with lines of space drawn into it, to be looked at."""

import cv2
import numpy as np
from jaxtyping import Float64, UInt8
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Points, Vectors2
from algorithms.geometry.cameras import Camera
from algorithms.photos.segments import ImageSegments

SEGMENT_COLOR = (255, 215, 0)
"""Yellow: edges of the photo."""
LINE_COLOR = (0, 200, 255)
"""Blue: lines of space."""
DARKENED = 0.6
"""Share of the photo's brightness that is left, so that the lines show."""
SUBPIXEL_BITS = 4
"""Lines are drawn to a sixteenth of a pixel."""
POINTS_PER_LINE = 48
"""Lens distortion bends lines: each is drawn through so many points."""
NEAREST_M = 0.1


def overlay(
    image: UInt8[Array, "h w"] | UInt8[Array, "h w 3"],
    segments: ImageSegments | None = None,
    lines: list[Vectors2] | None = None,
    *,
    segment_color: tuple[int, int, int] = SEGMENT_COLOR,
    line_color: tuple[int, int, int] = LINE_COLOR,
) -> UInt8[Array, "h w 3"]:
    """Draw edges and projected lines over a darkened photo.

    Parameters
    ----------
    image
        (h, w) grey or (h, w, 3) RGB.
    segments
        Edges of the photo; their ends as taken are joined.
    lines
        Polylines (p, 2) in pixels of the photo as taken, see `projected_polylines`.
    segment_color, line_color
        Red, green, blue.

    Returns
    -------
    (h, w, 3) RGB.
    """
    grey = image if image.ndim == 3 else np.repeat(image[:, :, None], 3, axis=2)
    canvas = np.ascontiguousarray((grey * DARKENED).astype(np.uint8))
    width = max(1, round(max(image.shape[:2]) / 1500))
    for line in lines or []:
        _draw(canvas, line, line_color, width)
    if segments is not None:
        for ends in segments.raw_ends:
            _draw(canvas, ends, segment_color, width)
    return canvas


def _draw(canvas: UInt8[Array, "h w 3"], line: Vectors2, color: tuple[int, int, int], width: int) -> None:
    points = np.rint(line * (1 << SUBPIXEL_BITS)).astype(np.int32).reshape(-1, 1, 2)
    cv2.polylines(canvas, [points], False, color, width, cv2.LINE_AA, SUBPIXEL_BITS)


def projected_polylines(
    starts: Points, ends: Points, camera: Camera, camera_from_scan: RigidTransform
) -> list[Float64[Array, "p 2"]]:
    """Project pieces of lines into a photo, each as a polyline in pixels of the photo as taken.

    What lies behind the camera or outside the frame is left out; a line of which nothing is left gives none.

    Parameters
    ----------
    starts, ends
        (n, 3) in the scan frame [m].
    camera, camera_from_scan
        Interior orientation and inverse pose.
    """
    share = np.linspace(0.0, 1.0, POINTS_PER_LINE)[:, None]
    polylines = []
    for start, end in zip(camera_from_scan.apply(starts), camera_from_scan.apply(ends), strict=True):
        points = _evenly_seen(start, end, share)
        points = points[camera.projectable(points)]
        if len(points) < 2:
            continue
        seen = camera.image_from_camera(points)
        seen = seen[camera.inside(seen)]
        if len(seen) >= 2:
            polylines.append(seen)
    return polylines


def _evenly_seen(start: Float64[Array, "3"], end: Float64[Array, "3"], share: Float64[Array, "p 1"]) -> Points:
    """Give points along a line in the camera frame, evenly spaced in the photo: in 1/z, not in space."""
    if max(start[2], end[2]) <= NEAREST_M:
        return np.empty((0, 3))
    low, high = (start, end) if start[2] < end[2] else (end, start)
    if low[2] < NEAREST_M:
        low = low + (NEAREST_M - low[2]) / (high[2] - low[2]) * (high - low)
    weights = np.hstack([(1.0 - share) / low[2], share / high[2]])
    return np.asarray((weights / weights.sum(axis=1, keepdims=True)) @ np.stack([low, high]))
