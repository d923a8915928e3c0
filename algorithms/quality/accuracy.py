"""Accuracy figures under the names of the dissertation's tables 4.1, 4.3, 5.2 and 5.4 (Lichtenstein 2011)."""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Flags, Matrix, Scalars, Vectors2
from algorithms.geometry.poses import OptionalTriple, PoseEstimate

NORMAL_95 = 1.96
"""z(0.975), the dissertation's limit of normalised residuals. It rejects 5 % of good observations (MATH 4.2)."""


@dataclass(frozen=True)
class AccuracyFigures:
    """A registration in a few numbers; None where nothing was determined."""

    mean_std_rotation_rad: float | None
    """Mean standard deviation of ω, φ, κ [rad]."""
    max_std_rotation_rad: float | None
    mean_std_translation_m: float | None
    """Mean standard deviation of tx, ty, tz [m]."""
    max_std_translation_m: float | None
    max_angle_rad: float | None
    """Largest angle between corresponding lines after the transformation [rad]."""
    max_shortest_distance_m: float | None
    """Largest shortest distance between corresponding lines, endless, eq. (4.17) [m]."""
    max_offset_m: float | None
    """Largest distance in the middle of the piece that both scans see [m]: what a user would measure."""
    max_normalised: float | None
    """Largest |NV|, eq. (3.11): residual over its standard deviation with the estimated sigma0."""
    share_beyond_196: float | None
    """Share of |NV| above 1.96; 5 % where all is well. For comparison only, nothing is decided by it."""


def accuracy_figures(
    pose: PoseEstimate,
    *,
    used: Flags,
    angles_rad: Scalars,
    shortest_distances_m: Scalars,
    offsets_m: Vectors2,
    normalised: Matrix,
    controlled: Matrix,
    sigma0: float | None,
) -> AccuracyFigures:
    """Summarise a registration by lines (Lichtenstein 2011, tables 4.1 to 5.4, eqs. 3.11 and 4.17).

    Parameters
    ----------
    pose
        With the covariance whose standard deviations are meant.
    used
        (n,) True for the lines that took part.
    angles_rad, shortest_distances_m, offsets_m
        Of all n lines.
    normalised
        (n, 4) residuals over their standard deviations, sigma0 = 1.
    controlled
        (n, 4) 1 where such a figure exists, 0 elsewhere.
    sigma0
        A posteriori; None without redundancy.
    """
    values = np.abs(normalised[used][controlled[used] > 0.0])
    nv = values / sigma0 if sigma0 else values[:0]
    rotation, translation = pose.omega_phi_kappa_std_rad, pose.translation_std_m
    return AccuracyFigures(
        mean_std_rotation_rad=_mean(rotation),
        max_std_rotation_rad=_largest(rotation),
        mean_std_translation_m=_mean(translation),
        max_std_translation_m=_largest(translation),
        max_angle_rad=_maximum(angles_rad[used]),
        max_shortest_distance_m=_maximum(shortest_distances_m[used]),
        max_offset_m=_maximum(np.linalg.norm(offsets_m[used], axis=1)),
        max_normalised=_maximum(nv),
        share_beyond_196=float((nv > NORMAL_95).mean()) if len(nv) else None,
    )


def _mean(std: OptionalTriple) -> float | None:
    known = [value for value in std if value is not None]
    return sum(known) / 3.0 if len(known) == 3 else None


def _largest(std: OptionalTriple) -> float | None:
    known = [value for value in std if value is not None]
    return max(known) if len(known) == 3 else None


def _maximum(values: Scalars) -> float | None:
    return float(values.max()) if len(values) else None
