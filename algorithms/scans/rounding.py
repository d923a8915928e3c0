"""What rounded coordinates do to surfaces: errors that all points on one step share (quantisation error).

A coordinate x that is rounded to multiples of s has the error e(x) = s Σ (-1)^m sin(2π m x/s)/(π m), m = 1, 2, …
(Bennett 1948; Widrow and Kollár, *Quantization Noise*, 2008). Where a surface lies on the steps is not known, so its
phase is taken as random. Points at x and x' then have errors with the covariance Σ s²/(2π² m²) cos(2π m (x - x')/s):
s²/12 for points on one step, nothing on the average over a surface that crosses many of them. What scatters before it
is rounded loses the harmonic m by exp(-2π² m² σ²/s²), σ the standard deviation of the scatter (dither).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from algorithms.arrays import Array, Points, Scalars, Vector3
from algorithms.scans.coordinate_steps import CoordinateSteps

HARMONICS = np.arange(1.0, 7.0)
SHARES = HARMONICS**-2.0 / np.sum(HARMONICS**-2.0) / 12.0
"""Variances of the harmonics of the rounding error of unit steps; they stand for the higher ones too: the sum is 1/12.
"""
LARGEST_EXPONENT = 50.0
"""Of a harmonic that is damped by more than exp(-50) nothing is left."""


@dataclass(frozen=True, eq=False)
class RoundedPieces:
    """How p pieces of a surface meet the steps of one coordinate."""

    step_m: float
    places: Scalars
    """(p,) mean coordinate of each piece, in steps."""
    slopes: Scalars
    """(p,) what an error of the coordinate by one metre moves the surface by [m/m]."""
    damping: Float64[Array, "p 6"]
    """(p, 6) what is left of each harmonic by the scatter and the extent of the piece."""

    @property
    def variances(self) -> Scalars:
        """(p,) variance of the mean of each piece [m2]."""
        return np.asarray(np.square(self.step_m * self.slopes) * (np.square(self.damping) @ SHARES))

    def waves(self) -> tuple[Array, Array]:
        """Give the cosine and the sine part of each harmonic of the error of each piece, (p, 6) each [m].

        Parts of a piece have the mean of theirs; the covariance of pieces is the sum of the products of both parts.
        """
        angles = 2.0 * np.pi * self.places[:, None] * HARMONICS
        size = self.step_m * self.slopes[:, None] * self.damping * np.sqrt(SHARES)
        return size * np.cos(angles), size * np.sin(angles)

    def covariance(self, losses: Array | None = None) -> Array:
        """Give the covariance (p, p) of the means of all pieces [m2].

        Parameters
        ----------
        losses
            (p, p) variance of what is not known of the difference of two places, in squared steps; None: all is known.
        """
        cosines, sines = self.waves()
        if losses is None:
            return np.asarray(cosines @ cosines.T + sines @ sines.T)
        total = np.zeros((len(cosines), len(cosines)))
        for m, harmonic in enumerate(HARMONICS.tolist()):
            own = np.outer(cosines[:, m], cosines[:, m]) + np.outer(sines[:, m], sines[:, m])
            total += own * np.exp(-2.0 * (np.pi * harmonic) ** 2 * losses)
        return total


def is_smoothed(step_m: float, scatter_m: float) -> bool:
    """Say whether a scatter before the rounding leaves nothing of its error."""
    return step_m == 0.0 or 2.0 * (np.pi * scatter_m / step_m) ** 2 >= LARGEST_EXPONENT


def rounded_pieces(
    steps: CoordinateSteps,
    positions: Points,
    normals: Points,
    extents: Float64[Array, "p 2 3"],
    scatter_m: Scalars,
    sensor_m: Vector3 | None,
) -> list[RoundedPieces]:
    """Say how pieces of a surface meet the steps of each coordinate that has any.

    Parameters
    ----------
    steps
        Of the scan.
    positions, normals
        (p, 3) middle of each piece [m], and unit normal there.
    extents
        (p, 2, 3) the two sides of each piece, as vectors [m].
    scatter_m
        (p,) standard deviation of points across the surface before they were rounded [m].
    sensor_m
        Where the instrument stood; None: ranges are not known.
    """
    found = []
    for axis in np.flatnonzero(steps.axes_m > 0.0).tolist():
        along = np.zeros_like(normals)
        along[:, axis] = 1.0
        found.append(_pieces(float(steps.axes_m[axis]), positions[:, axis], along, normals, extents, scatter_m))
    if sensor_m is not None and steps.range_m > 0.0:
        rays = positions - sensor_m
        ranges = np.linalg.norm(rays, axis=1)
        along = rays / np.maximum(ranges, 1e-9)[:, None]
        found.append(_pieces(steps.range_m, ranges, along, normals, extents, scatter_m))
    return found


def _pieces(
    step: float, places: Scalars, along: Points, normals: Points, extents: Array, scatter_m: Scalars
) -> RoundedPieces:
    slopes = np.einsum("pi,pi->p", along, normals)
    within = np.square(np.einsum("pi,pki->pk", along, extents)).sum(axis=1) / 12.0
    exponents = 2.0 * np.square(np.pi / step) * (within + np.square(scatter_m))[:, None] * HARMONICS**2
    left = np.exp(-np.minimum(exponents, LARGEST_EXPONENT))
    damping = np.where(exponents < LARGEST_EXPONENT, left, 0.0)
    return RoundedPieces(step, places / step, slopes, damping)
