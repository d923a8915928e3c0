"""Normals at core points, and what a cylinder about each of them holds of a cloud."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from algorithms.arrays import Array, CorePoints, CoreScalars, Points, Scalars
from algorithms.deviations import point_index_kernels as kernels
from algorithms.deviations.point_index import PointIndex, index_points
from algorithms.scans.point_blocks import over_blocks

LEAST_CORES = 1 << 10
"""Fewer core points are not worth a block of their own."""
CELLS_PER_RADIUS = 3.0
"""Cells of the sphere's radius over this: most of the sphere is added by whole cells then."""


@dataclass(frozen=True, eq=False)
class Sections:
    """Of k cylinders what each holds of a cloud."""

    positions_m: Scalars
    """(k,) mean or median of the points along the axis, from the core point [m]; NaN where there are none."""
    spreads_m: Scalars
    """(k,) standard deviation along the axis (n - 1), or that which the interquartile range stands for [m]; NaN below
    two points."""
    counts: Scalars
    """(k,) points."""


def core_normals(points: Points, cores: CorePoints, radii_m: Sequence[float]) -> tuple[CorePoints, CoreScalars]:
    """Fit a plane to the points around each core point, at the radius at which they are most plane.

    The eigenvector of the smallest eigenvalue of the covariance of all points within the radius; of several radii the
    one of the largest (l₂ − l₁) / l₃ counts (Lague, Brodu, Leroux 2013, doi:10.1016/j.isprsjprs.2013.04.009, take the
    one of the smallest l₁; planarity is what py4dgeo takes). O(points) to sort, O(points per sphere's shell) a core.

    Parameters
    ----------
    points
        (n, 3) cloud [m].
    cores
        (k, 3) core points in the same frame [m].
    radii_m
        Radii of the spheres [m].

    Returns
    -------
    normals
        (k, 3) unit normals of either sign; zero where fewer than three points or no plane was found.
    planarity
        (k,) (l₂ − l₁) / l₃ of the chosen sphere, 0 where there is no normal.
    """
    normals, planarity = np.zeros((len(cores), 3)), np.zeros(len(cores))
    for radius in radii_m:
        index = index_points(points, radius / CELLS_PER_RADIUS)
        over_blocks(
            lambda start, end, index=index, radius=radius: kernels.normals_at(  # type: ignore[misc]
                cores, radius, index.points, index.starts, index.moments, index.table, index.lower_m, index.size_m,
                start, end, normals, planarity,
            ),
            len(cores), least=LEAST_CORES,
        )  # fmt: skip
    return normals, planarity


def sections(
    index: PointIndex, cores: Points, normals: Points, *, radius_m: float, half_length_m: float, median: bool
) -> Sections:
    """Cut cylinders out of a cloud and average what they hold; O(points in the cylinders' cells).

    Parameters
    ----------
    index
        The cloud; cells of about the cylinder's diameter are fastest.
    cores, normals
        (k, 3) middles of the cylinders and unit directions of their axes; a zero direction gives an empty section.
    radius_m, half_length_m
        Radius, and length to either side of the core point [m].
    median
        Median and interquartile range instead of mean and standard deviation.
    """
    out: Float64[Array, "k 3"] = np.empty((len(cores), 3))
    over_blocks(
        lambda start, end: kernels.cylinder_sections(
            cores, normals, radius_m, half_length_m, index.points, index.starts, index.table, index.lower_m,
            index.size_m, median, start, end, out,
        ),
        len(cores), least=LEAST_CORES,
    )  # fmt: skip
    return Sections(out[:, 0].copy(), out[:, 1].copy(), out[:, 2].copy())
