"""The surfaces beside the edges of a photo, adjusted from patches, with covariance."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64

from algorithms.arrays import Array, Bases, Flags, Labels, Matrices3, Matrix3, Points, Scalars, Vector3
from algorithms.features.patches.patch_covariance import (
    NUMERICAL_STD_M,
    estimate_wavinesses,
    fit_patches,
    honest_covariance,
)
from algorithms.features.photo_lines.edge_bands import EdgeBands
from algorithms.features.photo_lines.edge_owners import EdgeOwners
from algorithms.features.photo_lines.projection_options import EdgeRejection, ProjectionOptions, SpaceEdgeKind
from algorithms.features.photo_lines.side_planes_kernels import sum_patches
from algorithms.features.planes.plane_curvature import curved_regions
from algorithms.features.planes.plane_fitting import POINTS_PER_PATCH, STEADY
from algorithms.geometry.lines import bases_of

ROWS = 4
"""Patches across each side, at most."""
COLUMNS = 12
"""Patches along the edge, at most."""
INTENSITY_BAND = 0.6
"""Intensities are compared in this share of the band, next to the edge."""
FEW_INTENSITIES = 5
"""Fewer points on a side tell nothing of its intensity."""
RIM_SHARE = 0.5
"""Standard deviation of the row of points at either rim of a strip, in that of single points: beams that hit the rim
also hit what lies behind it, and within the noise they cannot be told from the others."""
NARROW_ROWS, WIDE_ROWS = 3.0, 8.0
"""Such rows count in full in strips of so many rows, and no more where there are so many: there they are left out."""
STEP_SIGNIFICANCE = 5.0
"""Least ratio of a step of the mean intensity to its standard deviation."""
STEP_IN_SCATTER = 1.0
"""Least ratio of a step of the mean intensity to the scatter of single points."""


@dataclass(frozen=True, eq=False)
class EdgePlanes:
    """n planes beside edges."""

    normals: Points
    """(n, 3) unit normals towards the camera."""
    centroids: Points
    """(n, 3) [m]."""
    bases: Bases
    """(n, 3, 2)."""
    covariances: Matrices3
    """(n, 3, 3) of (a1, a2, b): n -> n + E a, c -> c + n b [rad, m]."""
    kinds: Labels
    """(n,) `SpaceEdgeKind` values."""
    curved: Flags
    """(n,) True for surfaces that are bent."""

    def select(self, which: Int64[Array, "k"]) -> "EdgePlanes":
        """Keep some of the planes."""
        return EdgePlanes(
            self.normals[which],
            self.centroids[which],
            self.bases[which],
            self.covariances[which],
            self.kinds[which],
            self.curved[which],
        )


def adjust_edge_planes(
    bands: EdgeBands,
    used: Bool[Array, "m"],
    owners: EdgeOwners,
    projecting: Points,
    intensity: Float32[Array, "points"] | None,
    sensor_m: Vector3,
    options: ProjectionOptions,
) -> EdgePlanes:
    """Adjust the planes of edges from the means of patches, and tell bent surfaces and changes of material.

    The planes of rejected edges are left as they are.

    Parameters
    ----------
    bands, used
        Points beside the edges, and which of them made the plane of their side.
    owners
        The planes.
    projecting
        (n, 3) normals of the projecting planes.
    intensity
        Of the scan's points.
    sensor_m
        (3,) where the scanner stood, or nearly so [m].
    """
    n = len(owners.normals)
    bases = _bases(owners.normals, projecting)
    rows = np.clip(np.rint(np.sqrt(owners.counts / POINTS_PER_PATCH / 4.0)), 3, ROWS).astype(np.int64)
    columns = np.clip(np.rint(owners.counts / POINTS_PER_PATCH / rows), 4, COLUMNS).astype(np.int64)
    sums = sum_patches(
        bands.points, bands.along, bands.across, bands.splits, bands.first_px, bands.last_px,
        options.gap_px, used, owners.sides, owners.normals, owners.centroids, bases,
        rows, columns, _used_widths(bands, used, owners.sides) - options.gap_px, sensor_m,
    )  # fmt: skip
    good = np.flatnonzero(owners.reasons == EdgeRejection.NONE)
    curved = np.zeros(n, dtype=bool)
    curved[good] = _curved(sums[good])
    corrections, covariances = _adjusted(sums, good, owners.variances_m2, owners.rows)
    normals = owners.normals + np.einsum("nij,nj->ni", bases, corrections[:, :2])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 0.5)  # zero where there is no plane
    e1 = bases[:, :, 0] - normals * np.einsum("ni,ni->n", bases[:, :, 0], normals)[:, None]
    e1 /= np.linalg.norm(e1, axis=1, keepdims=True)
    kinds = owners.kinds.copy()
    if intensity is not None:
        steps = _intensity_steps(bands, used, intensity)
        kinds[(kinds == SpaceEdgeKind.SURFACE_EDGE) & steps] = SpaceEdgeKind.MATERIAL_EDGE
    return EdgePlanes(
        normals=normals,
        centroids=owners.centroids + owners.normals * corrections[:, 2:],
        bases=np.stack([e1, np.cross(normals, e1)], axis=2),
        covariances=covariances,
        kinds=kinds,
        curved=curved,
    )


def _bases(normals: Points, projecting: Points) -> Bases:
    """Give bases (E1, E2, n) right-handed with E1 along the edges; (n, 3, 2)."""
    along = np.cross(projecting, normals)
    lengths = np.linalg.norm(along, axis=1, keepdims=True)
    bases = bases_of(np.where(np.linalg.norm(normals, axis=1, keepdims=True) > 0.5, normals, [0.0, 0.0, 1.0]))
    steep = lengths[:, 0] > 1e-3
    e1 = along[steep] / lengths[steep]
    bases[steep] = np.stack([e1, np.cross(normals[steep], e1)], axis=2)
    return bases


def _used_widths(bands: EdgeBands, used: Bool[Array, "m"], sides: Bool[Array, "n 2"]) -> Scalars:
    """Give how far from the edges (n,) the points of their planes reach [px]."""
    edges = np.repeat(np.arange(len(bands)), np.diff(bands.splits))
    mine = used & sides[edges, (bands.across <= 0.0).astype(np.int64)]
    widths = np.full(len(bands), 1e-3)
    np.maximum.at(widths, edges[mine], np.abs(bands.across[mine]))
    return widths


def _curved(sums: Float64[Array, "n p 5"]) -> Flags:
    """Tell which planes are bent; see `curved_regions`."""
    owner, patch = np.nonzero(sums[:, :, 0] > 0)
    part = sums[owner, patch]
    means = part[:, 1:4] / part[:, :1]
    low, high = np.full((len(sums), 2), np.inf), np.full((len(sums), 2), -np.inf)
    np.minimum.at(low, owner, means[:, :2])
    np.maximum.at(high, owner, means[:, :2])
    half = np.where(np.isfinite(low), 0.5 * (high - low), 0.0)
    return curved_regions(owner.astype(np.int32), means[:, :2], means[:, 2], part[:, 0], half)


def _adjusted(
    sums: Float64[Array, "n p 5"], good: Int64[Array, "k"], variances_m2: Scalars, rows: Scalars
) -> tuple[Float64[Array, "n 3"], Matrices3]:
    """Adjust the planes `good` from their patches: corrections of (a1, a2, b), and covariances."""
    systems = []
    for k in good:
        part = sums[k][sums[k, :, 0] > 0]
        count = part[:, 0]
        u, v, r = part[:, 1] / count, part[:, 2] / count, part[:, 3] / count
        within = part[:, 4] - count * r**2
        variances = (within + STEADY * variances_m2[k]) / (count - 1.0 + STEADY) / count + NUMERICAL_STD_M**2
        systems.append((np.stack([-u, -v, np.ones_like(u)], axis=1), r, variances))
    waviness = estimate_wavinesses(systems)
    corrections, covariances = np.zeros((len(sums), 3)), np.tile(np.eye(3), (len(sums), 1, 1))
    for k, system, wave in zip(good, systems, waviness, strict=True):
        corrections[k] = fit_patches(*system, float(wave)).corrections
        covariances[k] = honest_covariance(*system, float(wave)) + _rim_covariance(sums[k], variances_m2[k], rows[k])
    return corrections, covariances


def _rim_covariance(sums: Float64[Array, "p 5"], variance_m2: float, rows: float) -> Matrix3:
    """Give what beams at both rims of a strip add to the covariance of (a1, a2, b) of its plane.

    One of R rows displaced by D at a rim moves the plane by D/R, and tilts it by 3 D/R at its rims.
    """
    share = np.clip((WIDE_ROWS - rows) / (WIDE_ROWS - NARROW_ROWS), 0.0, 1.0)
    moved = 2.0 * (RIM_SHARE * share / rows) ** 2 * variance_m2
    count = sums[:, 0]
    places = sums[:, 2] / np.maximum(count, 1.0)
    mean = np.average(places, weights=count)
    width_square = 12.0 * np.average((places - mean) ** 2, weights=count)
    return np.diag([0.0, 9.0 * moved * 4.0 / max(width_square, NUMERICAL_STD_M), moved])


def _intensity_steps(bands: EdgeBands, used: Bool[Array, "m"], intensity: Float32[Array, "points"]) -> Flags:
    """Tell at which edges (n,) the intensity of the scan changes from one side's plane to the other's.

    Intensity also changes gradually with range and incidence, so a slope along and across the edge is estimated
    together with the step: I = i0 + i1 along + i2 across + step [on the first side].
    """
    n = len(bands)
    edges = np.repeat(np.arange(n), np.diff(bands.splits))
    near = used & (np.abs(bands.across) <= INTENSITY_BAND * bands.widths_px[edges])
    edges, first = edges[near], bands.across[near] > 0.0
    values = intensity[bands.numbers[near]].astype(np.float64)
    lengths = bands.last_px - bands.first_px
    along = (bands.along[near] - 0.5 * (bands.first_px + bands.last_px)[edges]) / lengths[edges]
    terms = np.stack([np.ones_like(along), along, bands.across[near] / bands.widths_px[edges], first * 1.0], axis=1)

    def add(weights: Float64[Array, "near"]) -> Scalars:
        return np.bincount(edges, weights, minlength=n)

    normal = np.empty((n, 4, 4))
    for i, j in np.ndindex(4, 4):
        normal[:, i, j] = add(terms[:, i] * terms[:, j])
    on_first, on_second = normal[:, 3, 3], normal[:, 0, 0] - normal[:, 3, 3]
    enough = np.minimum(on_first, on_second) >= FEW_INTENSITIES
    mean = add(values) / np.maximum(normal[:, 0, 0], 1.0)
    right = np.stack([add(terms[:, i] * (values - mean[edges])) for i in range(4)], axis=1)
    inverse = np.linalg.inv(normal + 1e-9 * np.maximum(normal[:, 0, 0], 1.0)[:, None, None] * np.eye(4))
    solution = np.einsum("nij,nj->ni", inverse, right)
    left = values - mean[edges] - np.einsum("mi,mi->m", terms, solution[edges])
    variance = add(left**2) / np.maximum(normal[:, 0, 0] - 4.0, 1.0)
    step = np.abs(solution[:, 3])
    certain = step > STEP_SIGNIFICANCE * np.sqrt(variance * inverse[:, 3, 3])
    return np.asarray(enough & certain & (step > STEP_IN_SCATTER * np.sqrt(variance)))
