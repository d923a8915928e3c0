"""What photos show of targets, decided together: the error of the mount is common to all that one photo shows."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, Matrix6, Scalars
from algorithms.probabilities import chi2_isf

OUTSIDE_SIGNIFICANCE = 1e-4
"""A place that the covariances of scan, mount and photo make less likely is another thing."""
MOST_STARTS = 60
"""Candidates from which a set that agrees is begun."""
AS_GOOD = 0.5
"""Another set of as many is as good if it leaves less than 1/so much as unexplained."""


@dataclass(frozen=True, eq=False)
class ImagePoint:
    """A target's centre in a photo."""

    target: int
    """Number of the target among those looked for."""
    image_px: Array
    """(2,) column and row, 0 at the centre of the first pixel: the projection of the centre, not of the outline's."""
    covariance_px2: Array
    """(2, 2) of the measurement in the photo alone."""
    expected_px: Array
    """(2,) where scan, mount and camera have it."""
    expected_covariance_px2: Array
    """(2, 2) of that: target and mount."""
    agreement: float
    """Share of the brightness's variance that the target explains, 0..1."""
    contrast: float
    """Bright minus dark [grey levels]."""

    @property
    def statistic(self) -> float:
        """Give the squared distance from the expected place in standard deviations: chi-square with two degrees."""
        off = self.image_px - self.expected_px
        return float(off @ np.linalg.solve(self.covariance_px2 + self.expected_covariance_px2, off))


@dataclass(frozen=True, eq=False)
class NotSeen:
    """A target that a photo does not show."""

    target: int
    """Number of the target among those looked for."""
    reason: str
    """Why not, in words with figures; empty where it lies outside the photo."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A place in the photo that looks like a target."""

    point: ImagePoint
    own_covariance_px2: Array
    """(2, 2) of the expected place, by the target alone."""
    by_mount: Array
    """(2, 6) derivatives of the expected place by the mount."""
    size_px: float
    """Of the target."""


def agreeing(candidates: Sequence[Candidate], mount_covariance: Matrix6) -> list[ImagePoint | NotSeen]:
    """Choose the candidates, one for each target, that one error of the mount explains.

    From each candidate a set is grown: the mount's error is estimated from those chosen so far (Kalman), which narrows
    the windows of the others. The largest set counts.

    Parameters
    ----------
    candidates
        Of all targets of one photo.
    mount_covariance
        (6, 6) of the mount.

    Returns
    -------
    One entry for each target that has candidates.
    """
    if not candidates:
        return []
    everything = _Candidates.of(candidates)
    starts = sorted(range(len(candidates)), key=lambda k: -candidates[k].point.agreement)[:MOST_STARTS]
    sets = [everything.grown(k, mount_covariance) for k in starts]
    best = max(sets, key=lambda chosen: (len(chosen), -everything.unexplained(chosen)))
    own = {int(everything.targets[k]): k for k in best}
    rivals: dict[int, float] = {}
    for other in sets:
        if len(other) < len(best) or everything.unexplained(other) > everything.unexplained(best) / AS_GOOD:
            continue
        for k in other:
            chosen = own.get(int(everything.targets[k]))
            apart = 0.0 if chosen is None else float(np.linalg.norm(everything.images[k] - everything.images[chosen]))
            if apart > 0.5 * candidates[k].size_px:
                rivals[int(everything.targets[k])] = apart
    answers: list[ImagePoint | NotSeen] = []
    for target in np.unique(everything.targets).tolist():
        if target in rivals:
            reason = f"two places {rivals[target]:.0f} px apart look alike: state the mount better"
            answers.append(NotSeen(target, reason))
        elif target in own:
            answers.append(candidates[own[target]].point)
        else:
            first = candidates[int(np.flatnonzero(everything.targets == target)[0])].point
            off = float(np.linalg.norm(first.image_px - first.expected_px))
            reason = f"what looks like it is {off:.1f} px from where scan, mount and the other targets have it"
            answers.append(NotSeen(target, reason))
    return answers


@dataclass(frozen=True, eq=False)
class _Candidates:
    targets: Array
    """(n,)."""
    images: Array
    """(n, 2) [px]."""
    offs: Array
    """(n, 2) from the expected places [px]."""
    covariances: Array
    """(n, 2, 2) of these, without the mount's [px²]."""
    by_mount: Array
    """(n, 2, 6)."""
    agreements: Array
    """(n,)."""

    @staticmethod
    def of(candidates: Sequence[Candidate]) -> "_Candidates":
        points = [each.point for each in candidates]
        return _Candidates(
            np.array([point.target for point in points]),
            np.array([point.image_px for point in points]),
            np.array([point.image_px - point.expected_px for point in points]),
            np.array([each.own_covariance_px2 + each.point.covariance_px2 for each in candidates]),
            np.array([each.by_mount for each in candidates]),
            np.array([point.agreement for point in points]),
        )

    def unexplained(self, chosen: Sequence[int]) -> float:
        """Give the mean share of the brightness that the targets of a set leave unexplained."""
        return float(np.mean(1.0 - self.agreements[list(chosen)])) if chosen else 1.0

    def grown(self, start: int, mount_covariance: Matrix6) -> list[int]:
        """Grow a set from one candidate; empty where that one is impossible itself."""
        limit = float(chi2_isf(OUTSIDE_SIGNIFICANCE, 2))
        error, covariance = np.zeros(6), mount_covariance
        chosen: list[int] = []
        open_ones = np.ones(len(self.targets), dtype=bool)
        while np.any(open_ones):
            statistics, spread = self._statistics(error, covariance)
            k = start if not chosen else int(np.argmin(np.where(open_ones, statistics, np.inf)))
            if statistics[k] > limit:
                break
            chosen.append(k)
            open_ones &= self.targets != self.targets[k]
            gain = covariance @ np.linalg.solve(spread[k], self.by_mount[k]).T
            error = error + gain @ (self.offs[k] - self.by_mount[k] @ error)
            rest = np.eye(6) - gain @ self.by_mount[k]
            covariance = rest @ covariance @ rest.T + gain @ self.covariances[k] @ gain.T
        return chosen

    def _statistics(self, error: Array, covariance: Matrix6) -> tuple[Scalars, Array]:
        """Give the squared distances (n,) from the expected places in standard deviations, and their covariances."""
        spread = self.by_mount @ covariance @ np.swapaxes(self.by_mount, 1, 2) + self.covariances
        off = self.offs - self.by_mount @ error
        return np.einsum("ni,ni->n", off, np.linalg.solve(spread, off[..., None])[..., 0]), spread
