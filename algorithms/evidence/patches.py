"""The surface of a scan cut into patches, and patches into pieces that move, or fit by chance, as a whole."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from algorithms.arrays import Array, Flags
from algorithms.features.scan_features import ScanFeatures
from algorithms.numbered_rows import numbered_rows
from algorithms.scans.pose_scores import FINAL_POINTS

PATCH_M = 0.5
"""Within this length neighbouring points err alike (`registration.neighbourhood_covariance`): one statement a patch."""
BLOCK_PATCHES = 4
"""Of surface that belongs to no plane, a cube of so many patches along each edge is a piece."""


@dataclass(frozen=True, eq=False)
class Patches:
    """n surface points of a scan in p patches, and these in q pieces."""

    of_point: Int64[Array, "n"]
    """(n,) number of the patch of each point."""
    points: Float64[Array, "p"]
    """(p,) points in each patch."""
    piece: Int64[Array, "p"]
    """(p,) number of the piece of each patch: a plane of the scan, or a block of what belongs to none."""
    cubes: Int64[Array, "p 3"]
    """(p, 3) whole coordinates of the patches, in `PATCH_M`: of patches beside each other they differ by one."""
    centres: Float64[Array, "p 3"]
    """(p, 3) mean of the points, reduced frame [m]."""
    normals: Float64[Array, "p 3"]
    """(p, 3) mean of the unit normals; shorter than one where they differ."""

    @property
    def pieces(self) -> int:
        """Number of pieces."""
        return int(self.piece.max()) + 1 if len(self.piece) else 0

    @classmethod
    def of(cls, scan: ScanFeatures, points: int = FINAL_POINTS) -> "Patches":
        """Cut the first `points` of the even sample of a scan's surface. O(n log n)."""
        index = scan.index
        n = min(points, len(index.points))
        places = index.points[:n]
        cubes = np.floor((places - places.min(axis=0, initial=0.0)) / PATCH_M).astype(np.int64)
        planes = scan.surface.plane_labels[index.numbers[:n]]
        keys, of_point = numbered_rows(np.column_stack([cubes, planes]))
        counts = np.bincount(of_point, minlength=len(keys)).astype(np.float64)
        on_plane = keys[:, 3] >= 0
        blocks = np.where(on_plane[:, None], 0, keys[:, :3] // BLOCK_PATCHES)
        _, piece = numbered_rows(np.column_stack([blocks, keys[:, 3]]))
        return cls(
            of_point,
            counts,
            piece,
            keys[:, :3],
            _means(of_point, places, counts),
            _means(of_point, index.normals[:n], counts),
        )

    def shares(self, true_of: Flags) -> Float64[Array, "p"]:
        """Give the share of each patch's points of which something is true, (p,)."""
        return np.asarray(np.bincount(self.of_point, true_of, len(self.points)) / self.points)


def _means(groups: Array, values: Array, counts: Array) -> Array:
    sums = [np.bincount(groups, values[:, k], len(counts)) for k in range(3)]
    return np.asarray(np.column_stack(sums) / counts[:, None])
