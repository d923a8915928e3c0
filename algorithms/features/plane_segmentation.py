"""Planes as connected groups of cells: region growing, rejection of curved groups, merging."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from algorithms.arrays import Array, Labels, Points, Scalars, Vector3
from algorithms.features.patch_covariance import NUMERICAL_STD_M
from algorithms.features.plane_curvature import LEAST_HALF_WIDTH_M, bent
from algorithms.features.plane_curvature_kernels import sums_of_cells
from algorithms.features.plane_points import CellPlanes, frames_of_moments
from algorithms.features.plane_segmentation_kernels import (
    agreements,
    candidate_labels,
    dilate_labels,
    grow_regions,
    incidences,
    region_moments,
    touching_labels,
)
from algorithms.scans.point_blocks import over_blocks
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
ENOUGH = 100_000
"""A quartile needs no more neighbourhoods than about so many."""
LEAST_SHARE = 0.5
"""Least share of the noise of ranges that is expected across a surface, however slanted it is seen."""
ON_PLANE = 1.2
"""A region whose points deviate from a larger touching plane by less than so many standard deviations is part of it."""
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
    flat = surfaces.residual_std_m < FLATNESS * surfaces.width_std_m
    if sensor_m is not None:
        facing = flat & (incidences(cells.means, surfaces.normals, sensor_m) > FACING)
        flat = facing if np.count_nonzero(facing) >= FEW_FACING else flat
    residuals = surfaces.residual_std_m[flat]
    return float(np.quantile(residuals[:: max(1, len(residuals) // ENOUGH)], 0.25)) if len(residuals) else 0.0


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
    return np.asarray(np.hypot(4.0 * noise_std_m, 3.0 * UNEVENNESS_M))


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
    flat = surfaces.residual_std_m < FLATNESS * surfaces.width_std_m
    normals = np.where(flat[:, None], surfaces.normals, 0.0)
    noise = noise_across(noise_std_m, cells.means, normals, sensor_m)
    seeds = np.flatnonzero(flat)
    quality = surfaces.residual_std_m[seeds] / surfaces.width_std_m[seeds]
    # in steps of a 65536th of the limit, which are sorted by counting
    steps = (quality * (np.iinfo(np.uint16).max / FLATNESS)).astype(np.uint16)
    order = seeds[np.argsort(steps, kind="stable")].astype(np.int32)
    labels, count = grow_regions(
        order, cells.moments, normals, cells.neighbours, cap, NORMAL_LIMIT, thickness(noise), min_cells
    )
    labels = _drop(labels, _curved(cells, labels, count))
    labels = _merge(cells, labels, noise_std_m, sensor_m, cap)
    moments = region_moments(cells.moments, cells.counts, labels, int(labels.max(initial=-1)) + 1, cap)
    _, region_normals, deviations = frames_of_moments(moments)
    region_normals = _orient(region_normals, normals, labels)
    centroids = np.ascontiguousarray(moments[:, 1:4])
    noise = noise_across(noise_std_m, centroids, region_normals, sensor_m)
    tolerances = 3.0 * np.maximum(deviations[:, 2], np.maximum(noise, NUMERICAL_STD_M))
    for _ in range(2):
        labels = _dilated(cells, labels, region_normals, centroids, tolerances)
    return PlaneRegions(labels, region_normals, centroids, noise)


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
    return CellPlanes(*candidate_labels(regions.cell_labels, cells.neighbours, CANDIDATES))


def _drop(labels: Labels, dropped: Bool[Array, "k"]) -> Labels:
    """Remove regions and number the rest anew."""
    numbers = np.where(dropped, -1, np.cumsum(~dropped) - 1).astype(np.int32)
    return np.asarray(np.where(labels >= 0, numbers[labels] if len(numbers) else -1, -1), dtype=np.int32)


def _orient(region_normals: Float64[Array, "k 3"], normals: Points, labels: Labels) -> Float64[Array, "k 3"]:
    """Turn region normals to the side most of their cells' normals point to."""
    side = agreements(labels, normals, region_normals)
    return np.asarray(np.where(side[:, None] < 0, -region_normals, region_normals))


def _curved(cells: SurfaceCells, labels: Labels, count: int) -> Bool[Array, "k"]:
    """Find bent regions from the means of their cells."""
    regions = region_moments(cells.moments, np.ones(len(cells)), labels, count, 1.0)
    bases, normals, deviations = frames_of_moments(regions)
    # an evenly filled strip is sqrt(3) standard deviations wide to each side
    half = np.maximum(np.sqrt(3.0) * deviations[:, :2], LEAST_HALF_WIDTH_M)
    return bent(sums_of_cells(labels, cells.moments, regions, normals, bases, half), half)


def _merge(cells: SurfaceCells, labels: Labels, noise_std_m: float, sensor_m: Vector3 | None, cap: float) -> Labels:
    """Unite touching regions that are one plane within the noise."""
    count = int(labels.max(initial=-1)) + 1
    if count < 2:
        return labels
    moments = region_moments(cells.moments, cells.counts, labels, count, cap)
    touch = touching_labels(labels, cells.neighbours, count)
    numbers: Array = np.arange(count)
    for _ in range(5):
        _, normals, _ = frames_of_moments(moments)
        noise = noise_across(noise_std_m, np.ascontiguousarray(moments[:, 1:4]), normals, sensor_m)
        pairs = np.argwhere(np.triu(touch, 1))
        joined = pairs[_are_one_plane(pairs, moments, normals, noise)]
        if len(joined) == 0:
            break
        graph = coo_array((np.ones(len(joined)), joined.T), shape=(len(moments), len(moments)))
        groups, group = connected_components(graph, directed=False)
        numbers = group[numbers]
        moments = region_moments(moments, moments[:, 0], group.astype(np.int32), int(groups), np.inf)
        wider = np.zeros((groups, groups), dtype=np.bool_)
        i, j = np.nonzero(touch)
        wider[group[i], group[j]] = True
        touch = wider
    return np.where(labels >= 0, numbers[labels], -1).astype(np.int32)


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
