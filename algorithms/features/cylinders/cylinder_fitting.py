"""One cylinder from its points, with covariance from blocks of its surface."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from algorithms.arrays import Array, Matrix3, Points, Vector3
from algorithms.features.cylinders import cylinder_fitting_kernels as kernels
from algorithms.features.cylinders.cylinder_axes_kernels import adjust_cylinder
from algorithms.features.patches.patch_covariance import NUMERICAL_STD_M, estimate_waviness, honest_covariance
from algorithms.geometry.lines import bases_of
from algorithms.scans.coordinate_steps import FULL_PRECISION, CoordinateSteps
from algorithms.scans.rounding import RoundedPieces, is_smoothed, rounded_pieces

BLOCKS = 32
"""Aimed number of blocks (length x arc)."""
POINTS_PER_BLOCK = 4.0
"""Least mean number of points in a block."""
ITERATIONS = 20
"""Least-squares steps at most; three or four suffice without outliers."""
STRIPS_PER_STEP, MOST_STRIPS = 2.0, 16
"""So many strips around a pipe go into the step of rounded coordinates, and so many at most into a block."""
ARC_BINS = 72
"""Bins of 5 degrees in which the seen arc is counted."""


@dataclass(frozen=True, eq=False)
class FittedCylinder:
    """A bounded cylinder with covariance."""

    anchor: Vector3
    """Point of the axis in the middle of the points [m]."""
    direction: Vector3
    basis: Float64[Array, "3 2"]
    """(3, 2) columns E1, E2."""
    radius_m: float
    covariance: Float64[Array, "5 5"]
    """(5, 5) of (a1, a2, b1, b2, radius)."""
    extent: Array
    """(2,) seen piece along the direction from the anchor [m]."""
    arc_rad: float
    noise_std_m: float
    fill: float
    """Share of the blocks between the ends and within the seen arc that hold points."""
    waviness: float
    """Variance of block means beyond the noise [m2]."""


def fit_cylinder(
    points: Points,
    anchor: Vector3,
    direction: Vector3,
    radius_m: float,
    noise_std_m: float,
    steps: CoordinateSteps = FULL_PRECISION,
) -> FittedCylinder | None:
    """Fit a cylinder to its points geometrically and give the covariance of axis and radius; None if it collapses.

    Parameters
    ----------
    points
        (n, 3) points of one cylinder, n >= 6.
    anchor, direction, radius_m
        Start values.
    noise_std_m
        Expected noise: deviations beyond two of it are weighted down.
    steps
        What the coordinates are rounded to.
    """
    c, d = anchor.copy(), direction.copy()
    radius, _, _ = adjust_cylinder(points, c, d, radius_m, ITERATIONS, max(2.0 * noise_std_m, NUMERICAL_STD_M))
    if not (0.5 * radius_m < radius < 2.0 * radius_m and np.isfinite(d).all()):
        return None
    basis = bases_of(d[None])[0]
    along, angle, misfit = kernels.unrolled(points, c, d, basis, radius)
    noise = max(float(np.sqrt(np.sum(misfit**2) / max(len(points) - 5, 1))), steps.std_m)
    low, high = np.quantile(along, [0.002, 0.998])
    middle = 0.5 * (low + high)
    seen = np.bincount(((angle + np.pi) / (2 * np.pi) * ARC_BINS).astype(np.int64) % ARC_BINS, minlength=ARC_BINS) > 0
    arc = 2 * np.pi * float(seen.mean())
    frame = np.column_stack([basis, d])
    fill, waviness, covariance = _block_covariance(along - middle, angle, misfit, radius, noise, arc, frame, steps)
    return FittedCylinder(
        anchor=c + middle * d,
        direction=d,
        basis=basis,
        radius_m=float(radius),
        covariance=covariance,
        extent=np.array([low - middle, high - middle]),
        arc_rad=arc,
        noise_std_m=noise,
        fill=fill,
        waviness=waviness,
    )


def _block_covariance(
    along: Array,
    angle: Array,
    misfit: Array,
    radius: float,
    noise: float,
    arc: float,
    frame: Matrix3,
    steps: CoordinateSteps,
) -> tuple[float, float, Float64[Array, "5 5"]]:
    """Adjust the means of surface blocks: filled share, waviness and 5x5 covariance (see `patch_covariance`)."""
    length = float(np.ptp(along)) + 1e-9
    blocks = float(np.clip(len(along) / POINTS_PER_BLOCK, 6.0, BLOCKS))
    size = np.sqrt(length * arc * radius / blocks)
    rows = max(3, round(length / size))
    columns = max(6, round(2 * np.pi * radius / size))
    sums = kernels.sum_blocks(along, angle, misfit, length, rows, columns)
    used = np.flatnonzero(sums[:, 0] > 0)
    n = sums[used, 0]
    s, u, v, r, squares = sums[used, 1:].T / n
    within = squares - r**2
    variances = (n * np.maximum(within, 0.0) + 10.0 * noise**2) / (n + 9.0) / n + NUMERICAL_STD_M**2
    jacobian = np.stack([s * u, s * v, u, v, np.ones_like(u)], axis=1)
    scatter = float(np.sqrt(max(noise**2 - steps.std_m**2, 0.0)))
    sides = length / rows, 2 * np.pi / columns
    waves = [_waves(own, len(used)) for own in _rounded(s, u, v, radius, sides, scatter, frame, steps)]
    shared = np.sum([np.sum(own**2, axis=1) for own in waves], axis=0) if waves else 0.0
    waviness = estimate_waviness(jacobian, r, variances + shared)
    covariance = honest_covariance(jacobian, r, variances, waviness)
    gain = np.linalg.pinv(jacobian / np.sqrt(variances + waviness)[:, None]) / np.sqrt(variances + waviness)
    for own in waves:
        covariance += (gain @ own) @ (gain @ own).T
    fill = len(used) / (rows * len(np.unique(used % columns)))
    return fill, waviness, covariance


def _waves(pieces: RoundedPieces, blocks: int) -> Array:
    """Give the error of each block by rounding, from those of its parts: columns are independent (blocks, 12) [m]."""
    return np.hstack([part.reshape(blocks, -1, part.shape[1]).mean(axis=1) for part in pieces.waves()])


def _rounded(
    along: Array,
    cosines: Array,
    sines: Array,
    radius: float,
    sides: tuple[float, float],
    scatter_m: float,
    frame: Matrix3,
    steps: CoordinateSteps,
) -> list[RoundedPieces]:
    """Say how the blocks meet the steps of rounded coordinates: a pipe along an axis meets them alike everywhere.

    A block of `sides` (length [m], arc [rad]) is cut into strips along the pipe, those of a block in a row: where
    the surface lies across an axis only a strip as narrow as the step is wide lies on one step.
    """
    finest = float(np.max(steps.axes_m, initial=0.0))
    if is_smoothed(finest, scatter_m):
        return []
    strips = int(np.clip(np.ceil(STRIPS_PER_STEP * sides[1] * radius / finest), 1, MOST_STRIPS))
    offsets = ((np.arange(strips) + 0.5) / strips - 0.5) * sides[1]
    angles = (np.arctan2(sines, cosines)[:, None] + offsets).ravel()
    normals = np.column_stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)])
    positions = radius * normals + np.outer(np.repeat(along, strips), [0.0, 0.0, 1.0])
    around = np.column_stack([-normals[:, 1], normals[:, 0], np.zeros_like(angles)])
    lengthwise = np.tile([0.0, 0.0, sides[0]], (len(angles), 1))
    extents = np.stack([lengthwise, sides[1] * radius / strips * around], axis=1) @ frame.T
    scatter = np.full(len(angles), scatter_m)
    pieces = rounded_pieces(steps, positions @ frame.T, normals @ frame.T, extents, scatter, None)
    return [own for own in pieces if own.damping.any()]
