"""Straight lines through edge points, in ideal pixels, with their covariance.

Edge points are found in the photo as taken; only they, not the photo, are freed from lens distortion. The line is
fitted to them where lines are straight.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from algorithms.arrays import Array, Flags, Indices, Scalars, Vectors2
from algorithms.geometry.cameras import Camera
from algorithms.photos.edge_profile import EdgePoints, Patches
from algorithms.photos.line_fit_kernels import group_medians

PATCH_PX = 8.0
"""Length along the edge of the patches of which each gives one edge point [px]."""
REACH = 3.0
"""Points off the line by more robust standard deviations lose weight (Huber)."""
ROBUST_ROUNDS = 3
PRIOR_FREEDOMS = 10.0
"""Weight of what all edges of the photo say of the noise against the residuals of the single edge."""
LARGEST_CORRELATION = 0.6
PRIOR_PAIRS = 20.0
"""Weight of what all edges of the photo say of the correlation against the pairs of points of the single edge."""
LEAST_PAIRS = 10
"""Edges of fewer pairs of points say nothing of the correlation."""
LEAST_WHITE = 0.5
"""No edge is known better than by this part of the variance that the photo's own noise lets expect."""
LEAST_FREEDOMS = 5.0
"""Patches with fewer degrees of freedom say nothing of the noise."""
MEDIAN_OF_SQUARE = 0.4549
"""Median of chi-square with one degree of freedom."""

PerEdge = Float64[Array, "edges"]
"""One number for each edge, beside arrays of all their edge points."""


@dataclass(frozen=True, eq=False)
class EdgeLines:
    """n straight pieces of edges in ideal pixels while they are being measured."""

    centres: Vectors2
    """(n, 2) [px]."""
    directions: Vectors2
    """(n, 2) unit directions."""
    extents: Vectors2
    """(n, 2) start and end along the direction [px]."""
    widths: Scalars
    """(n,) width of the profile across the edge [px]."""
    half_widths: Scalars
    """(n,) distance from the edge within which grey values count [px]."""

    def __len__(self) -> int:
        return len(self.centres)

    def __getitem__(self, chosen: Indices | Flags) -> "EdgeLines":
        return EdgeLines(
            self.centres[chosen],
            self.directions[chosen],
            self.extents[chosen],
            self.widths[chosen],
            self.half_widths[chosen],
        )

    @property
    def normals(self) -> Vectors2:
        """(n, 2) unit normals (-d_y, d_x)."""
        return np.column_stack([-self.directions[:, 1], self.directions[:, 0]])

    @property
    def lengths(self) -> Scalars:
        """(n,) [px]."""
        return np.asarray(self.extents[:, 1] - self.extents[:, 0])

    def turned(self, which: Flags) -> "EdgeLines":
        """Reverse the direction of some lines."""
        sign = np.where(which, -1.0, 1.0)[:, None]
        extents = np.where(which[:, None], -self.extents[:, ::-1], self.extents)
        return replace(self, directions=self.directions * sign, extents=extents)


@dataclass(frozen=True, eq=False)
class PlacedPatches:
    """Patches on lines, and how they lie on them."""

    patches: Patches
    positions: Scalars
    """(m,) place along the line in ideal pixels, from its centre."""
    gains: Scalars
    """(m,) ideal pixels across the line for a shift of one pixel in the photo."""


@dataclass(frozen=True, eq=False)
class LineFit:
    """Corrections of lines from edge points, and what remains."""

    angles: Scalars
    """(n,) rotation of the direction [rad]."""
    offsets: Scalars
    """(n,) shift across the line at its centre [px]."""
    pivots: Scalars
    """(n,) place along the line where angle and offset are uncorrelated [px]."""
    covariances: Float64[Array, "n 2 2"]
    """(n, 2, 2) covariance of (angle, offset) at the pivot."""
    grey_variances: Scalars
    """(n,) variance of single, independent grey values that would explain the covariances."""
    point_counts: Indices
    """(n,) number of edge points with weight."""


def ideal_from_image(image: Vectors2, camera: Camera | None) -> Vectors2:
    """Free points of the photo from lens distortion; without a camera there is none."""
    return image if camera is None else camera.ideal_from_image(image)


def image_from_ideal(ideal: Vectors2, camera: Camera | None) -> Vectors2:
    """Give the places in the photo of ideal points; without a camera they are the same."""
    return ideal if camera is None else camera.image_from_ideal(ideal)


def lines_between(ends: Float64[Array, "n 2 2"], width: float, half_width: float) -> EdgeLines:
    """Make lines of start and end points in ideal pixels."""
    along = ends[:, 1] - ends[:, 0]
    lengths = np.linalg.norm(along, axis=1)
    half = 0.5 * lengths
    return EdgeLines(
        centres=ends.mean(axis=1),
        directions=along / lengths[:, None],
        extents=np.column_stack([-half, half]),
        widths=np.full(len(ends), width),
        half_widths=np.full(len(ends), half_width),
    )


