"""Planes as connected groups of cells: region growing, rejection of curved groups, merging."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from algorithms.arrays import Array, Labels, Points, Scalars, Vector3
from algorithms.features.patches.patch_covariance import NUMERICAL_STD_M
from algorithms.features.planes.plane_curvature import LEAST_HALF_WIDTH_M, bent
from algorithms.features.planes.plane_curvature_kernels import sums_of_cells
from algorithms.features.planes.plane_points import CellPlanes, frames_of_moments
from algorithms.features.planes.plane_segmentation_kernels import (
    STEPS,
    agreements,
    candidate_labels,
    dilate_labels,
    grow_regions,
    incidences,
    ordered_seeds,
    renumber_labels,
    shift_rows,
    touching_labels,
    write_pieces,
)
from algorithms.scans.cell_sums_kernels import summed_moments
from algorithms.scans.point_blocks import blocks_of, over_blocks
from algorithms.scans.surface_cells import LEAST_CELLS, CellSurfaces, SurfaceCells

NORMAL_LIMIT = float(np.cos(np.deg2rad(15.0)))
"""Cosine of the largest angle between a cell's normal and its region's."""
FLATNESS = 0.4
"""Largest ratio of the deviations across and along a neighbourhood for its normal to be used."""
UNEVENNESS_M = 0.0015
"""Deviation of built surfaces from a plane over some metres (standard deviation; DIN 18202 allows 10 mm over 4 m).
Without it uneven floors break into pieces that differ from scan to scan; a door leaf 3 cm off its wall stays apart.
Chosen on tripod scans of a garage and of facades."""
FACING = 0.7
"""Least cosine of incidence of surfaces that face the instrument."""
FEW_FACING = 30
"""Fewer such neighbourhoods tell nothing; then all count."""
ENOUGH = 50_000
"""A quartile needs no more than the neighbourhoods of about so many cells."""
LEAST_SHARE = 0.5
"""Least share of the noise of ranges that is expected across a surface, however slanted it is seen."""
THICK_IN_NOISE, THICK_IN_UNEVENNESS = 4.0, 3.0
"""How far points of one plane may lie off it, in standard deviations of the noise and of the unevenness."""
ON_PLANE = 1.2
"""A region whose points deviate from a larger touching plane by less than so many standard deviations is part of it."""
EACH_ONCE = 0.0
"""Cap by which every cell counts once."""
CANDIDATES = 6
"""Planes remembered per cell for its points to choose from."""


@dataclass(frozen=True, eq=False)
class PlaneRegions:
    """k groups of cells, each on one plane."""

    cell_labels: Labels
    """(m,) region of each cell, -1 for none."""
    normals: Float64[Array, "k 3"]
    """(k, 3) unit normals; towards the sensor when the cells' normals are."""
    centroids: Float64[Array, "k 3"]
    """(k, 3) [m]."""
    noise_std_m: Float64[Array, "k"]
    """(k,) noise of single points across each, as its incidence lets expect [m]."""

    def __len__(self) -> int:
        return len(self.normals)


