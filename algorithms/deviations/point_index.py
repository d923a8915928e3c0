"""Points sorted into cubic cells, so that all within a sphere or cylinder are found without looking at the others."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from algorithms.arrays import Array, Points, Vector3
from algorithms.deviations import point_index_kernels as kernels
from algorithms.scans.voxel_grid import MOST_ALONG_AN_AXIS, hash_into_voxels
from algorithms.scans.voxel_grid_kernels import table_of


@dataclass(frozen=True, eq=False)
class PointIndex:
    """n points in the order of their m cells."""

    points: Points
    """(n, 3) cell by cell [m]."""
    order: Int64[Array, "n"]
    """(n,) place of each of them in the cloud."""
    starts: Int64[Array, "m_and_1"]
    """(m + 1,) first point of each cell; the last entry is n."""
    keys: Int64[Array, "m"]
    """(m,) voxels in ascending order."""
    moments: Float64[Array, "m 10"]
    """(m, 10) count, mean, central sums of products of each cell's points."""
    table: Int64[Array, "capacity 2"]
    """Hash table from voxels to cells."""
    lower_m: Vector3
    size_m: float
    """Edge of a cell [m]."""

    def __len__(self) -> int:
        return len(self.points)


def index_points(points: Points, cell_m: float) -> PointIndex:
    """Sort points into cells; O(n) time, 32 bytes a point.

    Parameters
    ----------
    points
        (n, 3) finite coordinates, reduced to a near origin [m].
    cell_m
        Wished edge of a cell; it is larger where the extent would need too many cells.

    Raises
    ------
    InvalidInputError
        Without points.
    """
    extent = float(np.max(np.ptp(points, axis=0))) if len(points) else 0.0
    voxels = hash_into_voxels(points, max(cell_m, extent / (MOST_ALONG_AN_AXIS - 1)))
    cells = len(voxels.keys)
    starts, order = kernels.sorted_by_cell(voxels.cell_of_point, cells)
    return PointIndex(
        points=np.ascontiguousarray(points[order]),
        order=order,
        starts=starts,
        keys=voxels.keys,
        moments=voxels.moments,
        table=table_of(voxels.keys, cells, 1 << max(4 * cells, 2).bit_length()),
        lower_m=voxels.lower_m,
        size_m=voxels.size_m,
    )