def place_patches(lines: EdgeLines, camera: Camera | None, length_px: float = PATCH_PX) -> PlacedPatches:
    """Cover every line with patches of about `length_px`, two or more, without gaps."""
    counts = np.maximum(2, np.rint(lines.lengths / length_px).astype(np.int64))
    owners = np.repeat(np.arange(len(lines)), counts)
    rank = np.arange(len(owners)) - np.repeat(np.cumsum(counts) - counts, counts)
    lengths = (lines.lengths / counts)[owners]
    return patches_at(lines, owners, lines.extents[owners, 0] + (rank + 0.5) * lengths, lengths, camera)


def patches_at(
    lines: EdgeLines, owners: Indices, positions: Scalars, lengths: Scalars, camera: Camera | None
) -> PlacedPatches:
    """Put patches of given lengths at given places of lines into the photo."""
    directions, normals = lines.directions[owners], lines.normals[owners]
    ideal = lines.centres[owners] + positions[:, None] * directions
    if camera is None or not camera.distorts:
        centres, raw_normals = ideal, normals
        stretch = gains = np.ones(len(owners))
    else:
        centres = camera.image_from_ideal(ideal)
        jacobians = camera.image_jacobians(ideal)
        tangents = np.einsum("mij,mj->mi", jacobians, directions)
        stretch = np.linalg.norm(tangents, axis=1)
        tangents /= stretch[:, None]
        raw_normals = np.column_stack([-tangents[:, 1], tangents[:, 0]])
        # n' J N = 1 / gain, because J maps the line's own direction to the tangent
        gains = 1.0 / np.einsum("mi,mij,mj->m", raw_normals, jacobians, normals)
    return PlacedPatches(
        patches=Patches(centres, raw_normals, 0.5 * lengths * stretch, owners, len(lines)),
        positions=positions,
        gains=gains,
    )


def noise_variances(points: EdgePoints, owners: Indices, count: int) -> PerEdge:
    """Give the variance of single grey values about the fitted profiles of each edge, (n,).

    The median over its patches: where the edge ends or is crossed the grey values differ from the profile for other
    reasons.
    """
    seen = points.freedoms >= LEAST_FREEDOMS
    freedoms = np.where(seen, points.freedoms, 1.0)
    # the median of chi-square lies below its mean (Wilson and Hilferty)
    variances = points.squares / freedoms / (1.0 - 2.0 / (9.0 * freedoms)) ** 3
    # a photo is rounded to whole grey levels
    return np.asarray(np.maximum(group_medians(variances, owners, seen, count), 1.0 / 12.0))


def fit_lines(placed: PlacedPatches, points: EdgePoints, largest_shift: float, photo_noise: float) -> LineFit:
    """Fit every line to its edge points by weighted least squares, robust against single points (Huber).

    v_k = offset + s_k angle, weights from the profile fits. The covariance (Jᵀ P J)⁻¹ is scaled by the variance factor
    that the residuals along the edge show: deviations from the profile that repeat along the edge belong to its shape
    and make the factor small, texture and edges that are not quite straight make it large. The factor of a short edge
    is uncertain; it is drawn to that of the photo as a whole (`PRIOR_FREEDOMS`), or to what the photo's noise alone
    makes if that is more. Correlation between neighbouring patches enlarges it by 1 + 2 ρ; ρ too is drawn to that of
    the other edges.

    Parameters
    ----------
    largest_shift
        Edge points move by no more in one step [px].
    photo_noise
        Standard deviation of the photo's noise [grey levels].
    """
    owners, count = placed.patches.owners, placed.patches.edge_count
    across = placed.gains * np.clip(points.shifts, -largest_shift, largest_shift)
    noise = noise_variances(points, owners, count)
    weights = points.information / placed.gains**2 / noise[owners]
    seen = weights > 0.0
    robust = np.ones(len(owners))
    for _ in range(ROBUST_ROUNDS):
        angles, offsets, pivots, covariances = _solve(placed.positions, across, weights * robust, owners, count)
        residuals = across - offsets[owners] - (placed.positions - pivots[owners]) * angles[owners]
        normalised = residuals * np.sqrt(weights)
        scale = np.sqrt(group_medians(normalised**2, owners, seen, count) / MEDIAN_OF_SQUARE)
        limit = REACH * np.maximum(scale, 1.0)[owners]
        robust = np.minimum(1.0, limit / np.maximum(np.abs(normalised), 1e-12))
    squares = np.bincount(owners, robust * normalised**2, count)
    numbers = np.bincount(owners[seen], minlength=count)
    white = np.minimum(1.0, photo_noise**2 / noise)
    factors = variance_factors(squares, np.maximum(numbers - 2.0, 0.0), white)
    lever = placed.positions - pivots[owners]
    strength = np.sqrt(weights * robust)
    design = np.column_stack([np.sqrt(covariances[owners, 1, 1]), np.sqrt(covariances[owners, 0, 0]) * lever])
    design *= strength[:, None]
    factors *= 1.0 + 2.0 * neighbour_correlations(normalised * np.sqrt(robust), design, owners, seen, factors)
    return LineFit(
        angles=angles,
        offsets=offsets,
        pivots=pivots,
        covariances=covariances * factors[:, None, None],
        grey_variances=noise * factors,
        point_counts=numbers,
    )


