"""The points of a scan left and right of the edges of a photo."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Points, Scalars, Splits, Vectors2
from algorithms.features.photo_lines.edge_bands_kernels import gather
from algorithms.features.photo_lines.photo_points import points_in_photo
from algorithms.features.photo_lines.projection_options import ProjectionOptions
from algorithms.geometry.cameras import Camera
from algorithms.photos.segments import ImageSegments

ENDS_PX, ENDS_SHARE = 3.0, 0.1
"""So much is left out at each end of an edge: around corners there are other surfaces [px, share of the length]."""
DENSE_SHARE, UNIFORM = 0.2, 1.1
"""Share of the edges beside which surfaces certainly fill the band; how many times as far apart points may be
elsewhere."""
SPARSEST_PX = 100.0
"""Spacing of the points of an edge without any [px]."""


@dataclass(frozen=True, eq=False)
class EdgeBands:
    """The points beside n edges, m in all, those of edge k in splits[k]:splits[k + 1]."""

    numbers: Int64[Array, "m"]
    """(m,) numbers of the points in the scan."""
    points: Float64[Array, "m 3"]
    """(m, 3) [m]."""
    along: Float64[Array, "m"]
    """(m,) places along the edges, from their centres [px]."""
    across: Float64[Array, "m"]
    """(m,) distances from the edges, positive on the side of the normal [px]."""
    splits: Splits
    """(n + 1,)."""
    first_px: Scalars
    """(n,) where the band begins along the edge [px]."""
    last_px: Scalars
    """(n,) where it ends [px]."""
    spacings_px: Scalars
    """(n,) mean distance of neighbouring points in the denser half of the band, or what it is beside most edges of the
    photo if that is less [px]."""
    widths_px: Scalars
    """(n,) width of the wider half of the band, as the limits in px and metres leave it [px]."""

    def __len__(self) -> int:
        return len(self.first_px)


def gather_bands(
    segments: ImageSegments,
    camera: Camera,
    scan_from_camera: RigidTransform,
    points: Points,
    options: ProjectionOptions,
) -> EdgeBands:
    """Collect the visible points beside all edges.

    Parameters
    ----------
    segments
        At least one edge.
    camera, scan_from_camera
        Interior orientation, and pose in the frame of the points.
    points
        (k, 3) points of the scan [m].
    """
    ends = segments.ends.reshape(-1, 2)
    low = ends.min(axis=0) - options.band_px - 1.0
    high = ends.max(axis=0) + options.band_px + 1.0
    photo = points_in_photo(points, camera, scan_from_camera, low, high)
    trimmed = np.minimum(ENDS_PX, ENDS_SHARE * segments.lengths)
    first, last = segments.extents[:, 0] + trimmed, segments.extents[:, 1] - trimmed
    focal = 0.5 * (camera.fx + camera.fy)
    found, along, across, splits = gather(
        photo.ideal, photo.depths, photo.visible, photo.starts, photo.rows, photo.columns, low, photo.cell_px,
        segments.centres, segments.directions, first, last, options.band_px, options.band_m * focal,
    )  # fmt: skip
    widths = _widths(photo.depths[found], across, splits, options, focal)
    return EdgeBands(
        numbers=photo.numbers[found],
        points=photo.points[found],
        along=along,
        across=across,
        splits=splits,
        first_px=first,
        last_px=last,
        spacings_px=_spacings(across, splits, widths, last - first, _stretches(segments.centres, camera)),
        widths_px=np.maximum(widths.max(axis=1), options.gap_px + 1.0),
    )


def _side_of_point(across: Float64[Array, "m"], splits: Splits) -> Int64[Array, "m"]:
    """Give the side each point lies on: 2 k for the side of the normal of edge k, 2 k + 1 for the other one."""
    return np.asarray(2 * np.repeat(np.arange(len(splits) - 1), np.diff(splits)) + (across <= 0.0), dtype=np.int64)


def _widths(
    depths: Float64[Array, "m"], across: Float64[Array, "m"], splits: Splits, options: ProjectionOptions, focal: float
) -> Array:
    """Give the width (n, 2) of the band on both sides of the edges that the limits in px and metres leave [px]."""
    sides = _side_of_point(across, splits)
    count = 2 * (len(splits) - 1)
    number = np.bincount(sides, minlength=count)
    mean = np.bincount(sides, depths, minlength=count) / np.maximum(number, 1)
    widths = np.where(number > 0, np.minimum(options.band_px, options.band_m * focal / np.maximum(mean, 1e-9)), 1.0)
    return np.asarray(widths.reshape(-1, 2))


def _spacings(
    across: Float64[Array, "m"], splits: Splits, widths: Array, lengths: Scalars, stretches: Scalars
) -> Scalars:
    """Give the mean distance of points, of the denser side of each edge (n,) [px].

    A scanner's steps are even angles: where points are much sparser than beside other edges, surfaces do not fill the
    band, and next to the edge there may be nothing known.
    """
    number = np.bincount(_side_of_point(across, splits), minlength=2 * len(lengths)).reshape(-1, 2)
    areas = widths * np.maximum(lengths, 1.0)[:, None]
    spacing = np.sqrt(areas / np.maximum(number, 1))
    own = np.where(number > 0, spacing, SPARSEST_PX).min(axis=1)
    return np.asarray(np.minimum(own, UNIFORM * stretches * np.quantile(own / stretches, DENSE_SHARE)))


def _stretches(centres: Vectors2, camera: Camera) -> Scalars:
    """Give how many times as far apart directions of equal distance lie (n,) as in the middle of the photo."""
    places = (centres - np.array([camera.cx, camera.cy])) / np.array([camera.fx, camera.fy])
    return np.asarray((1.0 + np.sum(places**2, axis=1)) ** 0.75)
