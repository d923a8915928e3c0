"""Straight lines where two bounded planes meet."""

import cv2
import numpy as np

from algorithms.arrays import Array
from algorithms.features.planes.plane_boundaries import PlaneRasters
from algorithms.features.planes.plane_intersections_kernels import common_support
from algorithms.geometry.covariances import intersection_covariances, intersection_jacobians, intersection_lines
from algorithms.geometry.lines import Lines, LineSource, lines_from_arrays
from algorithms.geometry.planes import Planes

MIN_ANGLE_RAD = 15.0 * np.pi / 200.0
"""Planes that meet at less than 15 gon give no usable line (MATH 2.4)."""
REACH_CELLS = 2
"""How many raster cells a plane's points may end short of the line: edges are rounded and thinly measured."""


def intersect_planes(planes: Planes, rasters: PlaneRasters, *, min_length_m: float) -> Lines:
    """Intersect all pairs of planes that are both seen near a common piece of their intersection.

    Parameters
    ----------
    planes
        Bounded planes.
    rasters
        Their occupied cells.
    min_length_m
        Least length of the common piece; one and a half raster cells are needed as well.

    Returns
    -------
    Lines with the anchor in the middle of the common pieces, parents = plane numbers, and Jacobians by the planes.
    """
    i, j = np.triu_indices(len(planes), 1)
    sine = np.linalg.norm(np.cross(planes.normals[i], planes.normals[j]), axis=1)
    steep = sine > np.sin(MIN_ANGLE_RAD)
    i, j = i[steep].astype(np.int64), j[steep].astype(np.int64)
    if len(i) == 0:
        return Lines.empty()
    pairs = np.stack([i, j], axis=1)
    points, directions = intersection_lines(
        planes.normals[i], planes.centroids[i], planes.normals[j], planes.centroids[j]
    )
    least = np.maximum(min_length_m, 3.0 * np.maximum(rasters.cell_sizes[i], rasters.cell_sizes[j]))
    support = common_support(
        pairs, points, directions, planes.centroids, planes.bases,
        _reaching(rasters), rasters.starts, rasters.rows, rasters.columns, rasters.origins, rasters.cell_sizes, least,
    )  # fmt: skip
    # the reach prolongs the common piece at both ends as well
    reach = REACH_CELLS * np.minimum(rasters.cell_sizes[i], rasters.cell_sizes[j])
    support += np.stack([reach, -reach, -2.0 * reach, np.zeros_like(reach)], axis=1)
    met = support[:, 2] >= np.maximum(min_length_m, least / 2.0)
    pairs, support = pairs[met], support[met]
    i, j = pairs.T
    anchors = points[met] + support[:, 3:] * directions[met]
    bases, jacobians = intersection_jacobians(
        anchors, directions[met],
        planes.normals[i], planes.centroids[i], planes.bases[i],
        planes.normals[j], planes.centroids[j], planes.bases[j],
    )  # fmt: skip
    return lines_from_arrays(
        anchors,
        directions[met],
        intersection_covariances(jacobians, planes.covariances[i], planes.covariances[j]),
        support[:, :2] - support[:, 3:],
        bases=bases,
        sources=np.full(len(pairs), LineSource.PLANE_INTERSECTION, dtype=np.int32),
        parents=pairs,
        parent_jacobians=jacobians,
    )


def _reaching(rasters: PlaneRasters) -> Array:
    """Dilate every raster by the reach."""
    kernel = np.ones((2 * REACH_CELLS + 1, 2 * REACH_CELLS + 1), dtype=np.uint8)
    return np.concatenate([cv2.dilate(rasters.of(p), kernel).ravel() for p in range(len(rasters))])