def typical_noise(cells: SurfaceCells, surfaces: CellSurfaces, sensor_m: Vector3 | None) -> float:
    """Give the deviation of points across flat surfaces that face the instrument [m].

    The error of a range shows across a surface with the cosine of the incidence, so surfaces seen at a slant look
    smoother than the scan is. Of the rest the lower quartile is taken, as relief only adds to noise.
    """
    thin = slice(None, None, max(1, len(cells) // ENOUGH))
    residuals = surfaces.residual_std_m[thin]
    flat = residuals < FLATNESS * surfaces.width_std_m[thin]
    if sensor_m is not None:
        facing = flat & (incidences(cells.means[thin], surfaces.normals[thin], sensor_m) > FACING)
        flat = facing if np.count_nonzero(facing) >= FEW_FACING else flat
    return float(np.quantile(residuals[flat], 0.25)) if flat.any() else 0.0


def noise_across(noise_std_m: float, positions: Points, normals: Points, sensor_m: Vector3 | None) -> Scalars:
    """Give the noise across surfaces at (n, 3) positions, (n,) [m]: that of the ranges times the cosine of incidence.

    It is never less than `LEAST_SHARE` of it: footprint, circle errors and relief do not shrink with the cosine.
    """
    if sensor_m is None:
        return np.full(len(positions), noise_std_m)
    cosines = incidences(positions, normals, sensor_m)
    return np.asarray(noise_std_m * np.clip(cosines, LEAST_SHARE, 1.0))


def thickness(noise_std_m: Scalars) -> Scalars:
    """Give how far points of one plane may lie off it [m]: four standard deviations and the unevenness of buildings."""
    return np.asarray(np.hypot(THICK_IN_NOISE * noise_std_m, THICK_IN_UNEVENNESS * UNEVENNESS_M))


def segment_planes(
    cells: SurfaceCells,
    surfaces: CellSurfaces,
    *,
    noise_std_m: float,
    sensor_m: Vector3 | None,
    cap: float,
    min_cells: int,
) -> PlaneRegions:
    """Group cells into planes.

    Parameters
    ----------
    cells, surfaces
        The cells and their tangent planes.
    noise_std_m
        Deviation of points from surfaces that face the instrument [m]: sets how far a cell may lie off a plane.
    sensor_m
        Where the instrument stood; without it the noise is taken for the same at every incidence.
    cap
        Largest weight of one cell in points.
    min_cells
        Smallest region kept.
    """
    pieces, steps = np.empty((len(cells), 8)), np.empty(len(cells), dtype=np.int32)
    sensor = np.full(3, np.nan) if sensor_m is None else sensor_m

    def write(start: int, end: int) -> None:
        write_pieces(
            cells.moments, surfaces.normals, surfaces.residual_std_m, surfaces.width_std_m, sensor, FLATNESS, cap,
            noise_std_m, LEAST_SHARE, (THICK_IN_NOISE, THICK_IN_UNEVENNESS * UNEVENNESS_M), start, end, pieces, steps,
        )  # fmt: skip

    over_blocks(write, len(cells), least=LEAST_CELLS)
    if cells.spread_m is not None:  # few points far away make poor seeds, however wide their cells are
        flat = steps < STEPS
        steps[flat] = steps[flat] // 2 + np.where(cells.spread_m[flat] > 0.0, STEPS // 2, 0)
    labels, count = grow_regions(ordered_seeds(steps), pieces, cells.neighbours, NORMAL_LIMIT, min_cells)
    curved = _curved(cells, labels, count)
    _renumber(labels, np.where(curved, -1, np.cumsum(~curved) - 1))
    moments = _merge(cells, labels, count - int(curved.sum()), noise_std_m, sensor_m, cap)
    _, normals, deviations = frames_of_moments(moments)
    # to the side that most of the cells' normals point to
    agreeing = over_blocks(
        lambda start, end: agreements(labels, pieces, normals, start, end), len(labels), least=LEAST_CELLS
    )
    normals[np.sum(agreeing, axis=0) < 0] *= -1.0
    centroids = np.ascontiguousarray(moments[:, 1:4])
    noise = noise_across(noise_std_m, centroids, normals, sensor_m)
    tolerances = 3.0 * np.maximum(deviations[:, 2], np.maximum(noise, NUMERICAL_STD_M))
    for _ in range(2):
        labels = _dilated(cells, labels, normals, centroids, tolerances)
    return PlaneRegions(labels, normals, centroids, noise)


def _dilated(
    cells: SurfaceCells,
    labels: Labels,
    normals: Float64[Array, "k 3"],
    centroids: Float64[Array, "k 3"],
    tolerances: Float64[Array, "k"],
) -> Labels:
    """Give cells without a label that of the neighbouring plane they lie on."""
    out = labels.copy()

    def work(start: int, end: int) -> None:
        dilate_labels(labels, cells.moments, cells.neighbours, normals, centroids, tolerances, start, end, out)

    over_blocks(work, len(cells), least=LEAST_CELLS)
    return out


def candidates_of(cells: SurfaceCells, regions: PlaneRegions) -> CellPlanes:
    """List the planes that each cell's points may belong to: those of the cell and of its neighbours."""
    labels, neighbours = regions.cell_labels, cells.neighbours
    only = np.empty(len(labels), dtype=np.int32)

    def work(start: int, end: int) -> Array:
        return candidate_labels(labels, neighbours, CANDIDATES, start, end, only)

    parts = over_blocks(work, len(labels), least=LEAST_CELLS)
    rows = 0
    for (start, end), part in zip(blocks_of(len(labels), least=LEAST_CELLS), parts, strict=True):
        shift_rows(only, rows, start, end)
        rows += len(part)
    return CellPlanes(only, np.concatenate(parts))


def _renumber(labels: Labels, numbers: Int64[Array, "k"]) -> None:
    """Give regions new numbers, -1 for none, in place."""
    over_blocks(lambda start, end: renumber_labels(labels, numbers, start, end), len(labels), least=LEAST_CELLS)


def _region_moments(cells: SurfaceCells, labels: Labels, count: int, cap: float) -> Float64[Array, "k 10"]:
    """Add the cells of every region: by blocks, and then the blocks."""
    parts = over_blocks(
        lambda start, end: summed_moments(cells.moments, labels, count, cap, start, end), len(labels), least=LEAST_CELLS
    )
    return _added(np.concatenate(parts), np.tile(np.arange(count, dtype=np.int32), len(parts)), count)


def _added(moments: Float64[Array, "r 10"], groups: Labels, count: int) -> Float64[Array, "k 10"]:
    """Add sets of points by groups: count, mean, central sums of products."""
    some = moments[:, 0] > 0.0
    moments = moments[some]
    total: Array = summed_moments(moments, groups[some], count, np.inf, 0, len(moments))
    return total


def _curved(cells: SurfaceCells, labels: Labels, count: int) -> Bool[Array, "k"]:
    """Find bent regions from the means of their cells."""
    regions = _region_moments(cells, labels, count, EACH_ONCE)
    bases, normals, deviations = frames_of_moments(regions)
    # an evenly filled strip is sqrt(3) standard deviations wide to each side
    half = np.maximum(np.sqrt(3.0) * deviations[:, :2], LEAST_HALF_WIDTH_M)

    def work(start: int, end: int) -> Array:
        return sums_of_cells(labels, cells.moments, regions, normals, bases, half, start, end)

    return bent(np.sum(over_blocks(work, len(labels), least=LEAST_CELLS), axis=0), half)


def _merge(
    cells: SurfaceCells, labels: Labels, count: int, noise_std_m: float, sensor_m: Vector3 | None, cap: float
) -> Float64[Array, "k 10"]:
    """Unite touching regions that are one plane within the noise: renumber `labels` and give the sums of what is left.

    These are count, mean and central sums of products.
    """
    moments = _region_moments(cells, labels, count, cap)
    if count < 2:
        return moments
    touch = np.zeros((count, count), dtype=np.bool_)
    over_blocks(
        lambda start, end: touching_labels(labels, cells.neighbours, start, end, touch), len(labels), least=LEAST_CELLS
    )
    pairs = np.argwhere(np.triu(touch, 1))
    numbers: Array = np.arange(count)
    for _ in range(5):
        _, normals, _ = frames_of_moments(moments)
        noise = noise_across(noise_std_m, np.ascontiguousarray(moments[:, 1:4]), normals, sensor_m)
        joined = pairs[_are_one_plane(pairs, moments, normals, noise)]
        if len(joined) == 0:
            break
        graph = coo_array((np.ones(len(joined)), joined.T), shape=(len(moments), len(moments)))
        groups, group = connected_components(graph, directed=False)
        numbers = group[numbers]
        moments = _added(moments, group.astype(np.int32), int(groups))
        first, second = np.sort(group[pairs].T.astype(np.int64), axis=0)
        pairs = np.column_stack(np.divmod(np.unique((first * groups + second)[first != second]), groups))
    _renumber(labels, numbers.astype(np.int64))
    return moments


def _are_one_plane(
    pairs: Int64[Array, "p 2"], moments: Float64[Array, "k 10"], normals: Float64[Array, "k 3"], noise: Scalars
) -> Bool[Array, "p"]:
    """Test of pairs of regions whether the smaller one continues the plane of the larger one.

    Either its points deviate from the larger plane hardly more than the noise explains, whatever plane they seem to
    form by themselves: chance picks tilted pieces out of noise that is wide compared with the distance of points. Or
    its mean distance and its mean square distance are explained: the distance by 1.5 standard deviations of a point
    and the usual unevenness, the tilt by what raises the smaller region's deviation by half.
    """
    first_is_larger = moments[pairs[:, 0], 0] >= moments[pairs[:, 1], 0]
    larger = np.where(first_is_larger, pairs[:, 0], pairs[:, 1])
    smaller = np.where(first_is_larger, pairs[:, 1], pairs[:, 0])
    normal, own_normal = normals[larger], normals[smaller]
    scatter = moments[smaller][:, [4, 5, 6, 5, 7, 8, 6, 8, 9]].reshape(-1, 3, 3) / moments[smaller, 0, None, None]
    distance = np.abs(np.einsum("pi,pi->p", normal, moments[smaller, 1:4] - moments[larger, 1:4]))
    across = np.sqrt(np.maximum(np.einsum("pi,pij,pj->p", normal, scatter, normal), 0.0))
    own = np.sqrt(np.maximum(np.einsum("pi,pij,pj->p", own_normal, scatter, own_normal), 0.0))
    parallel = np.abs(np.einsum("pi,pi->p", normal, own_normal)) >= NORMAL_LIMIT
    near = distance < 1.5 * np.hypot(noise[larger], UNEVENNESS_M)
    flush = across < 1.5 * np.hypot(own, UNEVENNESS_M)
    return np.asarray((np.hypot(distance, across) < ON_PLANE * noise[larger]) | (parallel & near & flush))
