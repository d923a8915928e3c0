"""The history of removed and reinstated correspondences, in words a surveyor can check in the field (MATH 4.5)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.gross_errors import Partner, Plane
from algorithms.adjustment.observations.line_line import LineLine
from algorithms.adjustment.observations.plane_plane import PlanePlane
from algorithms.adjustment.pair_problem import PairProblem
from algorithms.adjustment.reports import offsets_in_the_middle
from algorithms.adjustment.snooping import Change, SnoopingResult
from algorithms.arrays import Array, Matrix, Vector
from algorithms.geometry.angles import GON_PER_RAD
from algorithms.probabilities import chi2_isf

DIFFERENT_FEATURES_M = 0.3
"""Farther apart than this [m], and not parallel either, two features are called different ones rather than moved."""

SIDES = ("target", "source")
"""Names of stations 0 and 1."""


@dataclass(frozen=True)
class Removal:
    """One change of the set of used correspondences, with its reason."""

    step: int
    """Number of the decision, from 1; a plane goes in one with all that depends on it."""
    change: Change
    correspondence: int
    """Number of the correspondence: lines first, then planes, each in the order given."""
    kind: str
    """``line`` or ``plane``."""
    target_number: int
    source_number: int
    statistic: float
    """T at that step."""
    critical: float
    """Its limit."""
    inseparable_from: tuple[Partner, ...]
    """Correspondences that may be the wrong ones instead; empty for reinstated ones."""
    plane: Plane | None
    """Station (0 target, 1 source) and number of the plane with which it was rejected; None where it was by itself."""
    reason: str
    """In words."""


def removals_in_words(
    problem: PairProblem, observations: Sequence[LineLine | PlanePlane], result: SnoopingResult, alpha: float
) -> tuple[Removal, ...]:
    """Tell the history of removals and reinstatements (MATH 4.5).

    Parameters
    ----------
    problem
        All correspondences, reduced frames.
    observations
        The same, lines first.
    result
        Solution, tests and steps.
    alpha
        Level of the tests.
    """
    kinds = ["line" if isinstance(part, LineLine) else "plane" for part in observations for _ in range(len(part))]
    numbers = np.vstack([part.pairs for part in observations])
    misfits = _misfits(problem, result.solution.pose, result.variance_factor, alpha)
    removals = []
    for step in result.steps:
        kind, (target, source) = kinds[step.block], (int(number) for number in numbers[step.block])
        reason = f"the two {kind}s fit after all, now that other wrong pairs are out: used again"
        if step.change is Change.REMOVED:
            named = [_pair_name(kinds[partner.block], numbers[partner.block]) for partner in step.inseparable_from]
            reason = _why_removed(misfits[step.block].in_words(kind), kind, step.plane, named)
        removals.append(
            Removal(
                step.step,
                step.change,
                step.block,
                kind,
                target,
                source,
                step.statistic,
                step.critical,
                step.inseparable_from,
                step.plane,
                reason,
            )
        )
    return tuple(removals)


def _why_removed(misfit: str, kind: str, plane: Plane | None, partners: Sequence[str]) -> str:
    reason = misfit
    if plane is not None:
        belongs = "is" if kind == "plane" else "depends on"
        reason = (
            f"{belongs} plane P{plane[1] + 1} of the {SIDES[plane[0]]}, which was moved between the scans with "
            f"everything that depends on it (a door, a cupboard), or is another plane: {misfit}"
        )
    if partners:
        reason += (
            f". The data cannot tell whether this pair or {' or '.join(partners)} is the wrong one: check both, or add "
            "a feature that controls them"
        )
    return reason


@dataclass(frozen=True)
class _Misfit:
    """How two features differ in the final pose, and how unlikely that is for one and the same feature."""

    angle_gon: float
    distance_mm: float
    angle_in_limits: float
    """Angle over what the standard deviations of both scans allow."""
    distance_in_limits: float

    def in_words(self, kind: str) -> str:
        """Say whether the feature was moved, turned, or is another one."""
        apart, turned = f"{self.distance_mm:.1f} mm apart", f"{self.angle_gon:.3f} gon"
        times = f"{max(self.distance_in_limits, self.angle_in_limits):.1f} times what the scans' accuracy allows"
        if self.distance_in_limits > 1.0 and self.angle_in_limits > 1.0:
            if self.distance_mm > 1e3 * DIFFERENT_FEATURES_M:
                return (
                    f"wrong correspondence: the two {kind}s are {apart} and differ in direction by {turned} ({times})"
                )
            return (
                f"moved and turned between the scans, or a wrong correspondence: the two {kind}s are {apart} and "
                f"differ in direction by {turned} ({times})"
            )
        if self.distance_in_limits > 1.0:
            return (
                f"moved between the scans, or a wrong correspondence with a parallel {kind}: direction agrees "
                f"({turned}), but the two {kind}s are {apart} ({times})"
            )
        if self.angle_in_limits > 1.0:
            return (
                f"turned between the scans (a door or flap), or a wrong correspondence: the two {kind}s differ in "
                f"direction by {turned} ({times}); they are {apart}"
            )
        return (
            f"the two {kind}s are {apart} and differ in direction by {turned}, each hardly too much by itself, but "
            "together more than the scans' accuracy and the other pairs allow"
        )


def _misfits(problem: PairProblem, pose: RigidTransform, variance_factor: float, alpha: float) -> list[_Misfit]:
    """Compare all features in one pose with the covariances of both scans; tilts come first in each block."""
    system = problem.at(pose)
    misfits = []
    parts = zip(problem.observations, system.split(system.residuals), system.covariances, strict=True)
    for observation, residuals, covariances in parts:
        tilts, offsets = residuals[:, :2], residuals[:, 2:]
        by_tilt, rest = covariances[:, :2, :2], covariances[:, 2:, 2:]
        if isinstance(observation, LineLine):
            offsets, rest, _ = offsets_in_the_middle(observation, residuals, covariances, pose)
        shares = [
            np.sqrt(_form(part, covariance) / variance_factor / chi2_isf(alpha, part.shape[1]))
            for part, covariance in ((tilts, by_tilt), (offsets, rest))
        ]
        angles = np.arctan(np.linalg.norm(tilts, axis=1)) * GON_PER_RAD
        distances = np.linalg.norm(offsets, axis=1) * 1e3
        misfits += [_Misfit(*map(float, row)) for row in zip(angles, distances, *shares, strict=True)]
    return misfits


def _form(vectors: Matrix, covariances: Array) -> Vector:
    return np.asarray(np.einsum("ni,nij,nj->n", vectors, np.linalg.inv(covariances), vectors))


def _pair_name(kind: str, numbers: Array) -> str:
    letter = "L" if kind == "line" else "P"
    return f"{letter}{numbers[0] + 1} – {letter}{numbers[1] + 1}"
