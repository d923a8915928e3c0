"""The extent of planes: rasters of occupied cells and their outlines."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float64, Int64

from algorithms.arrays import Array, Indices, Points, Scalars, Vectors2
from algorithms.features.planes.plane_fitting import FittedPlanes
from algorithms.features.planes.plane_points import plane_frames
from algorithms.features.planes.plane_points_kernels import fill_rasters
from algorithms.geometry.planes import Planes
from algorithms.scans.point_blocks import over_blocks
from algorithms.scans.surface_cells import SurfaceCells

LARGEST_RASTER = 400
"""Cells along the longer side."""
BORDER = 4
"""Free cells around every raster, room for dilation."""
LEAST_PLANES = 16
"""Fewer planes are not worth a thread's while."""
SMALLEST_RING = 12
"""Pieces and holes below three raster cells (in quarter cells) are left out of the outline."""


@dataclass(frozen=True, eq=False)
class PlaneRasters:
    """Which cells of each plane hold points; raster p is flat[starts[p]:starts[p + 1]], row by row."""

    flat: Array
    """(sum,) uint8."""
    starts: Int64[Array, "starts"]
    rows: Int64[Array, "k"]
    columns: Int64[Array, "k"]
    origins: Float64[Array, "k 2"]
    """(k, 2) corner (u, v) of cell (0, 0) [m]."""
    cell_sizes: Float64[Array, "k"]
    """(k,) [m]."""

    def __len__(self) -> int:
        return len(self.cell_sizes)

    def of(self, p: int) -> Array:
        """Give the raster of plane p, (rows, columns)."""
        return self.flat[self.starts[p] : self.starts[p + 1]].reshape(self.rows[p], self.columns[p])

    def select(self, which: Indices) -> "PlaneRasters":
        """Keep some of the planes."""
        parts = [self.flat[self.starts[p] : self.starts[p + 1]] for p in which]
        return PlaneRasters(
            np.concatenate([np.empty(0, dtype=np.uint8), *parts]),
            np.concatenate([[0], np.cumsum([len(part) for part in parts])]).astype(np.int64),
            self.rows[which],
            self.columns[which],
            self.origins[which],
            self.cell_sizes[which],
        )


def bound_planes(
    points: Points,
    fitted: FittedPlanes,
    cells: SurfaceCells,
    least_cell_m: float,
    *,
    min_area_m2: float,
    max_planes: int,
) -> tuple[Planes, PlaneRasters, Int64[Array, "kept"]]:
    """Outline fitted planes and keep the large ones, those of most points first.

    Returns
    -------
    The planes, their rasters, and which of the fitted planes they were.
    """
    order = np.argsort(-fitted.point_counts, kind="stable")
    order = order[:max_planes].astype(np.int64)
    selected = fitted.select(order)
    rasters = rasterise_planes(points, selected, cells, least_cell_m)
    polygons, areas = boundaries_of(rasters)
    large = np.flatnonzero(areas >= min_area_m2)
    kept = selected.select(large)
    polygons = [polygons[p] for p in large]
    planes = Planes(
        normals=kept.normals,
        centroids=kept.centroids,
        bases=kept.bases,
        covariances=kept.covariances,
        noise_std_m=kept.noise_std_m,
        point_counts=kept.point_counts,
        areas_m2=areas[large],
        boundary=np.concatenate([np.empty((0, 2)), *polygons]),
        boundary_splits=np.concatenate([[0], np.cumsum([len(p) for p in polygons])]).astype(np.int64),
    )
    return planes, rasters.select(large), order[large]


