"""What the parts of a verdict are made of: the search, doubts of lines and planes, what the reader should know."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.line_adjustment import LineAdjustment
from algorithms.adjustment.snooping import CorrespondenceState
from algorithms.adjustment.testing import GlobalVerdict
from algorithms.arrays import Points
from algorithms.errors import DegenerateGeometryError, TooFewCorrespondencesError, TooFewFeaturesError
from algorithms.features.mount_test import WHAT_TO_CHECK
from algorithms.features.photo_lines.photo_counts import photos_without_lines
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.lines import LineSource
from algorithms.geometry.poses import PoseEstimate
from algorithms.matching.coarse_registration import CoarseRegistration, match_features
from algorithms.matching.degeneracy import features_in_words
from algorithms.matching.directions import comes_first
from algorithms.matching.options import MatchingOptions
from algorithms.matching.polish import polished
from algorithms.matching.surface_fit import surface_pose_covariance, surface_pose_near
from algorithms.quality.acceptance import AcceptanceStatus, Verdict
from algorithms.registration.base import FineRegistration, PairResult, PairStatus, RegistrationProblem
from algorithms.registration.rigidity import Rigidity, rigidity
from algorithms.registration.rounding_covariance import remark_on_rounding

LEAST_REDUNDANCY = 10
"""Conditions beyond the six parameters without which no test means anything."""
SURFACE_SIGMAS, SURFACE_NOISES = 3.0, 2.0
"""So many standard deviations of the pose and of the noise may lines and planes differ from the surfaces."""
WORST_STD_M = 0.02
"""Where the worst determined motion has a larger standard deviation, the geometry does not carry the pose."""
OTHER_POSE_RAD, OTHER_POSE_M = np.radians(4.5), 0.3
"""Poses farther apart than this are clearly different ones, as for the runner-up of the search."""
POLISH_M, POLISH_POINTS = (0.6, 0.3, 0.15), 3000
"""From a proposed pose to one that the estimate may start from: largest distances of corresponding surface."""
MOST_SIGMA0 = 4.0
"""Residuals so many times what the noise explains are no unevenness of walls (up to 2): the model is wrong."""
LEAST_PHOTO_LINES = 10
"""Of so many lines of photos one at least should be found again in a station whose photos show the same."""
LEAST_USED_SHARE = 0.5
"""Below this share of agreeing correspondences the pose is doubtful."""


def searched(problem: RegistrationProblem, options: MatchingOptions) -> CoarseRegistration | PairResult:
    """Search for the pose without a first guess, or give the result that says why there is none.

    Parameters
    ----------
    problem
        Features of both scans.
    options
        Of the search.
    """
    try:
        return _from_choice(problem, match_features(problem.target, problem.source, options, priors=problem.priors))
    except DegenerateGeometryError as error:
        return replace(
            PairResult.without_pose(PairStatus.DEGENERATE, str(error)),
            free_directions=error.free_directions,
            advice=error.advice,
        )
    except TooFewFeaturesError as error:
        return replace(PairResult.without_pose(PairStatus.REJECTED, str(error)), advice=error.advice)
    except TooFewCorrespondencesError as error:
        found = [
            features_in_words(each, which) for each, which in ((problem.target, "target"), (problem.source, "source"))
        ]
        return PairResult.without_pose(
            PairStatus.REJECTED, f"no pose lays the scans on each other: {error} ({'; '.join(found)})"
        )


def _from_choice(problem: RegistrationProblem, search: CoarseRegistration) -> CoarseRegistration:
    """Go on from the pose that somebody chose, unless it is what the search found: laid surface on surface.

    The search's own pose stands as the rival of the chosen one then.
    """
    if problem.priors is None or problem.priors.chosen_by is None:
        return search
    chosen = problem.priors.target_from_source
    if chosen is None:
        return search
    found = search
    if not problem.priors.agree_with((search.target_from_source,))[0]:
        surfaces = problem.target.index, problem.source.index
        start = polished(chosen, *surfaces, distances_m=POLISH_M, points=POLISH_POINTS)
        found = beside(problem.source, search, start)
    return replace(found, remarks=(*found.remarks, f"{problem.priors.chosen_by} chose where the search starts"))


def rigidity_of(problem: RegistrationProblem, pose: PoseEstimate, verdict: Verdict) -> Rigidity | None:
    """Look for a deformation beside a pose between the reduced frames; None where the pose is rejected anyway."""
    if verdict.status is AcceptanceStatus.REJECTED:
        return None
    is_doubtful = verdict.status is not AcceptanceStatus.ACCEPTED
    return rigidity(problem.target, problem.source, pose.target_from_source, is_doubtful=is_doubtful)


def agreement_doubts(fine: FineRegistration) -> list[str]:
    """Say it where fewer than half of the corresponding lines and planes agree with each other."""
    reports = fine.adjustment.lines, fine.adjustment.planes
    used = sum(int(np.count_nonzero(report.states != CorrespondenceState.REMOVED)) for report in reports)
    all_ = expected_supporters(fine)
    if used >= LEAST_USED_SHARE * all_:
        return []
    return [f"only {used} of {all_} corresponding lines and planes agree with each other"]


def misfit_doubts(adjusted: Sequence[FineRegistration]) -> list[str]:
    """Say it where lines and planes do not fit in any of some adjustments, so that the model itself is wrong."""
    sigmas = [fine.adjustment.sigma0 for fine in adjusted if fine.adjustment.sigma0 is not None]
    if not sigmas or min(sigmas) <= MOST_SIGMA0:
        return []
    doubt = (
        f"corresponding lines and planes are {min(sigmas):.0f} times as far apart as the noise explains, and uneven "
        f"walls account for {MOST_SIGMA0:.0f} times at most: the scans differ by more than a motion, or much has moved"
    )
    return [doubt]


def allowed_m(problem: RegistrationProblem) -> float:
    """Give the largest standard deviation, and undetected error, that is allowed in an accepted pose [m].

    Two centimetres; or what single points are known to where they are noisier, for scans laid on each other then
    scatter no more than each does by itself; or half the distance of neighbouring points where they stand wide apart,
    for neither scan tells its surfaces' rims to better than that.

    Parameters
    ----------
    problem
        Features of both scans.
    """
    scans = problem.target, problem.source
    noise_m = max(scan.noise_std_m for scan in scans)
    return max(WORST_STD_M, noise_m, 0.5 * max(scan.spacing_m for scan in scans))


def largest_hidden_shift_m(adjustment: LineAdjustment) -> float:
    """Give the largest shift of the pose, at the features' centroid, by an error that just stays undetected [m].

    Each component of a line or plane by itself: an error in a direction between two components may hide better.
    """
    return float(np.linalg.norm(adjustment.undetected[:, 3:], axis=1).max(initial=0.0))


def contradictions(problem: RegistrationProblem, coarse: CoarseRegistration, fine: FineRegistration) -> tuple[str, ...]:
    """Compare with the pose in which all surfaces fit best: it rests on other data than the planes that were matched.

    Compared is where the matched features come to lie. The surfaces' pose is known by itself to about the noise of
    single points, and worse along what only few of them tell.

    Parameters
    ----------
    problem
        Features of both scans.
    coarse
        The search, whose pose is that of the surfaces.
    fine
        Adjusted lines and planes, in a method that does not estimate by surfaces.

    Returns
    -------
    What it says against the pose, in words with figures; nothing where they agree.
    """
    pose = fine.adjustment.pose_a_posteriori
    found = _misfit(problem, fine, coarse.target_from_source)
    if found is not None:
        own = pose.target_from_source
        found = _misfit(
            problem, fine, surface_pose_near(problem.target, problem.source, own, coarse.target_from_source)
        )
    if found is None:
        return ()
    shift, std = found
    doubt = (
        f"lines and planes shift the scan by up to {shift * 1e3:.0f} mm from the best fit of the surfaces, more than "
        f"the standard deviation of {std * 1e3:.0f} mm there explains, or than the {allowed_m(problem) * 1e3:.0f} mm "
        "that are asked of a pose"
    )
    return (doubt,)


def _misfit(
    problem: RegistrationProblem, fine: FineRegistration, surface_pose: RigidTransform
) -> tuple[float, float] | None:
    """Give the worst shift [m] of a used feature from where the surfaces have it, and its standard deviation [m].

    None where all are within what standard deviations and noise allow, and within what is asked of a pose: large
    standard deviations are no agreement.
    """
    pose = fine.adjustment.pose_a_posteriori
    points = _used_features(problem, fine)
    shifts = surface_pose.apply(pose.target_from_source.inv().apply(points)) - points
    surfaces = PoseEstimate(surface_pose, surface_pose_covariance(problem.target, problem.source, surface_pose))
    covariances = np.array([pose.position_covariance_m2(p) + surfaces.position_covariance_m2(p) for p in points])
    # along the axes of each covariance, which turn with the frame
    variances, axes = np.linalg.eigh(covariances)
    stds = np.sqrt(np.maximum(variances, 0.0))
    along = np.abs(np.einsum("nij,ni->nj", axes, shifts))
    allowance = SURFACE_NOISES * max(problem.target.noise_std_m, problem.source.noise_std_m)
    excess = (along - (SURFACE_SIGMAS * stds + allowance)).max(axis=1)
    worst = int(np.argmax(excess))
    if excess[worst] <= 0.0:
        worst = int(np.argmax(np.linalg.norm(shifts, axis=1)))
        if np.linalg.norm(shifts[worst]) <= allowed_m(problem):
            return None
    return float(np.linalg.norm(shifts[worst])), float(np.linalg.norm(stds[worst]))


def _used_features(problem: RegistrationProblem, fine: FineRegistration) -> Points:
    """Give the places of the used lines and planes of the scan that comes first, in the target's frame."""
    first = comes_first(problem.target, problem.source)
    side, features = (0, problem.target) if first else (1, problem.source)
    lines, planes = (
        pairs[report.states != CorrespondenceState.REMOVED, side]
        for pairs, report in ((fine.lines, fine.adjustment.lines), (fine.planes, fine.adjustment.planes))
    )
    points = np.vstack([features.lines.anchors[lines], features.planes.centroids[planes]])
    return points if first else fine.adjustment.pose.target_from_source.apply(points)


