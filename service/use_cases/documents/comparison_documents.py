"""Registered stations beside their reference poses, the dissertation's table 4.2."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.geometry.angles import GON_PER_RAD
from algorithms.geometry.pose_parameters import pose_parameters, pose_with_parameter_std
from algorithms.geometry.poses import PoseEstimate
from algorithms.quality.comparison import PoseComparison, compare_poses
from schemas.results.comparison import ComparedParameter, JointTest, StationComparison
from service.use_cases.documents.pose_documents import PARAMETERS

ALPHA = 0.05
"""Level of the tests of differences: confidence level 95 %."""
UNITS = np.array([GON_PER_RAD, GON_PER_RAD, GON_PER_RAD, 1.0, 1.0, 1.0])


def comparison_documents(
    fixed: str, estimates: Mapping[str, PoseEstimate], reference: Mapping[str, Any]
) -> tuple[list[ComparedParameter], list[StationComparison]]:
    """Compare stations with their reference poses.

    The reference is first moved so that the fixed station agrees, when it is among the reference poses.

    Parameters
    ----------
    fixed
        Name of the station that defines the common frame.
    estimates
        Poses of the other registered stations in the common frame.
    reference
        Reference poses as in the request, by name.
    """
    known = {name: reference_pose(request) for name, request in reference.items()}
    rows: list[ComparedParameter] = []
    summaries: list[StationComparison] = []
    for name, estimate in estimates.items():
        if name not in known:
            continue
        wanted = known[fixed].inverse().after(known[name]) if fixed in known else known[name]
        comparison = compare_poses(estimate, wanted, ALPHA)
        rows += _rows(name, comparison, estimate, wanted)
        summaries.append(_summary(name, comparison))
    return rows, summaries


def reference_pose(request: Any) -> PoseEstimate:
    """Read a reference pose of a request: a matrix, or matrix and accuracy."""
    if isinstance(request, list):
        request = {"matrix": request}
    pose = RigidTransform.from_matrix(np.array(request["matrix"], dtype=np.float64))
    if request.get("covariance") is not None:
        return PoseEstimate(pose, np.array(request["covariance"], dtype=np.float64))
    std = request.get("std")
    return pose_with_parameter_std(pose, np.zeros(6) if std is None else np.array([std[n] for n in PARAMETERS]) / UNITS)


def _rows(
    name: str, comparison: PoseComparison, estimate: PoseEstimate, reference: PoseEstimate
) -> Sequence[ComparedParameter]:
    own, theirs = (pose_parameters(pose) for pose in (estimate, reference))
    return [
        ComparedParameter(
            station=name,
            parameter=PARAMETERS[k],
            estimated=row.estimated * UNITS[k],
            reference=row.reference * UNITS[k],
            difference=row.difference * UNITS[k],
            std=float(np.sqrt(own.covariance[k, k])) * UNITS[k] if own.determined[k] else None,
            reference_std=float(np.sqrt(theirs.covariance[k, k])) * UNITS[k] if theirs.covariance[k, k] > 0.0 else None,
            difference_std=None if row.std is None else row.std * UNITS[k],
            ratio=row.ratio,
            significant=row.significant,
        )
        for k, row in enumerate(comparison.parameters)
    ]


def _summary(name: str, comparison: PoseComparison) -> StationComparison:
    joint = comparison.joint
    return StationComparison(
        station=name,
        mean_difference_rotation_gon=comparison.mean_rotation_rad * GON_PER_RAD,
        mean_difference_translation_m=comparison.mean_translation_m,
        rotation_gon=comparison.rotation_rad * GON_PER_RAD,
        translation_m=comparison.translation_m,
        confidence_level=1.0 - comparison.alpha,
        limit=comparison.limit,
        joint_test=None
        if joint is None
        else JointTest(
            statistic=joint.statistic,
            degrees_of_freedom=joint.degrees_of_freedom,
            critical=joint.critical,
            p_value=joint.p_value,
            significant=joint.significant,
        ),
        verdict=_verdict(comparison),
    )


def _verdict(comparison: PoseComparison) -> str:
    if comparison.joint is None:
        return "without standard deviations nothing can be said about the differences"
    significant = [PARAMETERS[k] for k, row in enumerate(comparison.parameters) if row.significant]
    alone = f"; by themselves {', '.join(significant)} differ significantly" if significant else ""
    if comparison.joint.significant:
        return f"the poses differ by more than their standard deviations explain{alone}"
    return f"all parameters together differ by no more than their standard deviations explain{alone}"
