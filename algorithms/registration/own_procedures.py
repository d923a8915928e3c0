"""The parts of a registration with an estimator of its own: correspondences, its estimate, the rigorous one."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.line_adjustment import LineAdjustment, adjust_lines
from algorithms.adjustment.line_estimate import LineEstimate
from algorithms.adjustment.options import AdjustmentOptions
from algorithms.adjustment.residual_covariance import SharedErrors
from algorithms.adjustment.snooping import CorrespondenceState
from algorithms.arrays import Array, IndexPairs, OtherIndexPairs, Vector3
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.line_motion import lines_about
from algorithms.geometry.lines import Lines
from algorithms.geometry.poses import PoseEstimate
from algorithms.matching.coarse_registration import CoarseRegistration
from algorithms.matching.directions import comes_first
from algorithms.matching.options import MatchingOptions
from algorithms.registration.base import RegistrationProblem


@runtime_checkable
class Estimator(Protocol):
    """Estimates a pose from matched lines, such as `adjust_plucker`."""

    def __call__(
        self,
        target: Lines,
        source: Lines,
        pairs: IndexPairs,
        start: RigidTransform,
        shared: SharedErrors,
    ) -> LineEstimate:
        """Give the pose with its true and its claimed covariance."""
        ...


@dataclass(frozen=True, eq=False)
class Proposal:
    """Which lines belong together, and a pose near the answer."""

    lines: IndexPairs
    """(n, 2) target and source lines."""
    start: RigidTransform
    """Target from source between the reduced frames."""
    remarks: tuple[str, ...] = ()
    """How they were found, in words."""
    settled: bool = True
    """Whether the correspondences stayed the same at last."""


@dataclass(frozen=True, eq=False)
class OwnProcedure:
    """What one method does its own way."""

    label: str
    """Its estimator in words."""
    matching: MatchingOptions
    """The search that the result is verified against."""
    adjustment: AdjustmentOptions
    """The rigorous adjustment beside it."""
    propose: Callable[[RegistrationProblem, CoarseRegistration], Proposal]
    """Finds the correspondences; is given the search's answer, which it may use as a start."""
    estimate: Estimator
    keeps_all: bool = False
    """Use also the lines that the rigorous tests remove: for a method that has a test of its own."""


def rigorously_adjusted(
    problem: RegistrationProblem, lines: IndexPairs, start: RigidTransform, options: AdjustmentOptions
) -> LineAdjustment:
    """Adjust the correspondences rigorously, lines only, correlated through the planes that they share."""
    return adjust_lines(
        problem.target.lines,
        problem.source.lines,
        lines,
        start,
        target_plane_covariances=problem.target.planes.covariances,
        source_plane_covariances=problem.source.planes.covariances,
        target_photo_covariances=problem.target.photo_covariances,
        source_photo_covariances=problem.source.photo_covariances,
        from_source=not comes_first(problem.target, problem.source),
        options=options,
    )


def kept_lines(lines: IndexPairs, adjustment: LineAdjustment) -> OtherIndexPairs:
    """Give the correspondences that the rigorous tests leave."""
    return np.asarray(lines[adjustment.lines.states != int(CorrespondenceState.REMOVED)])


def estimated(
    problem: RegistrationProblem, estimate: Estimator, lines: IndexPairs, start: RigidTransform
) -> LineEstimate:
    """Estimate the pose between the reduced frames, with the frames' origins moved to the instruments for it.

    Some estimators depend on where the origin lies: this is where the dissertation has it, and near the lines in every
    case. Without a known instrument the middle of the scan's lines is taken.

    Raises
    ------
    TooFewCorrespondencesError
        Below what the estimator needs.
    DegenerateGeometryError
        When its normal matrix is singular.
    """
    target, source = problem.target, problem.source
    origins = _origin(target), _origin(source)
    near = PoseEstimate(start, np.zeros((6, 6))).moved_to_origins(-origins[0], -origins[1])
    result = estimate(
        lines_about(target.lines, origins[0]),
        lines_about(source.lines, origins[1]),
        lines,
        near.target_from_source,
        SharedErrors(
            target.planes.covariances, source.planes.covariances, target.photo_covariances, source.photo_covariances
        ),
    )
    return replace(
        result, pose=result.pose.moved_to_origins(*origins), claimed=result.claimed.moved_to_origins(*origins)
    )


def pose_difference(first: RigidTransform, second: RigidTransform) -> Array:
    """Give (rotation vector on the left, translation) that lead from the first pose to the second, (6,)."""
    turn = (second.rotation * first.rotation.inv()).as_rotvec()
    return np.concatenate([turn, np.asarray(second.translation) - np.asarray(first.translation)])


def _origin(features: ScanFeatures) -> Vector3:
    if features.sensor_m is not None:
        return features.sensor_m
    return np.asarray(features.lines.anchors.mean(axis=0))
