"""Compare a registration with a reference, the dissertation's tables 4.2, 4.4, 5.3 and 5.5, with significance."""

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from algorithms.arrays import Array
from algorithms.geometry.pose_parameters import PARAMETERS, pose_parameters
from algorithms.geometry.poses import PoseEstimate
from algorithms.probabilities import chi2_isf, chi2_sf, norm_isf


@dataclass(frozen=True)
class ComparedParameter:
    """One parameter beside its reference; angles in rad, shifts in m."""

    name: str
    """One of `PARAMETERS`."""
    estimated: float
    reference: float
    difference: float
    """Estimated minus reference; angles the short way round."""
    std: float | None
    """Standard deviation of the difference, that of the reference included where it is known; None where the
    parameter is not determined."""
    ratio: float | None
    """|difference| over its standard deviation; None without one."""
    significant: bool | None
    """Whether the ratio exceeds its two-sided normal limit; None without standard deviation."""


@dataclass(frozen=True)
class JointTest:
    """Test of all determined parameters together."""

    statistic: float
    """dᵀ C⁻¹ d."""
    degrees_of_freedom: int
    critical: float
    p_value: float
    """Probability of a larger statistic where nothing but noise differs."""
    significant: bool


@dataclass(frozen=True)
class PoseComparison:
    """How far two poses differ, and whether that means anything."""

    parameters: tuple[ComparedParameter, ...]
    mean_rotation_rad: float
    """Mean of the three angles' absolute differences, as the dissertation prints it [rad]."""
    mean_translation_m: float
    """Mean of the three shifts' absolute differences [m]."""
    rotation_rad: float
    """Angle of the rotation between both, which no choice of axes changes [rad]."""
    translation_m: float
    """Length of the difference of the translations [m]."""
    alpha: float
    """Probability that a test calls a difference significant that is noise."""
    limit: float
    """Limit of the ratios."""
    joint: JointTest | None
    """None where no standard deviations are known."""


def compare_poses(estimate: PoseEstimate, reference: PoseEstimate, alpha: float) -> PoseComparison:
    """Compare an estimated pose with an independent reference (Lichtenstein 2011, table 4.2; tests as MATH 4.1, 4.2).

    Each parameter by itself: |difference| / std against the two-sided normal quantile, std² = var(estimate) +
    var(reference). All six together: dᵀ (C_est + C_ref)⁻¹ d against chi-square, d = (log(R_est R_refᵀ), t_est - t_ref)
    in the perturbation of MATH 1.4; six tests at 5 % would call one of four perfect registrations different, the joint
    one calls one of twenty.

    Parameters
    ----------
    estimate
        Estimated pose with covariance. What it leaves free takes no part in the joint test.
    reference
        The same motion from elsewhere; a zero covariance counts as free of error.
    alpha
        Level of all tests.
    """
    ours, theirs = pose_parameters(estimate), pose_parameters(reference)
    differences = ours.values - theirs.values
    differences[:3] = (differences[:3] + np.pi) % (2.0 * np.pi) - np.pi
    variances = np.diag(ours.covariance) + np.diag(theirs.covariance)
    limit = float(norm_isf(alpha / 2.0))
    known = ours.determined & theirs.determined & (variances > 0.0)
    parameters = []
    for k, name in enumerate(PARAMETERS):
        std = float(np.sqrt(variances[k])) if known[k] else None
        ratio = None if std is None else abs(float(differences[k])) / std
        parameters.append(
            ComparedParameter(
                name,
                float(ours.values[k]),
                float(theirs.values[k]),
                float(differences[k]),
                std,
                ratio,
                None if ratio is None else ratio > limit,
            )
        )
    turn = (estimate.rotation * reference.rotation.inv()).as_rotvec()
    shift = estimate.translation_m - reference.translation_m
    return PoseComparison(
        parameters=tuple(parameters),
        mean_rotation_rad=float(np.abs(differences[:3]).mean()),
        mean_translation_m=float(np.abs(differences[3:]).mean()),
        rotation_rad=float(np.linalg.norm(turn)),
        translation_m=float(np.linalg.norm(shift)),
        alpha=alpha,
        limit=limit,
        joint=_joint_test(np.concatenate([turn, shift]), estimate, reference, alpha),
    )


def _joint_test(difference: Array, estimate: PoseEstimate, reference: PoseEstimate, alpha: float) -> JointTest | None:
    """Test all combinations fᵀ d that neither pose leaves free, fᵀ n = 0 for every free motion n."""
    covariance = estimate.covariance + reference.covariance
    testable = _complement(np.hstack([estimate.null_space, reference.null_space]))
    seen = testable.T @ covariance @ testable
    scale = np.sqrt(np.diag(seen))
    if not len(scale) or (scale <= 0.0).any():
        return None
    try:
        factor = linalg.cho_factor(seen / np.outer(scale, scale))
    except linalg.LinAlgError:
        return None  # some combination counts as free of error: no test
    reduced = (testable.T @ difference) / scale
    statistic = float(reduced @ linalg.cho_solve(factor, reduced))
    degrees = len(scale)
    critical = float(chi2_isf(alpha, degrees))
    return JointTest(statistic, degrees, critical, float(chi2_sf(statistic, degrees)), statistic > critical)


def _complement(directions: Array) -> Array:
    if directions.shape[1] == 0:
        return np.eye(6)
    return np.asarray(linalg.null_space((directions / np.linalg.norm(directions, axis=0)).T))
