"""Lay the contours of a job, measured in photos, on its mesh."""

from collections.abc import Sequence

import numpy as np

from algorithms.arrays import Vector3
from algorithms.colouring.photo_views import PlacedPhoto
from algorithms.deviations.triangles import Mesh
from algorithms.errors import InvalidInputError
from algorithms.meshing.contour_cones import contour_on_model
from schemas.results.mesh_result import ContourFigures
from service.ports import Json


def contours_on(
    mesh: Mesh, photos: Sequence[PlacedPhoto], wanted: Sequence[Json], origin_m: Vector3
) -> list[ContourFigures] | None:
    """Lay contours on a mesh, and say how near they are; None where none are wanted.

    Raises
    ------
    InvalidInputError
        A station has no such photo with camera and pose, or a point lies outside of it.
    """
    return [_contour_on(mesh, photos, k, each, origin_m) for k, each in enumerate(wanted)] or None


def _contour_on(
    mesh: Mesh, photos: Sequence[PlacedPhoto], number: int, wanted: Json, origin_m: Vector3
) -> ContourFigures:
    own = [photo for photo in photos if photo.station == wanted["station"]]
    if wanted["photo"] >= len(own):
        raise InvalidInputError(
            f"contours[{number}]", f"'{wanted['station']}' has {len(own)} photos with camera and pose", "one of these"
        )
    photo = own[wanted["photo"]]
    pixels = np.array(wanted["pixels"], dtype=np.float64)
    if not photo.camera.inside(pixels).all():
        size = f"{photo.camera.width} by {photo.camera.height}"
        raise InvalidInputError(f"contours[{number}]", f"a point lies outside of its photo of {size} pixels")
    found = contour_on_model(mesh, photo, pixels, wanted["largest_gap_px"])
    laid = np.isfinite(found.gaps_px)
    places = (found.points_m + origin_m).tolist()
    return ContourFigures(
        station=wanted["station"],
        photo=wanted["photo"],
        points_m=[(x, y, z) if good else None for (x, y, z), good in zip(places, laid.tolist(), strict=True)],
        found=int(laid.sum()),
        rms_px=float(np.sqrt(np.mean(found.gaps_px[laid] ** 2))) if laid.any() else None,
        mean_m=float(found.gaps_m[laid].mean()) if laid.any() else None,
    )
