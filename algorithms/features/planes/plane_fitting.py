"""Planes refined from single points, with covariance from patches."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float64, Int32, Int64

from algorithms.arrays import Array, Bases, Indices, Labels, Matrices3, Points, Scalars, Vector3
from algorithms.features.patches.patch_covariance import (
    NUMERICAL_STD_M,
    adjust_patches,
    estimate_wavinesses,
)
from algorithms.features.planes.plane_curvature import curved_regions
from algorithms.features.planes.plane_points import (
    CellPlanes,
    LabelledPoints,
    frames_of_moments,
    label_points,
    part_cells,
    plane_frames,
    planes_moments,
)
from algorithms.features.planes.plane_points_kernels import patch_systems, sum_patches
from algorithms.features.planes.plane_responses import plane_responses
from algorithms.features.planes.plane_rounding import PatchRounding, patch_rounding
from algorithms.geometry.lines import bases_of
from algorithms.scans.coordinate_steps import FULL_PRECISION, CoordinateSteps
from algorithms.scans.instrument_errors import Sweep
from algorithms.scans.point_blocks import over_blocks
from algorithms.scans.surface_cells import SurfaceCells

PATCHES = 32
"""Aimed number of patches per plane: enough to estimate a variance, large enough to carry long waves."""
POINTS_PER_PATCH = 4.0
"""Least mean number of points in a patch."""
STEADY = 50.0
"""The scatter of a plane counts as so many points in that of each of its patches: variances from few points are weights
of luck, which cost accuracy and promise too much (with ten, the covariance is a tenth too small)."""
LEAST_COSINE = 0.3
"""Noise that is there at grazing incidence too (circle errors, footprint, relief), as share of that of the ranges.
Seen in indoor scans of a tilting laser (0.4) and of a hall (0.3)."""
TRIM = 3.5
"""Points farther than that many standard deviations do not belong to a plane."""
LEAST_WIDTH = 2.5
"""Least ratio of the deviations along the narrow side and across a plane."""


@dataclass(frozen=True, eq=False)
class FittedPlanes:
    """Unbounded planes with covariance, and which point belongs to which."""

    normals: Float64[Array, "k 3"]
    centroids: Float64[Array, "k 3"]
    bases: Float64[Array, "k 3 2"]
    """(k, 3, 2) columns E1 (longest extent), E2."""
    covariances: Float64[Array, "k 3 3"]
    """(k, 3, 3) of (a1, a2, b)."""
    rounding_covariances: Float64[Array, "k 3 3"]
    """(k, 3, 3) the same by rounded coordinates alone, of the surface as such, near and far parts of it alike."""
    responses: Float64[Array, "k 3 11"]
    """(k, 3, 11) derivatives of (a1, a2, b) by instrument errors and drifts; zero where no position is known."""
    noise_std_m: Float64[Array, "k"]
    point_counts: Int64[Array, "k"]
    extents: Float64[Array, "k 4"]
    """(k, 4) bounding rectangles u_min, v_min, u_max, v_max in plane coordinates [m]."""
    point_labels: Labels
    """(n,) label of each point, -1 for none."""
    numbers: Int32[Array, "labels"]
    """(labels,) plane of each label, -1 for none: so planes are chosen without another pass over the points."""

    def __len__(self) -> int:
        return len(self.normals)

    def select(self, which: Indices) -> "FittedPlanes":
        """Keep some of the planes."""
        return FittedPlanes(
            self.normals[which],
            self.centroids[which],
            self.bases[which],
            self.covariances[which],
            self.rounding_covariances[which],
            self.responses[which],
            self.noise_std_m[which],
            self.point_counts[which],
            self.extents[which],
            self.point_labels,
            renumber(self.numbers, which),
        )


def renumber(labels: Labels, kept: Int64[Array, "k"]) -> Labels:
    """Give labels new numbers: kept[i] becomes i, all others -1."""
    numbers = np.full(max(int(labels.max(initial=-1)), int(kept.max(initial=-1))) + 2, -1, dtype=np.int32)
    numbers[kept] = np.arange(len(kept))
    return np.asarray(numbers[labels])  # label -1 takes the last entry, which stays -1


def fit_planes(
    points: Points,
    cells: SurfaceCells,
    candidates: CellPlanes,
    normals: Float64[Array, "k 3"],
    centroids: Float64[Array, "k 3"],
    noise_std_m: Float64[Array, "k"],
    *,
    thickness_m: Float64[Array, "k"],
    sensor_m: Vector3 | None,
    min_points: int,
    steps: CoordinateSteps = FULL_PRECISION,
    sweep: Sweep | None = None,
    rounds: int = 3,
) -> tuple[FittedPlanes, Int64[Array, "kept"]]:
    """Assign points to approximate planes and fit each from its points.

    Parameters
    ----------
    points
        (n, 3) points.
    cells
        The cells that partition them.
    candidates
        Planes that may hold points of each cell.
    normals, centroids
        Approximate planes; the fitted normals keep their side.
    noise_std_m
        (k,) approximate standard deviation of points from each plane [m].
    thickness_m
        (k,) no point farther from a plane than this belongs to it [m].
    sensor_m
        Where the instrument stood; without it the noise is taken for the same all over a plane.
    min_points
        Planes of fewer points are dropped, and those that are hardly wider than their noise.
    steps
        What the coordinates are rounded to: points on the next step belong to a plane as well.
    sweep
        When the instrument looked where; None: nobody knows.
    rounds
        How often points are assigned and planes fitted.

    Returns
    -------
    The fitted planes, and which of the approximate planes they were.
    """
    frames = plane_frames(normals, centroids, bases_of(normals), thickness_m)
    parted = part_cells(points, cells, candidates, frames)
    for _ in range(rounds - 1):
        moments = planes_moments(cells, candidates, parted, frames)
        bases, fitted, deviations = frames_of_moments(moments)
        flip = np.einsum("ij,ij->i", fitted, normals) < 0
        fitted[flip] *= -1.0
        bases[flip, :, 1] *= -1.0
        noise = deviations[:, 2] * np.sqrt(moments[:, 0] / np.maximum(moments[:, 0] - 3.0, 1.0))
        least = np.maximum(0.5 * TRIM * noise_std_m, TRIM * steps.std_across_m(fitted))
        limits = np.clip(TRIM * noise, np.maximum(least, NUMERICAL_STD_M), thickness_m)
        enough = moments[:, 0] >= 4
        frames = np.where(enough[:, None], plane_frames(fitted, moments[:, 1:4], bases, limits), frames)
        frames[:, 12] = limits
    labelled = label_points(points, cells.cell_of_point, candidates, frames)
    moments = labelled.moments
    _, _, deviations = frames_of_moments(moments)
    kept = np.flatnonzero((moments[:, 0] >= min_points) & (deviations[:, 1] > LEAST_WIDTH * deviations[:, 2]))
    final = _carried(frames[kept], moments[kept])
    axes = frames[kept, 6:12].reshape(-1, 2, 3)
    shift = np.einsum("kji,ki->kj", axes, final[:, 3:6] - frames[kept, 3:6])
    extents = labelled.extents[kept] - np.tile(shift, 2)
    numbers = renumber(np.arange(len(normals), dtype=np.int32), kept)
    planes, flat = _from_points(
        points, labelled, numbers, final, labelled.counts[kept], extents, sensor_m, steps, sweep
    )
    return planes.select(flat), kept[flat]


def _carried(frames: Float64[Array, "k 13"], moments: Float64[Array, "k 10"]) -> Float64[Array, "k 13"]:
    """Move planes to where the sums of their points lie, keeping the directions of their bases."""
    _, normals, _ = frames_of_moments(moments)
    normals *= np.where(np.einsum("ij,ij->i", normals, frames[:, :3]) < 0.0, -1.0, 1.0)[:, None]
    return plane_frames(normals, moments[:, 1:4], _carried_bases(frames[:, 6:9], normals), frames[:, 12])


def _carried_bases(first: Points, normals: Points) -> Bases:
    """Give bases whose first vectors are as near as possible to the given ones."""
    e1 = first - normals * np.einsum("ki,ki->k", first, normals)[:, None]
    e1 /= np.linalg.norm(e1, axis=1, keepdims=True)
    return np.asarray(np.stack([e1, np.cross(normals, e1)], axis=2))


def _from_points(
    points: Points,
    labelled: LabelledPoints,
    numbers: Int32[Array, "labels"],
    frames: Float64[Array, "k 13"],
    counts: Int64[Array, "k"],
    extents: Float64[Array, "k 4"],
    sensor_m: Vector3 | None,
    steps: CoordinateSteps,
    sweep: Sweep | None,
) -> tuple[FittedPlanes, Int64[Array, "flat"]]:
    """Adjust planes from patches of their points; also say which of them are flat."""
    sums, starts, columns, sizes = _sum_patches(points, labelled, numbers, frames, counts, extents)
    used = np.flatnonzero(sums[:, 0] > 0)
    owner = (np.searchsorted(starts, used, side="right") - 1).astype(np.int32)
    means = sums[used, 1:4] / sums[used, :1]
    half_widths = 0.5 * np.maximum(extents[:, 2:] - extents[:, :2], 0.0)
    flat = ~curved_regions(owner, means[:, :2], means[:, 2], sums[used, 0], half_widths)
    flat &= _in_one_piece(owner, (used - starts[owner]) // columns[owner], len(frames))
    squares = np.bincount(owner, sums[used, 4], minlength=len(frames))
    inner = np.bincount(owner, sums[used, 0], minlength=len(frames))
    noise = np.maximum(np.sqrt(squares / np.maximum(inner - 3.0, 1.0)), steps.std_across_m(frames[:, :3]))
    splits = np.searchsorted(used, starts)
    rounding = patch_rounding(steps, frames, sums[used], splits, sizes, sensor_m)
    turned, moved, bases, covariances, shared, responses = _adjust_patches(
        sums, starts, frames, noise, sensor_m, rounding, sweep
    )
    planes = FittedPlanes(
        normals=turned,
        centroids=moved,
        bases=bases,
        covariances=covariances,
        rounding_covariances=shared,
        responses=responses,
        noise_std_m=noise,
        point_counts=counts,
        extents=extents,
        point_labels=labelled.labels,
        numbers=numbers,
    )
    return planes, np.flatnonzero(flat)


def _in_one_piece(owner: Labels, row: Indices, count: int) -> Bool[Array, "k"]:
    """Find planes without a gap across their whole length: one with a gap cuts a pipe in two lines."""
    occupied = np.zeros((count, PATCHES), dtype=np.bool_)
    occupied[owner, row] = True
    first = np.argmax(occupied, axis=1)
    last = PATCHES - 1 - np.argmax(occupied[:, ::-1], axis=1)
    return np.asarray(occupied.sum(axis=1) == last - first + 1)


def _sum_patches(
    points: Points,
    labelled: LabelledPoints,
    numbers: Int32[Array, "labels"],
    frames: Float64[Array, "k 13"],
    counts: Int64[Array, "k"],
    extents: Float64[Array, "k 4"],
) -> tuple[Float64[Array, "p 5"], Int64[Array, "starts"], Int64[Array, "k"], Float64[Array, "k 2"]]:
    """Sum the points of every plane per patch: sums, its first patch, its patches in a row, and their sides [m]."""
    spans = np.where(np.isfinite(extents[:, 2:]), extents[:, 2:] - extents[:, :2], 0.0)
    patches = np.clip(counts / POINTS_PER_PATCH, 4.0, PATCHES)
    # at least four patches across a long narrow plane: with fewer a bend would not show
    rows = np.clip(np.rint(np.sqrt(patches * spans[:, 1] / np.maximum(spans[:, 0], 1e-9))), 4.0, PATCHES).astype(
        np.int64
    )
    columns = np.clip(np.rint(patches / rows), 4.0, PATCHES).astype(np.int64)
    sizes = np.stack([spans[:, 0] / columns, spans[:, 1] / rows], axis=1) * (1.0 + 1e-9) + 1e-12
    starts = np.concatenate([[0], np.cumsum(columns * rows)]).astype(np.int64)
    corners = np.ascontiguousarray(extents[:, :2])
    labels, shared = labelled.labels, labelled.shared

    def work(start: int, end: int) -> Array:
        return sum_patches(
            points, labels, shared, numbers, frames, corners, 1.0 / sizes, starts, rows, columns, start, end
        )

    parts = over_blocks(work, len(points))
    return np.sum(parts, axis=0), starts, columns, sizes


def _adjust_patches(
    sums: Float64[Array, "p 5"],
    starts: Int64[Array, "starts"],
    frames: Float64[Array, "k 13"],
    noise: Scalars,
    sensor_m: Vector3 | None,
    rounding: PatchRounding,
    sweep: Sweep | None,
) -> tuple[Points, Points, Bases, Matrices3, Matrices3, Float64[Array, "k 3 11"]]:
    """Refine every plane from its patch means; give its covariance, and that by rounding with all patches alike.

    Last come the responses to errors of the instrument.
    """
    k = len(frames)
    normals, centroids = frames[:, :3], frames[:, 3:6]
    axes = frames[:, 6:12].reshape(k, 2, 3)
    sensor = np.full(3, np.nan) if sensor_m is None else sensor_m
    jacobian, misfits, variances, splits = patch_systems(sums, starts, frames, noise, sensor, STEADY, LEAST_COSINE)
    parts = list(pairwise(splits.tolist()))
    systems = [(jacobian[first:end], misfits[first:end], variances[first:end]) for first, end in parts]
    # staircases of rounded coordinates are no waves of the surface
    scattering = variances + rounding.variances
    waviness = estimate_wavinesses([(jacobian[a:b], misfits[a:b], scattering[a:b]) for a, b in parts])
    covariances, shared = np.empty((k, 3, 3)), np.empty((k, 3, 3))
    corrections = np.empty((k, 3))
    for p, (system, (first, end)) in enumerate(zip(systems, parts, strict=True)):
        corrections[p], covariances[p] = adjust_patches(*system, float(waviness[p]))
        covariances[p] += rounding.plane_covariance(first, end, system[0], system[2] + waviness[p])
        shared[p] = rounding.plane_covariance(first, end, system[0], np.ones(end - first))
    turned = normals + np.einsum("kji,kj->ki", axes, corrections[:, :2])
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    owners = np.repeat(np.arange(k), np.diff(splits))
    weights = 1.0 / (variances + rounding.variances + waviness[owners])
    responses = np.zeros((k, 3, 11))
    if sensor_m is not None:
        means = centroids[owners] - np.einsum("pi,pij->pj", jacobian[:, :2], axes[owners]) - sensor_m
        responses = plane_responses(means, normals, jacobian, weights, splits, sweep)
    moved = centroids + normals * corrections[:, 2:]
    return turned, moved, _carried_bases(axes[:, 0], turned), covariances, shared, responses
