"""Pictures of photos with their straight edges and with lines in space; only in computing processes, with OpenCV."""

from collections.abc import Iterator

import cv2
import numpy as np
from jaxtyping import UInt8
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Vector3
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.cameras import Camera
from algorithms.geometry.lines import LineSource
from algorithms.photos.overlay import overlay, projected_polylines
from algorithms.photos.segments import ImageSegments
from algorithms.scans.range_image import Visibility, visibility

MAX_SIDE_PX = 4000
"""Larger pictures are made smaller, so that browsers show them."""
LINE_COLORS = {
    LineSource.PLANE_INTERSECTION: (0, 200, 255),
    LineSource.CYLINDER_AXIS: (255, 90, 255),
    LineSource.PHOTO_EDGE: (255, 215, 0),
}
"""Red, green, blue: blue and pink for lines of the scan, yellow as edges in photos."""
PIECES = 32
"""A line is shown in so many pieces, each where the scanner could see it."""


def edges_png(image: UInt8[Array, "h w 3"], segments: ImageSegments) -> bytes:
    """Draw the edges of a photo (RGB) into it, where it shows them as taken, and give it as PNG."""
    return _png(overlay(image, segments))


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
    plain = overlay(image)
    picture = plain.copy()
    camera_from_scan = scan_from_camera.inv()
    for source, color in LINE_COLORS.items():
        numbers = np.flatnonzero(features.lines.sources == int(source))
        pieces = [piece for number in numbers for piece in _seen_pieces(features, int(number))]
        if not pieces:
            continue
        starts, ends = (np.array(points) + features.origin_m for points in zip(*pieces, strict=True))
        drawn = overlay(image, lines=projected_polylines(starts, ends, camera, camera_from_scan), line_color=color)
        changed = (drawn != plain).any(axis=2)
        picture[changed] = drawn[changed]
    return _png(picture)


def _seen_pieces(features: ScanFeatures, number: int) -> Iterator[tuple[Vector3, Vector3]]:
    """Cut a line into pieces and give starts and ends (3,) of those that nothing hides, joined where they meet."""
    lines = features.lines
    places = np.linspace(lines.extents[number, 0], lines.extents[number, 1], PIECES + 1)
    points = lines.anchors[number] + places[:, None] * lines.directions[number]
    shown = np.ones(PIECES, dtype=bool)
    if features.seen is not None:
        shown = visibility(0.5 * (points[1:] + points[:-1]), features.seen) != int(Visibility.HIDDEN)
    bounds = np.flatnonzero(np.diff(np.concatenate([[False], shown, [False]])))
    for first, last in bounds.reshape(-1, 2).tolist():
        yield points[first], points[last]


def _png(picture: UInt8[Array, "h w 3"]) -> bytes:
    scale = MAX_SIDE_PX / max(picture.shape[:2])
    if scale < 1.0:
        picture = np.asarray(cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))
    done, data = cv2.imencode(".png", picture[..., ::-1])
    if not done:  # pragma: no cover - memory is the only limit
        raise MemoryError
    return bytes(data)
