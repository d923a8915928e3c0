"""What is known of the scans of a pair and bears on its result: guessed positions, points left out, units, copies."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from algorithms.features.scan_features import ScanFeatures
from algorithms.quality.same_points import SAME_SHARE, shared_points
from service.ports import Json, StepContext
from service.use_cases.steps.run_features import read_stored_scan, station_warnings

if TYPE_CHECKING:
    from algorithms.registration.base import PairResult, RegistrationProblem

OVERLAP_OF_COPIES = 0.8
"""Scans of which less lies on the other are not asked whether they are one: a copy, or a part of one, lies on it as a
whole."""
BESIDE_M, SIGMAS = 0.1, 3.0
"""Nor are those whose instruments stand farther apart [m], and by so many standard deviations of guessed positions."""
REACH_SPACINGS, LEAST_REACH_M = 4.0, 0.01
"""Points are looked for within so many spacings, and within this distance [m]."""


def remarks_on_scans(problem: "RegistrationProblem", *, target: str, source: str) -> list[str]:
    """Say what the reader of a pair's result should know of its scans.

    Parameters
    ----------
    problem
        Features of both scans.
    target, source
        Names of the stations.
    """
    from algorithms.matching.unit_ratio import unit_ratio_in_words

    sides = ((target, problem.target), (source, problem.source))
    guessed = [words for name, features in sides if (words := _guessed(name, features)) is not None]
    warnings = [f"{name}: {warning}" for name, features in sides for warning in station_warnings(features)]
    ratio = unit_ratio_in_words(problem.target, problem.source, target_name=target, source_name=source)
    return [*guessed, *warnings, *([] if ratio is None else [ratio])]


def _guessed(name: str, features: ScanFeatures) -> str | None:
    """Say that the position of an instrument was guessed, and how well; None where the file states it."""
    if features.sensor_m is None:
        return f"the position of the instrument of {name} is not known: its file does not state it, and none was found"
    if features.sensor_std_m is None:
        return None
    is_origin = bool(np.allclose(features.sensor_m, -features.origin_m, atol=1e-9))
    what = "taken to be the origin of its coordinates" if is_origin else "guessed from its points"
    return (
        f"the position of the instrument of {name} was {what}, which tell it to about {features.sensor_std_m:.1g} m: "
        "what is said of free space rests on it"
    )


def distrusted_if_copied(
    context: StepContext, arguments: Json, result: "PairResult", problem: "RegistrationProblem"
) -> "PairResult":
    """Make a pose doubtful that lays a scan on itself, whole, thinned, cut or moved: it is no measurement of anything.

    The points are read again only where all of one scan lies on the other, and both instruments stand in one place.
    """
    from algorithms.registration.base import PairStatus

    found = result.final or result.fine
    simulated = arguments["target"]["scan"] is None
    if found is None or simulated or not _may_be_copies(result, problem):
        return result
    pose = found.pose.target_from_source
    target, source = (
        read_stored_scan(context, scan) for scan in (arguments["target"]["scan"], arguments["source"]["scan"])
    )
    points = target.points + target.origin_m, source.points + source.origin_m
    spacing = max(problem.target.spacing_m, problem.source.spacing_m)
    reach = max(REACH_SPACINGS * spacing, LEAST_REACH_M)
    share = (
        shared_points(points[1], points[0], pose, reach)
        if len(source) <= len(target)
        else shared_points(points[0], points[1], pose.inv(), reach)
    )
    if share < SAME_SHARE:
        return result
    reason = (
        f"the two scans are the same measurement: {share:.0%} of the points tried are found in both, but for a motion; "
        "so the pose says how well a scan fits itself, and nothing of where an instrument stood"
    )
    status = PairStatus.DOUBTFUL if result.status.in_place else result.status
    return replace(result, status=status, reasons=(reason, *result.reasons))


def _may_be_copies(result: "PairResult", problem: "RegistrationProblem") -> bool:
    """Say whether it is worth while to look at the points."""
    verification = result.verification
    if verification is not None and verification.overlap_decimetre < OVERLAP_OF_COPIES:
        return False
    target, source = problem.target, problem.source
    if target.sensor_m is None or source.sensor_m is None:
        return True
    found = result.final or result.fine
    if found is None:
        return False
    moved = found.pose.target_from_source.apply(source.sensor_m + source.origin_m)
    apart = float(np.linalg.norm(moved - target.sensor_m - target.origin_m))
    return apart <= BESIDE_M + SIGMAS * float(np.hypot(target.sensor_std_m or 0.0, source.sensor_std_m or 0.0))
