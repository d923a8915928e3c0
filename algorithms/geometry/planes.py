"""Bounded planes with uncertainty."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, Bases, Indices, Matrices3, Points, RaggedPoints2, Scalars, Splits


@dataclass(frozen=True, eq=False)
class Planes:
    """n bounded planes in one frame, column by column."""

    normals: Points
    """(n, 3) unit normals, pointing to the side the plane was seen from."""
    centroids: Points
    """(n, 3) centroids of the plane's points [m]; n.x = n.c for x on the plane."""
    bases: Bases
    """(n, 3, 2) columns E1, E2 with (E1, E2, n) right-handed; E1 along the longest extent."""
    covariances: Matrices3
    """(n, 3, 3) covariance of (a1, a2, b): n -> n + E a, c -> c + n b [rad, m]."""
    noise_std_m: Scalars
    """(n,) standard deviation of single points from the plane [m]."""
    point_counts: Indices
    """(n,) number of points."""
    areas_m2: Scalars
    """(n,) area of the boundary polygon(s) [m2]."""
    boundary: RaggedPoints2
    """(m, 2) all boundary polygons one after the other, in plane coordinates ((x - c).E1, (x - c).E2) [m]."""
    boundary_splits: Splits
    """(n + 1,) polygon of plane k is boundary[splits[k]:splits[k + 1]], closed implicitly."""

    def __len__(self) -> int:
        return len(self.normals)

    def boundary_of(self, k: int) -> Array:
        """Give the boundary polygon of plane k, (p, 2), in plane coordinates [m]."""
        return self.boundary[self.boundary_splits[k] : self.boundary_splits[k + 1]]

    def without_boundaries(self, which: "Array | slice") -> "Planes":
        """Select planes by an index array, mask or slice, and forget their boundaries."""
        count = len(self.areas_m2[which])
        return Planes(
            self.normals[which],
            self.centroids[which],
            self.bases[which],
            self.covariances[which],
            self.noise_std_m[which],
            self.point_counts[which],
            self.areas_m2[which],
            np.empty((0, 2)),
            np.zeros(count + 1, dtype=np.int64),
        )

    @staticmethod
    def joined(parts: "Sequence[Planes]") -> "Planes":
        """Put planes of several frames one after the other, without boundaries; at least one part."""
        return Planes(
            np.concatenate([part.normals for part in parts]),
            np.concatenate([part.centroids for part in parts]),
            np.concatenate([part.bases for part in parts]),
            np.concatenate([part.covariances for part in parts]),
            np.concatenate([part.noise_std_m for part in parts]),
            np.concatenate([part.point_counts for part in parts]),
            np.concatenate([part.areas_m2 for part in parts]),
            np.empty((0, 2)),
            np.zeros(sum(len(part) for part in parts) + 1, dtype=np.int64),
        )

    @property
    def offsets(self) -> Array:
        """(n,) distances h = n.c of the planes from the frame's origin [m]."""
        return np.asarray(np.einsum("ij,ij->i", self.normals, self.centroids))
