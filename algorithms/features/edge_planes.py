"""The surfaces beside the edges of a photo, adjusted from patches, with covariance."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from algorithms.arrays import Array, Bases, Flags, Floats32, Indices, Labels, Matrices3, Points, Scalars
from algorithms.features.edge_bands import EdgeBands
from algorithms.features.edge_owners import EdgeOwners
from algorithms.features.patch_covariance import (
    NUMERICAL_STD_M,
    estimate_wavinesses,
    fit_patches,
    honest_covariance,
)
from algorithms.features.plane_curvature import curved_regions
from algorithms.features.plane_fitting import POINTS_PER_PATCH, STEADY
from algorithms.features.projection_options import ProjectionOptions
from algorithms.features.side_planes import EdgeRejection, SpaceEdgeKind
from algorithms.features.side_planes_kernels import sum_patches
from algorithms.geometry.lines import bases_of

ROWS = 3
"""Patches across each side, at most."""
COLUMNS = 12
"""Patches along the edge, at most."""
INTENSITY_BAND = 0.6
"""Intensities are compared in this share of the band, next to the edge."""
FEW_INTENSITIES = 5
"""Fewer points on a side tell nothing of its intensity."""
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

    def select(self, which: Indices) -> "EdgePlanes":
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
    bands: EdgeBands, owners: EdgeOwners, intensity: Floats32 | None, options: ProjectionOptions
) -> EdgePlanes:
    """Adjust the planes of edges from the means of patches, and tell bent surfaces and changes of material.

    The planes of rejected edges are left as they are.
    """
    n = len(owners.normals)
    bases = _bases(owners.normals)
    rows = np.clip(np.rint(np.sqrt(owners.counts / POINTS_PER_PATCH / 4.0)), 2, ROWS).astype(np.int64)
    columns = np.clip(np.rint(owners.counts / POINTS_PER_PATCH / rows), 4, COLUMNS).astype(np.int64)
    sums = sum_patches(
        bands.points, bands.along, bands.across, bands.splits, bands.first_px, bands.last_px,
        options.gap_px, owners.sides, owners.normals, owners.centroids, bases, owners.limits_m,
        rows, columns, bands.widths_px - options.gap_px,
    )  # fmt: skip
    good = np.flatnonzero(owners.reasons == EdgeRejection.NONE)
    curved = np.zeros(n, dtype=bool)
    curved[good] = _curved(sums[good])
    corrections, covariances = _adjusted(sums, good, owners.variances_m2)
    normals = owners.normals + np.einsum("nij,nj->ni", bases, corrections[:, :2])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    e1 = bases[:, :, 0] - normals * np.einsum("ni,ni->n", bases[:, :, 0], normals)[:, None]
    e1 /= np.linalg.norm(e1, axis=1, keepdims=True)
    kinds = owners.kinds.copy()
    if intensity is not None:
        steps = _intensity_steps(bands, intensity, options)
        kinds[(kinds == SpaceEdgeKind.SURFACE_EDGE) & steps] = SpaceEdgeKind.MATERIAL_EDGE
    return EdgePlanes(
        normals=normals,
        centroids=owners.centroids + owners.normals * corrections[:, 2:],
        bases=np.stack([e1, np.cross(normals, e1)], axis=2),
        covariances=covariances,
        kinds=kinds,
        curved=curved,
    )


def _bases(normals: Points) -> Bases:
    """Give any bases (E1, E2, n) right-handed; (n, 3, 2)."""
    safe = np.where(np.linalg.norm(normals, axis=1, keepdims=True) > 0.5, normals, [0.0, 0.0, 1.0])
    return bases_of(safe)


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
    sums: Float64[Array, "n p 5"], good: Indices, variances_m2: Scalars
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
        covariances[k] = honest_covariance(*system, float(wave))
    return corrections, covariances


def _intensity_steps(bands: EdgeBands, intensity: Floats32, options: ProjectionOptions) -> Flags:
    """Tell at which edges the intensity of the scan changes."""
    edges = np.repeat(np.arange(len(bands)), np.diff(bands.splits))
    near = np.abs(bands.across) <= options.gap_px + INTENSITY_BAND * (bands.widths_px[edges] - options.gap_px)
    near &= np.abs(bands.across) >= options.gap_px
    edges = edges[near]
    sides = 2 * edges + (bands.across[near] <= 0.0)
    values = intensity[bands.numbers[near]].astype(np.float64)
    count = np.bincount(sides, minlength=2 * len(bands))
    filled = np.maximum(count, 1)
    mean = np.bincount(sides, values, minlength=len(count)) / filled
    square = np.bincount(sides, (values - mean[sides]) ** 2, minlength=len(count)) / np.maximum(count - 1, 1)
    count, filled, mean, square = (a.reshape(-1, 2) for a in (count, filled, mean, square))
    step = np.abs(mean[:, 0] - mean[:, 1])
    enough = (count >= FEW_INTENSITIES).all(axis=1)
    certain = step > STEP_SIGNIFICANCE * np.sqrt((square / filled).sum(axis=1))
    return np.asarray(enough & certain & (step > STEP_IN_SCATTER * np.sqrt(square.mean(axis=1))))
