"""Targets that were found, and candidates that were not taken for one."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

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
    size_m: float
    """Diameter of a sphere, side of a board or square, diameter and height of a cylinder [m]."""
    normal: Vector3 | None = None
    """(3,) unit normal of a flat target towards the instrument; None where too few points tell it."""
    range_misfit_m: float = 0.0
    """Median difference of the ranges of a retro-reflective target's pixels from its surface [m]."""
    alternative: TargetKind | None = None
    """What the same place was found as too, but less well."""


@dataclass(frozen=True, eq=False)
class RejectedCandidate:
    """Something that looked like a target at first."""

    kind: TargetKind
    centre_m: Vector3
    """(3,) where, in the scan's reduced frame [m]."""
    reason: str
    """Why it is none, in words with figures."""


Candidate = FoundTarget | RejectedCandidate
RETRO = frozenset({TargetKind.RETRO_SQUARE, TargetKind.RETRO_CYLINDER})
CLEARLY = 0.8
"""A surface whose ranges are missed by less than so much of what another misses them by is the better one."""


def one_of_both(found: Sequence[FoundTarget]) -> list[FoundTarget]:
    """Report a bright spot that was found as a square and as a cylinder once, as what its ranges show or, where these
    do not tell, its intensities.
    """
    kept: list[FoundTarget] = []
    for each in found:
        same = next((k for k, other in enumerate(kept) if _is_same_spot(each, other)), None)
        if same is None:
            kept.append(each)
            continue
        better, other = (each, kept[same]) if _is_better(each, kept[same]) else (kept[same], each)
        alternative = better.alternative if better.kind is other.kind else other.kind
        kept[same] = replace(better, alternative=alternative)
    return kept


def _is_same_spot(one: FoundTarget, other: FoundTarget) -> bool:
    apart = float(np.linalg.norm(one.centre_m - other.centre_m))
    return {one.kind, other.kind} <= RETRO and apart < 0.75 * max(one.size_m, other.size_m)


def _is_better(one: FoundTarget, other: FoundTarget) -> bool:
    low, high = sorted((one.range_misfit_m, other.range_misfit_m))
    return one.range_misfit_m == low if low < CLEARLY * high else one.rms < other.rms


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
