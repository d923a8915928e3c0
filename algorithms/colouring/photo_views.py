"""What one photo sees of a cloud: where each point lies in it, whether something hides it, and how well it shows."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, UInt8
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Indices, Points, Scalars, Vectors2
from algorithms.colouring import photo_views_kernels as kernels
from algorithms.colouring.options import ColouringOptions
from algorithms.geometry.cameras import Camera

POINTS_PER_CELL = 4.0
"""The depth buffer's cells are so large that about so many points fall into each."""
LEAST_CELL_PX, LARGEST_CELL_PX = 2.0, 64.0
RELATIVE_MARGIN = 0.004
"""Of the distance, added to the margin: errors of rotation."""


@dataclass(frozen=True, eq=False)
class PlacedPhoto:
    """A photo with its camera and pose; its pixels are read when they are needed."""

    name: str
    station: str
    camera: Camera
    common_from_camera: RigidTransform
    """Pose in the common frame less its origin."""
    read: Callable[[], UInt8[Array, "h w 3"]]
    """Gives the pixels, red, green, blue."""


@dataclass(frozen=True, eq=False)
class View:
    """The points that a photo shows."""

    numbers: Indices
    """(m,) which points of the cloud."""
    pixels: Vectors2
    """(m, 2) columns and rows in the photo."""
    weights: Scalars
    """(m,) say of the photo in the colour of the point."""
    radius: Scalars
    """(m,) distance from the principal point over that of the farthest corner."""


def view_of(photo: PlacedPhoto, points: Points, normals: Points, options: ColouringOptions) -> View:
    """Find the points that a photo shows.

    A point is hidden when a point of the cloud that falls into the same or a neighbouring cell of the depth buffer is
    nearer by more than the margin and lies off the tangent plane: so a floor does not hide itself at a flat angle.

    Parameters
    ----------
    photo
        With camera and pose.
    points, normals
        (n, 3) of the cloud and the normals towards the instruments, zero where there is none.
    options
        Margins and weights.
    """
    camera = photo.camera
    in_camera = photo.common_from_camera.inv().apply(points)
    numbers = np.flatnonzero(camera.projectable(in_camera))
    pixels = camera.image_from_camera(in_camera[numbers])
    inside = camera.inside(pixels)
    numbers, pixels = numbers[inside], pixels[inside]
    seen, turned = in_camera[numbers], photo.common_from_camera.rotation.inv().apply(normals[numbers])
    cell = float(np.sqrt(POINTS_PER_CELL * camera.width * camera.height / max(len(numbers), 1)))
    cell = min(max(cell, LEAST_CELL_PX), LARGEST_CELL_PX)
    shown = np.empty(len(numbers), dtype=np.bool_)
    kernels.shown_points(
        np.ascontiguousarray(seen), np.ascontiguousarray(turned), pixels, cell, camera.width, camera.height,
        options.margin_m, RELATIVE_MARGIN, shown,
    )  # fmt: skip
    weights = weights_of(camera, seen, turned, pixels, options)
    shown &= weights > 0.0
    return View(numbers[shown], pixels[shown], weights[shown], radius_of(camera, pixels[shown]))


def weights_of(
    camera: Camera, in_camera: Points, turned: Points, pixels: Vectors2, options: ColouringOptions
) -> Scalars:
    """Give the say (n,) of a photo in the colours of what it shows: 0 where it looks too flatly.

    Parameters
    ----------
    camera
        Of the photo.
    in_camera, turned
        (n, 3) places and their normals, zero where there is none, in the camera's frame [m].
    pixels
        (n, 2) where they are in the photo.
    options
        Of the weights.
    """
    distances = np.linalg.norm(in_camera, axis=1)
    with_normal = np.einsum("ij,ij->i", turned, turned) > 0.5
    cosines = -np.einsum("ij,ij->i", turned, in_camera) / np.maximum(distances, 1e-9)
    least = float(np.cos(np.radians(options.steepest_deg)))
    cosines = np.where(with_normal, cosines, least)
    weights = (
        np.maximum(cosines, 0.0) ** options.angle_power
        * (camera.fx / np.maximum(distances, 1e-9)) ** options.distance_power
    )
    weights *= _off_border(pixels, camera, options.border)
    return np.where(cosines >= least, weights, 0.0)


def radius_of(camera: Camera, pixels: Vectors2) -> Scalars:
    """Give the distance (n,) of pixels from the principal point over that of the farthest corner."""
    corner = np.array([[max(camera.cx, camera.width - camera.cx), max(camera.cy, camera.height - camera.cy)]])
    off = np.linalg.norm(pixels - np.array([camera.cx, camera.cy]), axis=1)
    return np.asarray(off / float(np.linalg.norm(corner)))


def sampled(image: UInt8[Array, "h w 3"] | Float64[Array, "h w 3"], pixels: Vectors2) -> Float64[Array, "m 3"]:
    """Interpolate an image at pixels (m, 2) between the four nearest ones."""
    out = np.empty((len(pixels), 3))
    kernels.interpolate(image, pixels, out)
    return out


def _off_border(pixels: Vectors2, camera: Camera, share: float) -> Scalars:
    """Give weights (m,) that rise from 0 at the photo's border to 1 inside."""
    if share == 0.0:
        return np.ones(len(pixels))
    size = np.array([camera.width, camera.height], dtype=np.float64)
    from_border = np.minimum(pixels + 0.5, size - 0.5 - pixels) / (share * size)
    return np.asarray(np.clip(from_border, 0.0, 1.0).prod(axis=1))
