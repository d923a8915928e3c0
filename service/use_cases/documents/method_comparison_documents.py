"""Several methods on the same pairs of stations, as clients read them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Vector3
from algorithms.geometry.angles import GON_PER_RAD
from algorithms.geometry.poses import PoseEstimate
from algorithms.quality.comparison import compare_poses
from schemas.results.method_comparison import ComparedPair, MethodComparison, MethodMarks, MethodMatrix, PoseDifference
from schemas.results.registration_result import Pair
from schemas.values.poses import Pose
from service.names.pair_statuses import IN_PLACE
from service.use_cases.documents.comparison_documents import ALPHA, reference_pose

NEAR_GON, NEAR_M = 1.0, 0.3
"""Poses nearer to each other than this are the same answer, roughly: what Dold, Ripperda and Brenner (2007) count as
success of the weakest of their methods (0.8 degrees, 30 cm)."""
REFERENCE = "the reference"
FREE_OF_ERROR = PoseEstimate(RigidTransform.identity(), np.zeros((6, 6)))


@dataclass(frozen=True)
class MethodOnPair:
    """What one method made of a pair, and what it cost."""

    method: str
    pair: Pair
    seconds: float
    peak_memory_bytes: int | None
    centre_m: tuple[float, float, float]
    """Middle of the source's surface in the coordinates of its file."""


def method_comparison(
    own: Sequence[MethodOnPair], others: Sequence[MethodOnPair], fixed: str, reference: Mapping[str, Any] | None
) -> MethodComparison:
    """Lay the methods side by side, pair by pair.

    Parameters
    ----------
    own
        Every pair as the job's own method registered it.
    others
        The same pairs by other methods.
    fixed
        Name of the station that defines the common frame; where it is not among the reference poses, these are in its
        frame.
    reference
        Reference poses as in the request, by name; None: there are none.
    """
    known = {fixed: FREE_OF_ERROR} | {name: reference_pose(request) for name, request in (reference or {}).items()}
    rows = []
    for first in own:
        same_pair = [each for each in others if _names(each.pair) == _names(first.pair)]
        rows += [_row(each, first, known) for each in (first, *same_pair)]
    methods = list(dict.fromkeys([*(each.method for each in own), *(each.method for each in others)]))
    marks = {(row.method, row.target, row.source): row.mark for row in rows}
    pairs = [_names(each.pair) for each in own]
    matrix = MethodMatrix(
        pairs=pairs,
        methods=[
            MethodMarks(method=method, marks=[marks.get((method, *names), "") for names in pairs]) for method in methods
        ],
        near_gon=NEAR_GON,
        near_m=NEAR_M,
    )
    return MethodComparison(rows=rows, matrix=matrix)


def _row(each: MethodOnPair, first: MethodOnPair, known: Mapping[str, PoseEstimate]) -> ComparedPair:
    pair, figures = each.pair, each.pair.own_figures
    centre = np.array(each.centre_m)
    answer = estimate_of(pair.target_from_source)
    own = None if figures is None else estimate_of(figures.claimed)
    wanted = _known_motion(pair, known)
    if figures is not None:
        rigorous, what = estimate_of(figures.rigorous), "the rigorous pose from there on"
    else:
        other = None if each is first else first.pair.target_from_source
        rigorous, what = estimate_of(other), f"the answer of {first.method}"
    to_reference = _difference(answer, wanted, REFERENCE, centre)
    own_to_reference = _difference(own, wanted, REFERENCE, centre)
    to_rigorous = _difference(own if figures is not None else answer, rigorous, what, centre)
    return ComparedPair(
        target=pair.target,
        source=pair.source,
        method=each.method,
        status=pair.status,
        mark=_mark(pair.status, to_reference, own_to_reference or to_reference, _to_accepted(each, first)),
        reason=pair.reasons[0] if pair.reasons else "",
        pose=pair.target_from_source,
        own_figures=figures,
        difference_to_reference=to_reference,
        own_difference_to_reference=own_to_reference,
        difference_to_rigorous=to_rigorous,
        overlap_0_5m=None if pair.overlap is None else pair.overlap.fraction_0_5m,
        overlap_0_1m=None if pair.overlap is None else pair.overlap.fraction_0_1m,
        seconds=each.seconds,
        peak_memory_bytes=each.peak_memory_bytes,
    )


def _mark(
    status: str,
    answer: PoseDifference | None,
    own: PoseDifference | None,
    to_accepted: PoseDifference | None,
) -> str:
    """Tell success from failure, by the verdict first, then by what is known of the truth."""
    if status in IN_PLACE:
        return "accepted" if answer is None or _near(answer) else "wrong"
    found = own if own is not None else to_accepted
    return "found" if found is not None and _near(found) else "failed"


def _to_accepted(each: MethodOnPair, first: MethodOnPair) -> PoseDifference | None:
    """Compare the pose that a method finds itself with the one that the job's own method is accepted with."""
    if first.pair.status not in IN_PLACE:
        return None
    figures = each.pair.own_figures
    own = estimate_of(each.pair.target_from_source if figures is None else figures.claimed)
    return _difference(own, estimate_of(first.pair.target_from_source), first.method, np.array(each.centre_m))


def _near(difference: PoseDifference) -> bool:
    return difference.rotation_gon <= NEAR_GON and difference.shift_m <= NEAR_M


def _names(pair: Pair) -> tuple[str, str]:
    return pair.target, pair.source


def _known_motion(pair: Pair, known: Mapping[str, PoseEstimate]) -> PoseEstimate | None:
    if pair.target not in known or pair.source not in known:
        return None
    return known[pair.target].inverse().after(known[pair.source])


def estimate_of(pose: Pose | None) -> PoseEstimate | None:
    """Read a pose of a document with its covariance; None where something is not determined.

    Parameters
    ----------
    pose
        Of the document.
    """
    if pose is None or pose.covariance is None:
        return None
    return PoseEstimate(RigidTransform.from_matrix(np.array(pose.matrix)), np.array(pose.covariance))


def _difference(
    pose: PoseEstimate | None, other: PoseEstimate | None, what: str, centre_m: Vector3
) -> PoseDifference | None:
    """Compare two poses about the middle of the source, so that far coordinates take no part."""
    if pose is None or other is None:
        return None
    there = other.target_from_source.apply(centre_m)
    near, wanted = (each.moved_to_origins(-there, -centre_m) for each in (pose, other))
    compared = compare_poses(near, wanted, ALPHA)
    joint = compared.joint
    return PoseDifference(
        from_pose=what,
        rotation_gon=compared.rotation_rad * GON_PER_RAD,
        shift_m=compared.translation_m,
        statistic=None if joint is None else joint.statistic,
        degrees_of_freedom=None if joint is None else joint.degrees_of_freedom,
        critical=None if joint is None else joint.critical,
        significant=None if joint is None else joint.significant,
    )
