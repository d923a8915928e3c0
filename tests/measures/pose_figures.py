"""How far a registered pair's pose lies from the truth, in figures that benchmarks print."""

from dataclasses import dataclass

import numpy as np

from algorithms.progress import NoProgress
from algorithms.registration import DEFAULT_METHOD
from algorithms.registration.base import PairStatus, RegistrationProblem

WRONG_RAD, WRONG_M = np.radians(0.3), 0.05
"""A pose farther from the truth than this is another one."""


@dataclass(frozen=True, eq=False)
class PairFigures:
    """Status, error and stated uncertainty of a pair; NaN where it has no pose."""

    status: PairStatus
    reasons: tuple
    estimator: str
    feature_share: float
    error: np.ndarray
    """(6,) rotation vector (left, target axes) [rad] and translation of the reduced frames [m], true minus found."""
    covariance: np.ndarray
    instrument_error_m: float
    """How far the source's instrument stands from where it stood."""
    instrument_std_m: float
    """The same as stated: root of the trace of its covariance."""
    centre_error_m: float
    """How far the centre of the source's surface lies from where it lay."""
    result: object

    @property
    def accepted(self):
        return self.status is PairStatus.ACCEPTED

    @property
    def wrong(self):
        """Whether it is said to be in place and is not: an accepted pose elsewhere, a coarse one beyond its covariance.

        Chi-square of six degrees of freedom exceeds 28 once in ten thousand.
        """
        if not self.status.in_place or self.right:
            return False
        return self.accepted or not self.nees < 28.0

    @property
    def right(self):
        """Whether there is a pose and it is the true one, whatever its status."""
        return bool(np.linalg.norm(self.error[:3]) < WRONG_RAD and self.centre_error_m < WRONG_M)

    @property
    def nees(self):
        """Normalised estimation error squared: chi-square with 6 degrees of freedom where the covariance is honest.

        NaN where the pose leaves motions free.
        """
        if self.result.final is None or self.result.final.free_directions:
            return np.nan
        return float(self.error @ np.linalg.solve(self.covariance, self.error))

    def __str__(self):
        """Say it in one line."""
        if not self.estimator:
            return f"{self.status.value}, no pose"
        return (
            f"{self.status.value}{'' if self.right else ', WRONG'} by {self.estimator}, NEES {self.nees:.1f}; "
            f"instrument {1e3 * self.instrument_error_m:.2f} mm off, stated {1e3 * self.instrument_std_m:.2f} mm; "
            f"turned by {1e6 * np.linalg.norm(self.error[:3]):.0f} microradians"
        )


def pair_figures(target, source, truth, method=DEFAULT_METHOD):
    """Register two scans' features and compare with the true motion between their reduced frames."""
    problem = RegistrationProblem(target, source)
    result = method().register(problem, progress=NoProgress())
    if result.final is None:
        nothing = np.full(6, np.nan)
        return PairFigures(
            result.status, result.reasons, "", np.nan, nothing, np.eye(6), np.nan, np.nan, np.nan, result
        )
    pose, covariance = result.final.reduced.target_from_source, result.final.reduced.covariance
    turn = (truth.rotation * pose.rotation.inv()).as_rotvec()
    instrument, centre = source.sensor_m, source.surface.points.mean(axis=0)
    # Left perturbation: a point moves by the turn about the pose's translation and by the shift.
    lever = pose.apply(instrument) - pose.translation
    x, y, z = lever
    by_pose = np.hstack([np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]), np.eye(3)])
    return PairFigures(
        result.status,
        result.reasons,
        result.final.estimator,
        result.final.feature_share,
        np.concatenate([turn, truth.translation - pose.translation]),
        covariance,
        float(np.linalg.norm(pose.apply(instrument) - truth.apply(instrument))),
        float(np.sqrt(np.trace(by_pose @ covariance @ by_pose.T))),
        float(np.linalg.norm(pose.apply(centre) - truth.apply(centre))),
        result,
    )