def remarks_on(problem: RegistrationProblem, fine: FineRegistration | None) -> list[str]:
    """Say what the reader of a pose should know of its features.

    Parameters
    ----------
    problem
        Features of both scans: which station's photos do not fit its own scan.
    fine
        The lines and planes in the pose: larger residuals than the noise explains, wrong mounts; None: there are none.
    """
    remarks = []
    for features, side in ((problem.target, "target"), (problem.source, "source")):
        words = None if features.mount_test is None else features.mount_test.in_words()
        if words is not None:
            remarks.append(f"{side}: {words}")
        rounded = remark_on_rounding(features)
        if rounded is not None:
            remarks.append(f"{side}: {rounded}")
        remarks += [f"{side}: {text}" for text in photos_without_lines(features)]
    if fine is None:
        return remarks
    remarks += _photos_not_found_again(problem, fine)
    adjustment = fine.adjustment
    if adjustment.sigma0 is not None and adjustment.global_test.verdict is GlobalVerdict.TOO_LARGE:
        remarks.append(
            f"the residuals are {adjustment.sigma0:.1f} times what the scans' own noise explains (uneven surfaces, or "
            "objects that moved); the standard deviations are enlarged accordingly"
        )
    return remarks + [mount.in_words() for mount in adjustment.mount_errors]


