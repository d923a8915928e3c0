"""Planes refined from single points, with covariance from patches."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64

from algorithms.arrays import Array, Bases, Flags, Indices, Labels, Matrices3, Points, Scalars, Vector3
from algorithms.features.patch_covariance import (
    NUMERICAL_STD_M,
    estimate_wavinesses,
    fit_patches,
    honest_covariance,
)
from algorithms.features.plane_curvature import curved_regions
from algorithms.features.plane_segmentation_kernels import label_moments, label_points, patch_sums, plane_extents

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
    noise_std_m: Float64[Array, "k"]
    point_counts: Int64[Array, "k"]
    extents: Float64[Array, "k 4"]
    """(k, 4) bounding rectangles u_min, v_min, u_max, v_max in plane coordinates [m]."""
    point_labels: Labels
    """(n,) plane of each point, -1 for none."""

    def __len__(self) -> int:
        return len(self.normals)

    def select(self, which: Indices) -> "FittedPlanes":
        """Keep some of the planes."""
        return FittedPlanes(
            self.normals[which],
            self.centroids[which],
            self.bases[which],
            self.covariances[which],
            self.noise_std_m[which],
            self.point_counts[which],
            self.extents[which],
            renumber(self.point_labels, which),
        )


def renumber(labels: Labels, kept: Int64[Array, "k"]) -> Labels:
    """Give labels new numbers: kept[i] becomes i, all others -1."""
    numbers = np.full(max(int(labels.max(initial=-1)), int(kept.max(initial=-1))) + 2, -1, dtype=np.int32)
    numbers[kept] = np.arange(len(kept))
    return np.asarray(numbers[labels])  # label -1 takes the last entry, which stays -1


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


def fit_planes(
    points: Points,
    cell_of_point: Labels,
    candidates: Array,
    normals: Float64[Array, "k 3"],
    centroids: Float64[Array, "k 3"],
    noise_std_m: Float64[Array, "k"],
    *,
    thickness_m: Float64[Array, "k"],
    sensor_m: Vector3 | None,
    min_points: int,
    rounds: int = 3,
) -> tuple[FittedPlanes, Int64[Array, "kept"]]:
    """Assign points to approximate planes and fit each from its points.

    Parameters
    ----------
    points
        (n, 3) points.
    cell_of_point
        (n,) cell of each point.
    candidates
        (m, c) planes that may hold points of each cell, -1 padded.
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
    rounds
        How often points are assigned and planes fitted.

    Returns
    -------
    The fitted planes, and which of the approximate planes they were.
    """
    tolerances = thickness_m
    sides = normals
    for _ in range(rounds):
        labels, shared = label_points(points, cell_of_point, candidates, normals, centroids, tolerances)
        moments = label_moments(points, labels, shared, centroids)
        bases, fitted, deviations = frames_of_moments(moments)
        enough = moments[:, 0] >= 4
        flip = np.einsum("ij,ij->i", fitted, sides) < 0
        fitted[flip] *= -1.0
        bases[flip, :, 1] *= -1.0
        normals = np.where(enough[:, None], fitted, normals)
        centroids = np.where(enough[:, None], moments[:, 1:4], centroids)
        noise = deviations[:, 2] * np.sqrt(moments[:, 0] / np.maximum(moments[:, 0] - 3.0, 1.0))
        tolerances = np.clip(TRIM * noise, np.maximum(0.5 * TRIM * noise_std_m, NUMERICAL_STD_M), thickness_m)
    kept = np.flatnonzero((moments[:, 0] >= min_points) & (deviations[:, 1] > LEAST_WIDTH * deviations[:, 2]))
    planes, flat = _from_points(
        points, renumber(labels, kept), shared, normals[kept], centroids[kept], bases[kept], sensor_m
    )
    return planes.select(flat), kept[flat]


def _from_points(
    points: Points,
    labels: Labels,
    shared: Flags,
    normals: Float64[Array, "k 3"],
    centroids: Float64[Array, "k 3"],
    bases: Float64[Array, "k 3 2"],
    sensor_m: Vector3 | None,
) -> tuple[FittedPlanes, Int64[Array, "flat"]]:
    """Adjust planes from patches of their points; also say which of them are flat."""
    extents = plane_extents(points, labels, centroids, bases)
    sums, starts, columns = _sum_patches(points, labels, shared, normals, centroids, bases, extents)
    used = np.flatnonzero(sums[:, 0] > 0)
    owner = (np.searchsorted(starts, used, side="right") - 1).astype(np.int32)
    means = sums[used, 1:4] / sums[used, :1]
    half_widths = 0.5 * np.maximum(extents[:, 2:] - extents[:, :2], 0.0)
    flat = ~curved_regions(owner, means[:, :2], means[:, 2], sums[used, 0], half_widths)
    flat &= _in_one_piece(owner, (used - starts[owner]) // columns[owner], len(normals))
    squares = np.bincount(owner, sums[used, 4], minlength=len(normals))
    counts = np.bincount(owner, sums[used, 0], minlength=len(normals))
    noise = np.sqrt(squares / np.maximum(counts - 3.0, 1.0))
    turned, moved, frames, covariances = _adjust_patches(sums, starts, normals, centroids, bases, noise, sensor_m)
    planes = FittedPlanes(
        normals=turned,
        centroids=moved,
        bases=frames,
        covariances=covariances,
        noise_std_m=noise,
        point_counts=np.bincount(labels[labels >= 0], minlength=len(normals)).astype(np.int64),
        extents=plane_extents(points, labels, moved, frames),
        point_labels=labels,
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
    labels: Labels,
    shared: Flags,
    normals: Float64[Array, "k 3"],
    centroids: Float64[Array, "k 3"],
    bases: Float64[Array, "k 3 2"],
    extents: Float64[Array, "k 4"],
) -> tuple[Float64[Array, "p 5"], Int64[Array, "starts"], Int64[Array, "k"]]:
    """Sum the points of every plane per patch: sums, the first patch of every plane, and its patches in a row."""
    counts = np.bincount(labels[labels >= 0], minlength=len(normals))
    spans = np.where(np.isfinite(extents[:, 2:]), extents[:, 2:] - extents[:, :2], 0.0)
    patches = np.clip(counts / POINTS_PER_PATCH, 4.0, PATCHES)
    # at least four patches across a long narrow plane: with fewer a bend would not show
    rows = np.clip(np.rint(np.sqrt(patches * spans[:, 1] / np.maximum(spans[:, 0], 1e-9))), 4.0, PATCHES).astype(
        np.int64
    )
    columns = np.clip(np.rint(patches / rows), 4.0, PATCHES).astype(np.int64)
    sizes = np.stack([spans[:, 0] / columns, spans[:, 1] / rows], axis=1) * (1.0 + 1e-9) + 1e-12
    starts = np.concatenate([[0], np.cumsum(columns * rows)]).astype(np.int64)
    sums = patch_sums(points, labels, shared, centroids, normals, bases, extents, sizes, starts, columns)
    return sums, starts, columns


def _noise_shares(counts: Scalars, patches: Points, normal: Vector3, sensor_m: Vector3 | None) -> Scalars:
    """Give what share of a plane's noise variance each of its patches has, one on the average of the points.

    The error of a range shows across the plane with the cosine of the incidence: a floor is noisy below the instrument
    and quiet far away, where it fixes the tilt best.
    """
    if sensor_m is None:
        return np.ones(len(counts))
    rays = patches - sensor_m
    squares = np.einsum("ij,ij->i", rays, rays)
    shares = (rays @ normal) ** 2 / np.maximum(squares, NUMERICAL_STD_M**2) + LEAST_COSINE**2
    return np.asarray(shares * counts.sum() / (counts @ shares))


def _adjust_patches(
    sums: Float64[Array, "p 5"],
    starts: Int64[Array, "starts"],
    normals: Points,
    centroids: Points,
    bases: Bases,
    noise: Scalars,
    sensor_m: Vector3 | None,
) -> tuple[Points, Points, Bases, Matrices3]:
    """Refine every plane from its patch means and give its covariance."""
    k = len(normals)
    systems = []
    for p in range(k):
        part = sums[starts[p] : starts[p + 1]]
        part = part[part[:, 0] > 0]
        n = part[:, 0]
        u, v, r = part[:, 1] / n, part[:, 2] / n, part[:, 3] / n
        within = part[:, 4] - n * r**2
        expected = noise[p] ** 2 * _noise_shares(
            n, centroids[p] + np.stack([u, v], 1) @ bases[p].T, normals[p], sensor_m
        )
        # the patch's own scatter, steadied by the expected one
        variances = (within + STEADY * expected) / (n - 1.0 + STEADY) / n + NUMERICAL_STD_M**2
        systems.append((np.stack([-u, -v, np.ones_like(u)], axis=1), r, variances))
    waviness = estimate_wavinesses(systems)
    covariances = np.empty((k, 3, 3))
    corrections = np.empty((k, 3))
    for p, system in enumerate(systems):
        fit = fit_patches(*system, float(waviness[p]))
        covariances[p] = honest_covariance(*system, float(waviness[p]))
        corrections[p] = fit.corrections
    turned = normals + np.einsum("kij,kj->ki", bases, corrections[:, :2])
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    e1 = bases[:, :, 0] - turned * np.einsum("ki,ki->k", bases[:, :, 0], turned)[:, None]
    e1 /= np.linalg.norm(e1, axis=1, keepdims=True)
    return turned, centroids + normals * corrections[:, 2:], np.stack([e1, np.cross(turned, e1)], axis=2), covariances