def _solve(
    positions: Scalars, across: Scalars, weights: Scalars, owners: Indices, count: int
) -> tuple[PerEdge, PerEdge, PerEdge, Array]:
    """Solve for angle and offset of every line about its weighted centre (the pivot)."""
    total = np.maximum(np.bincount(owners, weights, count), 1e-300)
    pivots = np.bincount(owners, weights * positions, count) / total
    lever = positions - pivots[owners]
    moment = np.maximum(np.bincount(owners, weights * lever**2, count), 1e-300)
    offsets = np.bincount(owners, weights * across, count) / total
    angles = np.bincount(owners, weights * lever * across, count) / moment
    covariances = np.zeros((count, 2, 2))
    covariances[:, 0, 0], covariances[:, 1, 1] = 1.0 / moment, 1.0 / total
    return angles, offsets, pivots, covariances


def variance_factors(squares: Scalars, freedoms: Scalars, white: Scalars) -> Scalars:
    """Mix the variance factor of each edge with that of all edges of the photo.

    Parameters
    ----------
    squares, freedoms
        (n,) sums of squared normalised residuals, and their degrees of freedom.
    white
        (n,) factors that the photo's noise alone lets expect.
    """
    enough = freedoms >= 2.0
    common = 1.0
    if enough.any():
        # medians of chi-square / freedoms lie below 1 (Wilson and Hilferty); long edges know more of the factor
        typical = squares[enough] / freedoms[enough] / (1.0 - 2.0 / (9.0 * freedoms[enough])) ** 3
        median, known = weighted_median(typical, freedoms[enough])
        common = (PRIOR_FREEDOMS + known * median) / (PRIOR_FREEDOMS + known)
    mixed = (PRIOR_FREEDOMS * np.maximum(common, white) + squares) / (PRIOR_FREEDOMS + freedoms)
    return np.asarray(np.maximum(LEAST_WHITE * white, mixed), dtype=np.float64)


def weighted_median(values: Scalars, weights: Scalars) -> tuple[float, float]:
    """Give the value with half of the weight below it, and the sum of the weights."""
    order = np.argsort(values)
    known = np.cumsum(weights[order])
    return float(values[order[np.searchsorted(known, 0.5 * known[-1])]]), float(known[-1])


def neighbour_correlations(
    normalised: Scalars, design: Float64[Array, "m 2"], owners: Indices, seen: Flags, factors: PerEdge
) -> PerEdge:
    """Estimate the correlation of edge points of neighbouring patches of each edge, from 0 to `LARGEST_CORRELATION`.

    From the residuals, in units of the standard deviation. The fit itself makes residuals of few points anticorrelated:
    E(v vᵀ) = f (I - H) with the variance factor f; the elements of the hat matrix H = D Dᵀ are put back. The estimate
    of each edge is drawn to the median of the photo's edges.
    """
    count = len(factors)
    pair = np.flatnonzero((owners[1:] == owners[:-1]) & seen[1:] & seen[:-1])
    edge, scale = owners[pair], factors[owners[pair]]
    products = normalised[pair] * normalised[pair + 1]
    squares = 0.5 * (normalised[pair] ** 2 + normalised[pair + 1] ** 2)
    hat = np.sum(design[pair] * design[pair + 1], axis=1)
    leverage = 0.5 * (np.sum(design[pair] ** 2, axis=1) + np.sum(design[pair + 1] ** 2, axis=1))
    numbers = np.bincount(edge, minlength=count)
    together = np.bincount(edge, products + scale * hat, count)
    own = together / np.maximum(np.bincount(edge, squares + scale * leverage, count), 1e-300)
    enough = numbers >= LEAST_PAIRS
    common = weighted_median(own[enough], numbers[enough].astype(np.float64))[0] if enough.any() else 0.0
    mixed = (PRIOR_PAIRS * common + numbers * own) / (PRIOR_PAIRS + numbers)
    return np.asarray(np.clip(mixed, 0.0, LARGEST_CORRELATION))


def moved(lines: EdgeLines, fit: LineFit) -> EdgeLines:
    """Apply the corrections; the new centres are the pivots."""
    centres = lines.centres + fit.pivots[:, None] * lines.directions + fit.offsets[:, None] * lines.normals
    angle = np.clip(fit.angles, -0.2, 0.2)
    directions = np.cos(angle)[:, None] * lines.directions + np.sin(angle)[:, None] * lines.normals
    return replace(lines, centres=centres, directions=directions, extents=lines.extents - fit.pivots[:, None])
