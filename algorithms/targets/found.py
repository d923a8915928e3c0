"""Targets that were found, and candidates that were not taken for one."""

from dataclasses import dataclass

from algorithms.arrays import Matrix3, Vector3
from algorithms.targets.options import TargetKind


@dataclass(frozen=True, eq=False)
class FoundTarget:
    """A target's centre and how well it is known."""

    kind: TargetKind
    centre_m: Vector3
    """(3,) in the scan's reduced frame [m]."""
    covariance_m2: Matrix3
    """(3, 3) of the centre [m²]."""
    points: int
    """Measurements that it rests on."""
    incidence_rad: float
    """Angle between the beam and the target's normal; 0 for spheres and cylinders."""
    rms: float
    """Root mean square of the residuals: metres of spheres, share of the contrast of what is seen in the intensity."""
    coverage: float
    """Share of the target's visible surface that holds measurements, 0..1."""
    contrast: float
    """(bright - dark) / (bright + dark) of the intensities; 0 for spheres."""
    score: float
    """How much speaks for it, 0..1: the smaller of coverage and agreement with the template."""


@dataclass(frozen=True, eq=False)
class RejectedCandidate:
    """Something that looked like a target at first."""

    kind: TargetKind
    centre_m: Vector3
    """(3,) where, in the scan's reduced frame [m]."""
    reason: str
    """Why it is none, in words with figures."""


Candidate = FoundTarget | RejectedCandidate


def distinct(candidates: list[Candidate], apart_m: float) -> tuple[list[FoundTarget], list[RejectedCandidate]]:
    """Keep one candidate of those that are nearer to each other than `apart_m`: found ones first, the best of them."""
    kept: list[Candidate] = []

    def rank(candidate: Candidate) -> float:
        return -candidate.score if isinstance(candidate, FoundTarget) else 1.0

    for candidate in sorted(candidates, key=rank):
        if all(float(((candidate.centre_m - other.centre_m) ** 2).sum()) > apart_m**2 for other in kept):
            kept.append(candidate)
    found = [candidate for candidate in kept if isinstance(candidate, FoundTarget)]
    return found, [candidate for candidate in kept if isinstance(candidate, RejectedCandidate)]
