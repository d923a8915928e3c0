"""Straight 2-D edges with uncertainty."""

from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float64

from algorithms.arrays import Array, Flags, Indices, Scalars, Vectors2


@dataclass(frozen=True, eq=False)
class ImageSegments:
    """n straight edges of a photo, the longest first, in ideal (undistorted) pixels.

    The edge runs from `centres + extents[:, 0] * directions` to `centres + extents[:, 1] * directions`. Its normal is
    (-d_y, d_x), a quarter turn from the direction as seen with x right and y down, and points to the **brighter**
    side. Errors: d → d + angle · normal, c → c + offset · normal.
    """

    centres: Vectors2
    """(n, 2) points of the edges, where angle and offset are uncorrelated [px]."""
    directions: Vectors2
    """(n, 2) unit directions; the brighter side lies on the side of the normal."""
    extents: Vectors2
    """(n, 2) start and end along the direction, counted from the centre [px]."""
    covariances: Float64[Array, "n 2 2"]
    """(n, 2, 2) covariance of (angle, offset across the edge at the centre) [rad, px]."""
    contrasts: Scalars
    """(n,) difference of the grey values on both sides, positive [grey levels]."""
    widths_px: Scalars
    """(n,) standard deviation of the blur of the edge, pixel size included [px]."""
    point_counts: Indices
    """(n,) number of edge points in the line fit."""
    raw_ends: Float64[Array, "n 2 2"]
    """(n, 2, 2) start and end (x, y) in the photo as taken, for overlays [px]."""
    composite: Flags
    """(n,) True where the profile across is too wide or too narrow for one edge of this photo: two edges within their
    blur, found as one, or a soft shadow."""

    def __len__(self) -> int:
        return len(self.centres)

    def __getitem__(self, chosen: Indices | Flags | slice) -> "ImageSegments":
        """Select edges by numbers, flags or a slice; the order is that of the selection."""
        return ImageSegments(
            centres=self.centres[chosen],
            directions=self.directions[chosen],
            extents=self.extents[chosen],
            covariances=self.covariances[chosen],
            contrasts=self.contrasts[chosen],
            widths_px=self.widths_px[chosen],
            point_counts=self.point_counts[chosen],
            raw_ends=self.raw_ends[chosen],
            composite=self.composite[chosen],
        )

    @property
    def normals(self) -> Vectors2:
        """(n, 2) unit normals (-d_y, d_x), to the brighter side."""
        return np.column_stack([-self.directions[:, 1], self.directions[:, 0]])

    @property
    def lengths(self) -> Scalars:
        """(n,) lengths [px]."""
        return np.asarray(self.extents[:, 1] - self.extents[:, 0])

    @property
    def ends(self) -> Float64[Array, "n 2 2"]:
        """(n, 2, 2) start and end (x, y) in ideal pixels."""
        return np.asarray(self.centres[:, None] + self.extents[:, :, None] * self.directions[:, None])

    @property
    def end_covariances(self) -> Float64[Array, "n 2 2"]:
        """(n, 2, 2) covariance of the displacements across the edge at its start and its end [px²].

        T C Tᵀ with the rows (s, 1) of T for the positions s of start and end. Along the edge the ends are not measured:
        the brightness says where an edge is, not where it ends.
        """
        transfer = np.stack([self.extents, np.ones_like(self.extents)], axis=-1)
        return np.asarray(transfer @ self.covariances @ transfer.transpose(0, 2, 1))


def joined(first: ImageSegments, second: ImageSegments) -> ImageSegments:
    """Put two sets of edges one after the other."""
    return ImageSegments(**{
        field.name: np.concatenate([getattr(first, field.name), getattr(second, field.name)])
        for field in fields(ImageSegments)
    })  # fmt: skip


def no_segments() -> ImageSegments:
    """Give the edges of a photo without any."""
    pairs = np.zeros((0, 2))
    matrices = np.zeros((0, 2, 2))
    numbers, none = np.zeros(0, dtype=np.int64), np.zeros(0)
    return ImageSegments(pairs, pairs, pairs, matrices, none, none, numbers, matrices, np.zeros(0, dtype=bool))


def longest_first(segments: ImageSegments) -> ImageSegments:
    """Sort by length, the longest first; equal ones keep their order."""
    return segments[np.argsort(-segments.lengths, kind="stable")]
