"""Crop points to a box, a polygon or a distance."""

import numpy as np

from algorithms.arrays import Flags, Points, Scalars, Vector3
from algorithms.cleaning import crop_kernels as kernels
from algorithms.cleaning.options import BoxCrop, DistanceCrop, PolygonCrop
from algorithms.errors import InvalidInputError

LEAST_CORNERS = 3
FLATTEST = 1e-12
"""A ring whose area is a smaller share of its squared extent encloses nothing."""


def check_box(box: BoxCrop) -> None:
    """Refuse a box without volume.

    Raises
    ------
    InvalidInputError
        A lower bound is not below its upper bound.
    """
    for axis, low, high in zip("xyz", box.lowest_m, box.highest_m, strict=True):
        if not low < high:
            raise InvalidInputError("box", f"the least {axis} ({low:g} m) is not below the largest ({high:g} m)")


def check_polygon(polygon: PolygonCrop) -> None:
    """Refuse a polygon that encloses nothing.

    Raises
    ------
    InvalidInputError
        It has fewer than three corners, no area, or no height.
    """
    if len(polygon.corners_m) < LEAST_CORNERS:
        raise InvalidInputError("polygon", f"{len(polygon.corners_m)} corners enclose nothing", "give three or more")
    corners = np.array(polygon.corners_m)
    x, y = (corners - corners[0]).T
    area = 0.5 * abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))))
    if area <= FLATTEST * float(np.ptp(corners, axis=0).max()) ** 2:
        raise InvalidInputError("polygon", "its corners lie on one line", "give corners that enclose an area")
    low, high = polygon.lowest_m, polygon.highest_m
    if low is not None and high is not None and not low < high:
        raise InvalidInputError("polygon", f"the least height ({low:g} m) is not below the largest ({high:g} m)")


def check_distance(distance: DistanceCrop) -> None:
    """Refuse an empty range of distances.

    Raises
    ------
    InvalidInputError
        The least distance is not below the largest.
    """
    if not distance.nearest_m < distance.farthest_m:
        raise InvalidInputError(
            "distance", f"the least ({distance.nearest_m:g} m) is not below the largest ({distance.farthest_m:g} m)"
        )


def in_box(points: Points, box: BoxCrop, origin_m: Vector3) -> Flags:
    """Tell which points (n, 3), given less `origin_m`, lie in a box, rim included."""
    low, high = (np.array(bound) - origin_m for bound in (box.lowest_m, box.highest_m))
    return np.asarray(((points >= low) & (points <= high)).all(axis=1))


def in_polygon(points: Points, polygon: PolygonCrop, origin_m: Vector3) -> Flags:
    """Tell which points (n, 3), given less `origin_m`, lie within a polygon seen from above.

    Parts of a ring that crosses itself are inside where a ray to them crosses the ring an odd number of times.
    """
    ring = np.array(polygon.corners_m) - origin_m[:2]
    inside = kernels.inside_ring(np.ascontiguousarray(points), np.ascontiguousarray(ring))
    if polygon.lowest_m is not None:
        inside &= points[:, 2] >= polygon.lowest_m - origin_m[2]
    if polygon.highest_m is not None:
        inside &= points[:, 2] <= polygon.highest_m - origin_m[2]
    return np.asarray(inside)


def at_distance(ranges_m: Scalars, distance: DistanceCrop) -> Flags:
    """Tell which points lie at a wanted distance (n,) from their instrument."""
    return np.asarray((ranges_m >= distance.nearest_m) & (ranges_m <= distance.farthest_m))