def _photos_not_found_again(problem: RegistrationProblem, fine: FineRegistration) -> list[str]:
    """Name the stations of whose photos' lines the other station shows none."""
    remarks = []
    sides = ((problem.target, problem.source, "target"), (problem.source, problem.target, "source"))
    for column, (features, other, side) in enumerate(sides):
        # what lies at a mount that is wrong lies nowhere in the other station, whose own photos may show the same edge
        of_photos = np.flatnonzero(features.lines.sources == int(LineSource.PHOTO_EDGE))
        found = np.intersect1d(of_photos, fine.lines[:, column])
        if len(of_photos) >= LEAST_PHOTO_LINES and len(found) == 0 and _shows_photo_lines(other):
            remarks.append(
                f"{side}: of {len(of_photos)} lines of the photos none was found again in the other station: "
                f"{WHAT_TO_CHECK}"
            )
    return remarks


def _shows_photo_lines(features: ScanFeatures) -> bool:
    """Say whether a station has lines of photos, which alone show the edges that photos of another show."""
    return bool(np.any(features.lines.sources == int(LineSource.PHOTO_EDGE)))


def expected_supporters(fine: FineRegistration) -> int:
    """Count the lines and planes that should fit: all but the doubted ones."""
    return len(fine.lines) + len(fine.planes) - fine.adjustment.doubted_count


def beside(source: ScanFeatures, search: CoarseRegistration, start: RigidTransform) -> CoarseRegistration:
    """Take a pose instead of the search's own, which becomes its rival where it is clearly different.

    Parameters
    ----------
    source
        Features of the source scan.
    search
        The search's answer.
    start
        The pose, between the reduced frames.
    """
    if not _clearly_different(source, start, search.target_from_source):
        return replace(search, target_from_source=start)
    return replace(
        search,
        target_from_source=start,
        support=0,
        runner_up=search.target_from_source,
        runner_up_score=search.score,
        runner_up_support=search.support,
        lone_spotless=False,
    )


def _clearly_different(source: ScanFeatures, first: RigidTransform, second: RigidTransform) -> bool:
    """Say whether two poses are another one, by how they turn the source and where they put its middle."""
    centre = source.surface.points.mean(axis=0)
    turned = (first.rotation * second.rotation.inv()).magnitude() > OTHER_POSE_RAD
    return bool(turned or np.linalg.norm(first.apply(centre) - second.apply(centre)) > OTHER_POSE_M)
