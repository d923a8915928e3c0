"""The pose in which points that were picked in two scans lie on each other, how well it is known, and what is off."""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Points
from algorithms.closest_points.motions import best_motion
from algorithms.errors import DegenerateGeometryError, TooFewCorrespondencesError
from algorithms.geometry.poses import PoseEstimate
from algorithms.geometry.rotations import cross_matrices
from algorithms.probabilities import chi2_isf

LEAST_PICKED = 3
ALPHA = 0.001
"""Probability with which good picks are taken for contradictory."""
LEAST_WIDTH_STDS = 3.0
"""The points must lie so many standard deviations off the line that fits them best (root mean square)."""


@dataclass(frozen=True, eq=False)
class PickedPose:
    """What picked points say of a pose."""

    pose: PoseEstimate
    """Target from source, with the covariance that the stated standard deviation of the picks makes."""
    residuals_m: Points
    """(n, 3) target point less moved source point, target axes [m]."""
    statistic: float
    """Sum of squared residuals over their variance: chi-square with 3 n - 6 degrees of freedom for good picks."""
    critical: float
    """Its limit at `ALPHA`."""

    @property
    def contradictory(self) -> bool:
        """Whether the picks do not belong together: points were mixed up, or are rougher than stated."""
        return self.statistic > self.critical


def picked_pose(target: Points, source: Points, std_m: float) -> PickedPose:
    """Lay picked points on each other in closed form (Horn 1987), and propagate the standard deviation of the picks.

    With A_i = (-[r_i]x, I), r_i = R x_i, and variance 2 s^2 of each coordinate of a residual (both ends are picked),
    the covariance is (sum A_i^T A_i)^-1 2 s^2 of (rotation vector on the left, translation), MATH 1.4, 3.1; it is
    taken at the centroid, where rotation and translation separate, and moved from there.

    Parameters
    ----------
    target, source
        (n, 3) the same points in either scan [m]; near the origin, or digits are lost.
    std_m
        Standard deviation of each coordinate of a pick in either scan [m].

    Raises
    ------
    TooFewCorrespondencesError
        Fewer than three.
    DegenerateGeometryError
        They lie on one line, or in one place: the turn about it stays free.
    """
    if len(target) < LEAST_PICKED:
        raise TooFewCorrespondencesError(len(target), LEAST_PICKED, "picked points")
    for points in (target, source):
        _require_width(points, std_m)
    motion = best_motion(target, source, np.ones(len(target)))
    moved = np.asarray(motion.apply(source))
    centre = moved.mean(axis=0)
    levers = cross_matrices(moved - centre)
    turns = np.einsum("nji,njk->ik", levers, levers)  # sum of [r]x^T [r]x
    cofactors = np.zeros((6, 6))
    cofactors[:3, :3] = np.linalg.solve(turns, np.eye(3))
    cofactors[3:, 3:] = np.eye(3) / len(target)
    # the translation of the pose is the place of the source's origin: moved by the turn about the centroid as well
    shift = np.eye(6)
    shift[3:, :3] = -cross_matrices((np.asarray(motion.translation) - centre)[None])[0]
    covariance = 2.0 * std_m**2 * shift @ cofactors @ shift.T
    residuals = target - moved
    statistic = float(np.sum(residuals**2)) / (2.0 * std_m**2)
    critical = float(chi2_isf(ALPHA, 3 * len(target) - 6))
    return PickedPose(PoseEstimate(motion, 0.5 * (covariance + covariance.T)), residuals, statistic, critical)


def _require_width(points: Points, std_m: float) -> None:
    """Refuse points on one line."""
    centred = points - points.mean(axis=0)
    spreads = np.linalg.svd(centred, compute_uv=False) / np.sqrt(len(points))
    if spreads[1] >= LEAST_WIDTH_STDS * std_m:
        return
    axis = np.linalg.svd(centred)[2][0]
    words = "(" + ", ".join(f"{value:.2f}" for value in axis) + ")"
    raise DegenerateGeometryError(
        5 if spreads[0] >= LEAST_WIDTH_STDS * std_m else 3,
        (f"rotation about {words}: the picked points lie within {spreads[1]:.3f} m of one line",),
        advice="pick points farther apart, and not on one line",
    )