def rasterise_planes(points: Points, planes: FittedPlanes, cells: SurfaceCells, least_cell_m: float) -> PlaneRasters:
    """Mark the occupied cells of every plane, with cells of about four points, and close the pores between them.

    Where points are sparse they stand for the surface around them as far as their scan's cells are wide.
    """
    spans = np.maximum(planes.extents[:, 2:] - planes.extents[:, :2], 1e-6)
    spacing = np.sqrt(spans[:, 0] * spans[:, 1] / np.maximum(planes.point_counts, 1))
    sizes = np.maximum(np.maximum(2.0 * spacing, least_cell_m), spans.max(axis=1, initial=0.0) / LARGEST_RASTER)
    columns = (spans[:, 0] / sizes).astype(np.int64) + 1 + 2 * BORDER
    rows = (spans[:, 1] / sizes).astype(np.int64) + 1 + 2 * BORDER
    starts = np.concatenate([[0], np.cumsum(rows * columns)]).astype(np.int64)
    origins = planes.extents[:, :2] - BORDER * sizes[:, None]
    frames = plane_frames(planes.normals, planes.centroids, planes.bases, planes.noise_std_m)
    labels, numbers = planes.point_labels, planes.numbers
    flat = np.zeros(starts[-1], dtype=np.uint8)
    cell_of_point, spread = cells.cell_of_point, np.empty(0) if cells.spread_m is None else cells.spread_m

    def fill(start: int, end: int) -> None:
        fill_rasters(
            points, labels, numbers, frames, origins, 1.0 / sizes, starts, rows, columns, BORDER,
            cell_of_point, spread, start, end, flat,
        )  # fmt: skip

    over_blocks(fill, len(points))
    rasters = PlaneRasters(flat, starts, rows, columns, origins, sizes)
    kernel = np.ones((3, 3), dtype=np.uint8)
    for p in range(len(rasters)):
        rasters.of(p)[:] = cv2.morphologyEx(rasters.of(p), cv2.MORPH_CLOSE, kernel)
    return rasters


def outline(raster: Array) -> Vectors2:
    """Trace the occupied cells of a raster as one polygon, (n, 2) of (column, row), cell (0, 0) spanning 0..1.

    Several pieces and holes are joined by seams that are walked to and fro, so that area (holes taken off) and the
    even-odd rule stay right. The outline runs a quarter of a cell inside the cells' outer borders.
    """
    enlarged = raster.repeat(2, axis=0).repeat(2, axis=1)
    rings, hierarchy = cv2.findContours(enlarged, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    is_hole = hierarchy[0][:, 3] >= 0
    areas = [cv2.contourArea(ring) for ring in rings]
    order = sorted(range(len(rings)), key=lambda i: -areas[i])
    kept = [i for i in order if areas[i] >= SMALLEST_RING] or order[:1]
    simplified = [_turned(cv2.approxPolyDP(rings[i], 1.0, closed=True)[:, 0], clockwise=bool(is_hole[i])) for i in kept]
    if len(simplified) > 1:
        home = simplified[0][:1]
        simplified = [np.concatenate([ring, ring[:1], home]) for ring in simplified]
    return (np.concatenate(simplified) + 0.5) / 2.0


def _turned(ring: Array, *, clockwise: bool) -> Array:
    """Give a ring the wanted sense of rotation."""
    return ring if (signed_area(ring.astype(np.float64)) < 0) == clockwise else ring[::-1]


def signed_area(polygon: Vectors2) -> float:
    """Give the area inside a polygon (shoelace formula), negative when it runs clockwise."""
    x, y = polygon.T
    return 0.5 * float(x[:-1] @ y[1:] - y[:-1] @ x[1:] + x[-1] * y[0] - y[-1] * x[0])


def boundaries_of(rasters: PlaneRasters) -> tuple[list[Array], Scalars]:
    """Give the outline of every plane in plane coordinates [m], and its area [m2]."""

    def work(start: int, end: int) -> list[Array]:
        return [outline(rasters.of(p)) * rasters.cell_sizes[p] + rasters.origins[p] for p in range(start, end)]

    polygons = [polygon for part in over_blocks(work, len(rasters), least=LEAST_PLANES) for polygon in part]
    return polygons, np.array([abs(signed_area(polygon)) for polygon in polygons], dtype=np.float64)
