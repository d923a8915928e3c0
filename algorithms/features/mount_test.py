"""Do the photos of a station fit its scan? The result of a test, and what it means in words."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from algorithms.arrays import Array, Vector3

ALONG_AXIS = 0.94
"""From this cosine on (20 degrees) a turn is said to be about an axis of the scan."""

WHAT_TO_CHECK = (
    "check that scan_from_camera leads from the camera to the scan and is not inverted, that the camera's axes are as "
    "camera_axes says (x right, y down, z forward unless said otherwise), that the photos are not exchanged, and that "
    "the focal length is in pixels of this photo"
)
"""What mostly is wrong where photos and scan show nothing in common."""


@dataclass(frozen=True, eq=False)
class MountTest:
    """Test of the stated poses of q cameras by the lines that both photo and scan of a station show.

    Under the hypothesis that all stated poses are as certain as their covariances say, `statistic` is distributed as
    chi-square.
    """

    statistic: float
    """T of all photos together."""
    degrees_of_freedom: int
    """Combinations of the mounts' errors that the lines determine, at most 6 q; 0: nothing could be tested."""
    critical: float
    """Limit of T; 0 where nothing could be tested."""
    variance_factor: float
    """How much larger the squared differences of the lines are than stated, any mounts given; at least 1. T allows for
    it."""
    pair_counts: Int64[Array, "q"]
    """(q,) lines of each photo that were compared with a line of the scan."""
    statistics: Float64[Array, "q"]
    """(q,) T of each photo by itself."""
    degrees_of_freedom_each: Int64[Array, "q"]
    """(q,) of these."""
    criticals: Float64[Array, "q"]
    """(q,) limits of these."""
    mount_errors: Float64[Array, "q 6"]
    """(q, 6) estimated errors of the stated poses `scan_from_camera`: rotation vector on the left in scan axes [rad],
    translation [m]; what is stated is the true pose changed by these. Not drawn towards the stated pose."""
    error_covariances: Float64[Array, "q 6 6"]
    """(q, 6, 6) of these estimates."""

    @property
    def contradicts(self) -> bool:
        """Whether photos and scan contradict each other."""
        return self.statistic > self.critical

    @property
    def passed(self) -> bool | None:
        """Whether photos and scan fit; None where nothing could be tested."""
        return None if self.degrees_of_freedom == 0 else not self.contradicts

    def untested_in_words(self) -> str | None:
        """Say why nothing could be tested; None where something was."""
        if self.degrees_of_freedom:
            return None
        compared = int(self.pair_counts.sum())
        if compared:
            return f"only {compared} lines of the photos were found again in the scan: too few to test any mount by"
        return (
            "no line of any photo was found again where planes of the scan meet, so nothing could be tested; where the "
            f"scan has such edges in the photos, {WHAT_TO_CHECK}"
        )

    def in_words(self) -> str | None:
        """Say what is wrong with the mounts; None while nothing is.

        Photos count from 1, as the pictures among the results do.
        """
        if not self.contradicts:
            return None
        wrong = np.flatnonzero(self.statistics > self.criticals)
        if len(wrong) == 0:
            wrong = np.array([np.argmax(self.statistics - self.criticals)])
        parts = [
            f"photo {q + 1} ({self.pair_counts[q]} lines): {_motion(self.mount_errors[q], self.error_covariances[q])}"
            for q in wrong.tolist()
        ]
        return (
            "the photos contradict the scan, which shows the same lines elsewhere: mount error of about "
            f"{'; '.join(parts)}; global test T = {self.statistic:.1f} > {self.critical:.1f} with "
            f"{self.degrees_of_freedom} degrees of freedom"
        )


def _motion(error: Float64[Array, "6"], covariance: Float64[Array, "6 6"]) -> str:
    """Describe a small turn and a small shift with their standard deviations."""
    gon = 200.0 / np.pi
    turn, shift = float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))
    axis, towards = error[:3] / max(turn, 1e-12), error[3:] / max(shift, 1e-12)
    turn_std = float(np.sqrt(max(axis @ covariance[:3, :3] @ axis, 0.0)))
    shift_std = float(np.sqrt(max(towards @ covariance[3:, 3:] @ towards, 0.0)))
    return (
        f"{turn * gon:.3f} gon about {_direction(axis)} (std {turn_std * gon:.3f} gon) and "
        f"{shift * 1e3:.1f} mm along {_direction(towards)} (std {shift_std * 1e3:.1f} mm)"
    )


def _direction(unit: Vector3) -> str:
    largest = int(np.argmax(np.abs(unit)))
    if abs(unit[largest]) >= ALONG_AXIS:
        return "xyz"[largest]
    return f"({unit[0]:.2f}, {unit[1]:.2f}, {unit[2]:.2f})"
