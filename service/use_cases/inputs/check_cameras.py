"""Facts that no camera can have: focal lengths in millimetres, principal points in a corner, places far away."""

import math
from collections.abc import Iterable, Sequence

from schemas.values.photos import CameraRequest
from service.errors import FieldFault

LEAST_FOCAL, MOST_FOCAL = 0.2, 200.0
"""Focal length in longer sides of the photo: the widest lenses without a fisheye's projection have 0.28 (their field of
view is 122 degrees), the longest some 70; a focal length in millimetres is below 0.1 for any photo of a megapixel."""
MOST_UNLIKE = 1.5
"""Ratio of fx and fy: pixels are square to a percent, those of old video cameras to a tenth."""
CORNER = 0.1
"""A principal point nearer to the first pixel than this share of both sides was not counted from there. Lenses that can
be shifted move it towards one side, never into the corner."""
CLOSE_M = 5.0
"""A camera on a scanner is never so far outside what the scan shows."""


def camera_faults(camera: CameraRequest, where: str) -> Iterable[FieldFault]:
    """Name what no camera can have.

    Parameters
    ----------
    camera
        Interior orientation as requested, of the size of its photo.
    where
        Pointer to it in the request.
    """
    side = max(camera.width, camera.height)
    for name, value in (("fx", camera.fx), ("fy", camera.fy)):
        if not LEAST_FOCAL * side <= value <= MOST_FOCAL * side:
            field = math.degrees(2.0 * math.atan(0.5 * side / value))
            yield FieldFault(
                f"{where}/{name}",
                f"with a focal length of {value:g} px a photo of {side} px sees {field:.3g} degrees; it is in pixels "
                "of this photo, not in millimetres: f [mm] / width of the sensor [mm] · width of the photo [px]",
            )
    if max(camera.fx, camera.fy) > MOST_UNLIKE * min(camera.fx, camera.fy):
        yield FieldFault(
            f"{where}/fy",
            f"fx is {camera.fx:g} and fy {camera.fy:g} px, but pixels are square, so both are about equal",
        )
    for name, value, length in (("cx", camera.cx, camera.width), ("cy", camera.cy, camera.height)):
        if not -0.5 <= value <= length - 0.5:
            yield FieldFault(
                f"{where}/{name}",
                f"the principal point lies outside the photo: {value:g} px of {length}; it is counted in pixels from "
                f"the centre of the first pixel, usually near {0.5 * length:g}",
            )
    if abs(camera.cx) < CORNER * camera.width and abs(camera.cy) < CORNER * camera.height:
        yield FieldFault(
            f"{where}/cx",
            f"the principal point ({camera.cx:g}, {camera.cy:g}) lies in the corner of the photo; it is counted in "
            "pixels from the centre of the first pixel, so in the middle of this photo it is "
            f"({0.5 * (camera.width - 1):g}, {0.5 * (camera.height - 1):g})",
        )


def place_faults(
    matrix: Sequence[Sequence[float]], bounds_m: Sequence[Sequence[float]] | None, where: str
) -> Iterable[FieldFault]:
    """Name a camera that stands where no scanner with such a scan can have stood.

    Parameters
    ----------
    matrix
        (4, 4) scan from camera.
    bounds_m
        Opposite corners of the scan [m]; None: not known.
    where
        Pointer to the matrix in the request.
    """
    if bounds_m is None:
        return
    place = [row[3] for row in matrix[:3]]
    low, high = bounds_m
    size = math.dist(low, high)
    # the scanner itself stands in its own origin, or amid what it saw
    outside = math.dist(
        place, [min(max(x, min(a, 0.0)), max(b, 0.0)) for x, a, b in zip(place, low, high, strict=True)]
    )
    if outside > max(CLOSE_M, size):
        yield FieldFault(
            where,
            f"the camera would stand {outside:.6g} m outside of what the scan shows, which is {size:.3g} m from corner "
            "to corner; the translation is in metres, not in millimetres, and gives the camera in this scan's frame",
        )
