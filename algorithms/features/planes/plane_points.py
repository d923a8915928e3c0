"""What the points of a scan say of planes that are nearly known: which point is whose, and the sums over them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int32, Int64

from algorithms.arrays import Array, Bases, Labels, Points, Scalars
from algorithms.features.planes import plane_points_kernels as kernels
from algorithms.scans.point_blocks import over_blocks
from algorithms.scans.surface_cells import LEAST_CELLS, SurfaceCells

WHOLE = 0.5
"""Cells whose points deviate from their only plane by less than that share of its tolerance (root mean square) lie on
it as a whole."""


@dataclass(frozen=True, eq=False)
class CellPlanes:
    """Which planes the points of m cells may belong to."""

    only: Labels
    """(m,) the plane where there is but one, -1 for none, -2 - q for those in row q of `several`."""
    several: Int32[Array, "rows width"]
    """(rows, width) planes, -1 padded."""


@dataclass(frozen=True, eq=False)
class PartedCells:
    """Which cells belong to a plane as a whole, and which points must be looked at."""

    whole: Int32[Array, "m"]
    """(m,) plane of every cell that lies on it as a whole, -1 for others."""
    points: Float64[Array, "r 3"]
    """(r, 3) points of the other cells that have a plane, in the order of the scan [m]."""
    cell_of_point: Int32[Array, "r"]
    """(r,) their cells."""


@dataclass(frozen=True, eq=False)
class LabelledPoints:
    """Which of k planes n points belong to, and what the points of each plane add up to."""

    labels: Labels
    """(n,) nearest plane of each point within its tolerance, -1 for none."""
    shared: Bool[Array, "n"]
    """(n,) True for points within the tolerance of two planes: they extend a plane but must not shape it."""
    moments: Float64[Array, "k 10"]
    """(k, 10) of points that are not shared: count, mean, central sums of products."""
    counts: Int64[Array, "k"]
    """(k,) all points."""
    extents: Float64[Array, "k 4"]
    """(k, 4) bounding rectangles of all points in plane coordinates [m]."""


def plane_frames(normals: Points, centroids: Points, bases: Bases, tolerances: Scalars) -> Float64[Array, "n 13"]:
    """Put planes side by side for the compiled passes: normal, centroid, E1, E2, tolerance."""
    return np.column_stack([normals, centroids, bases[:, :, 0], bases[:, :, 1], tolerances])


def frames_of_moments(
    moments: Float64[Array, "k 10"],
) -> tuple[Float64[Array, "k 3 2"], Float64[Array, "k 3"], Float64[Array, "k 3"]]:
    """Give basis (E1 longest), normal and the standard deviations along E1, E2, n of every row of moments."""
    k = len(moments)
    counts = np.maximum(moments[:, 0], 1.0)
    scatter = moments[:, [4, 5, 6, 5, 7, 8, 6, 8, 9]].reshape(k, 3, 3) / counts[:, None, None]
    values, vectors = np.linalg.eigh(scatter)
    normals = np.ascontiguousarray(vectors[:, :, 0])
    e1 = vectors[:, :, 2]
    bases = np.stack([e1, np.cross(normals, e1)], axis=2)
    return bases, normals, np.sqrt(np.maximum(values[:, ::-1], 0.0))


def part_cells(
    points: Points, cells: SurfaceCells, candidates: CellPlanes, frames: Float64[Array, "k 13"]
) -> PartedCells:
    """Tell cells that lie on their only plane as a whole from those whose points must be looked at one by one."""
    whole, parted = np.empty_like(candidates.only), np.empty_like(candidates.only)

    def work(start: int, end: int) -> None:
        kernels.part_cells(cells.moments, candidates.only, frames, WHOLE, start, end, whole, parted)

    over_blocks(work, len(whole), least=LEAST_CELLS)
    parts = over_blocks(
        lambda start, end: kernels.points_of_cells(points, cells.cell_of_point, parted, start, end), len(points)
    )
    return PartedCells(whole, *(np.concatenate(column) for column in zip(*parts, strict=True)))


def planes_moments(
    cells: SurfaceCells, candidates: CellPlanes, parted: PartedCells, frames: Float64[Array, "k 13"]
) -> Float64[Array, "k 10"]:
    """Sum the points that are nearest to each plane, and near no other, among the candidates of their cell.

    Cells that lie on their plane as a whole are added without a look at their points. So points of theirs that lie off
    it by more than its tolerance count here; there are few, and this takes a fifth of the time.
    """

    def add_cells(start: int, end: int) -> Array:
        return kernels.sum_cells(cells.moments, parted.whole, frames, start, end)

    def add_points(start: int, end: int) -> Array:
        return kernels.sum_planes(
            parted.points, parted.cell_of_point, candidates.only, candidates.several, frames, start, end
        )

    sums = over_blocks(add_cells, len(parted.whole), least=LEAST_CELLS)
    return _added(sums + over_blocks(add_points, len(parted.points)), frames)


def label_points(
    points: Points, cell_of_point: Labels, candidates: CellPlanes, frames: Float64[Array, "k 13"]
) -> LabelledPoints:
    """Give every point the nearest plane among the candidates of its cell, and sum the planes' points."""
    labels = np.empty(len(points), dtype=np.int32)
    shared = np.empty(len(points), dtype=np.bool_)
    only, several = candidates.only, candidates.several

    def work(start: int, end: int) -> tuple[Array, Array, Array]:
        return kernels.label_points(points, cell_of_point, only, several, frames, start, end, labels, shared)

    parts = over_blocks(work, len(points))
    low = np.min([extents[:, :2] for _, _, extents in parts], axis=0)
    high = np.max([extents[:, 2:] for _, _, extents in parts], axis=0)
    return LabelledPoints(
        labels,
        shared,
        _added([sums for sums, _, _ in parts], frames),
        np.sum([counts for _, counts, _ in parts], axis=0),
        np.concatenate([low, high], axis=1),
    )


def _added(parts: list[Array], frames: Float64[Array, "k 13"]) -> Float64[Array, "k 10"]:
    """Add the sums of blocks, taken about the centroids of the frames: count, mean, central sums of products."""
    sums: Array = np.sum(parts, axis=0)
    counts = np.maximum(sums[:, 0], 1.0)
    shift = sums[:, 1:4] / counts[:, None]
    moments = sums.copy()
    moments[:, 1:4] = shift + frames[:, 3:6]
    for column, (a, b) in enumerate(((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)), start=4):
        moments[:, column] -= sums[:, 0] * shift[:, a] * shift[:, b]
    return moments
