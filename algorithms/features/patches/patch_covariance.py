"""Honest covariance of a fitted surface, from patches instead of points.

Neighbouring points share errors (waviness of the surface, range offsets of the instrument), so the white-noise
covariance sigma^2 / n is far too small on real scans. The mean residuals of patches tell how much: a patch mean is
taken as an observation of variance w^2 + s^2 / n, and w^2 is the value for which the weighted squared residuals of the
patches are as large as their redundancy says (the estimator of Paule and Mandel, 1982, doi:10.6028/jres.087.022).
On an ideal surface w vanishes and the formal covariance is left.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from algorithms.arrays import Array, Matrix, Scalars
from algorithms.features.patches import patch_covariance_kernels as kernels

LONG_WAVES = 8.0
"""Waves of a surface are longer than a patch, so neighbouring patches share them, and another set-up sees another part
of them: their share of the covariance is that of an eighth of the patches. Calibrated on walls and floors seen from
two set-ups of known pose (tripod scans of a garage and of facades)."""
SIGNIFICANCE = 1.5
"""Standard deviations by which patches must scatter too much before a surface is called wavy. Chosen on those scans."""
SIGNIFICANCE_AMONG_EVEN = 3.0
"""The same where most surfaces of a scan are even: there a scatter that is only just too large is mostly chance, and
taken for waviness it makes the covariance of good surfaces a tenth too large."""
KNOWN_REDUNDANCY = 6.0
"""Surfaces of at least this redundancy can tell their own waviness."""
NUMERICAL_STD_M = 1e-9
"""Rounding of coordinates: keeps weights finite on exact data."""


@dataclass(frozen=True, eq=False)
class PatchFit:
    """Least-squares adjustment of patch means."""

    corrections: Array
    """(u,) corrections of the parameters."""
    covariance: Float64[Array, "u u"]
    """(u, u) covariance of the parameters."""
    waviness_variance: float
    """Variance of patch means beyond the noise of their points [m2]."""
    redundancy: int
    """Patches minus parameters."""


def fit_patches(jacobian: Matrix, misfits: Scalars, noise_variances: Scalars, waviness_variance: float) -> PatchFit:
    """Adjust u parameters to p patch means with a given waviness.

    Parameters
    ----------
    jacobian
        (p, u) derivatives of the surface's offset at each patch by the parameters.
    misfits
        (p,) mean signed distances of the patches from the surface [m].
    noise_variances
        (p,) variance of each mean from the noise of its points [m2].
    waviness_variance
        Variance added to each [m2].
    """
    corrections, covariance = kernels.adjust(jacobian, misfits, noise_variances + waviness_variance)
    return PatchFit(corrections, covariance, waviness_variance, len(misfits) - int(jacobian.shape[1]))


def honest_covariance(
    jacobian: Matrix, misfits: Scalars, noise_variances: Scalars, waviness_variance: float
) -> Float64[Array, "u u"]:
    """Give the covariance of the parameters with the share of the waviness counted `LONG_WAVES` times."""
    return adjust_patches(jacobian, misfits, noise_variances, waviness_variance)[1]


def adjust_patches(
    jacobian: Matrix, misfits: Scalars, noise_variances: Scalars, waviness_variance: float
) -> tuple[Float64[Array, "u"], Float64[Array, "u u"]]:
    """Give the corrections of the parameters and their honest covariance."""
    corrections, white = kernels.adjust(jacobian, misfits, noise_variances)
    if waviness_variance == 0.0:
        return corrections, white
    corrections, wavy = kernels.adjust(jacobian, misfits, noise_variances + waviness_variance)
    return corrections, white + LONG_WAVES * (wavy - white)


def estimate_waviness(
    jacobian: Matrix, misfits: Scalars, noise_variances: Scalars, significance: float = SIGNIFICANCE
) -> float:
    """Estimate the variance of patch means beyond the noise of their points [m2].

    It is zero while the squared residuals exceed their redundancy by no more than `significance` standard deviations:
    otherwise half of all ideal surfaces would be called wavy by chance.
    """
    redundancy = len(misfits) - int(jacobian.shape[1])
    if redundancy < 1:
        return 0.0
    if kernels.excess(jacobian, misfits, noise_variances) <= significance * np.sqrt(2.0 * redundancy):
        return 0.0
    return float(kernels.waviness(jacobian, misfits, noise_variances))


def estimate_wavinesses(systems: list[tuple[Array, Array, Array]]) -> Scalars:
    """Estimate the waviness of all surfaces of a scan, (k,) [m2], each steadied by the others.

    Parameters
    ----------
    systems
        Jacobian (p, u), misfits (p,) and noise variances (p,) of every surface, as `estimate_waviness` takes them.
    """
    redundancies = np.array([len(misfits) - jacobian.shape[1] for jacobian, misfits, _ in systems], dtype=np.float64)
    wavinesses = np.array([estimate_waviness(*system) for system in systems], dtype=np.float64)
    known = redundancies >= KNOWN_REDUNDANCY
    if known.any() and float(np.median(wavinesses[known])) == 0.0:
        wavinesses = np.array([estimate_waviness(*system, SIGNIFICANCE_AMONG_EVEN) for system in systems])
    return shrink_variances(wavinesses, redundancies)


def shrink_variances(variances: Scalars, redundancies: Scalars, prior_redundancy: float = KNOWN_REDUNDANCY) -> Scalars:
    """Pull variances of few degrees of freedom towards the median of the well-determined ones.

    A surface with four patches cannot tell its own waviness; others of the same scan can.
    """
    if len(variances) == 0:
        return variances
    known = redundancies >= prior_redundancy
    prior = float(np.median(variances[known])) if known.any() else float(np.median(variances))
    redundancy = np.maximum(redundancies, 0.0)
    return np.asarray((redundancy * variances + prior_redundancy * prior) / (redundancy + prior_redundancy))
