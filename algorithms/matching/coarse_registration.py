"""Find the pose of one scan in another without a first guess."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.errors import TooFewCorrespondencesError
from algorithms.features.scan_features import ScanFeatures
from algorithms.matching.correspondences import corresponding_lines, corresponding_planes
from algorithms.matching.degeneracy import require_determining_geometry
from algorithms.matching.hypotheses import RankedPoses, rank_hypotheses
from algorithms.matching.line_pairs import line_pair_motions
from algorithms.matching.options import MatchingOptions
from algorithms.matching.plane_triples import plane_motions
from algorithms.matching.votes import joined, vote_motions
from algorithms.progress import NoProgress, Progress
from algorithms.scans.surface_index import surface_index

VOTE_RADIUS_RAD = 0.07
MOST_ROTATIONS = 200
SUPPORT_ANGLE_RAD = 0.035
"""Lines and planes support a pose within 2 degrees and `SUPPORT_DISTANCE_M`."""
SUPPORT_DISTANCE_M = 0.15
LEAST_SUPPORT = 0.02
"""A pose on which less of the surface fits is no pose."""


@dataclass(frozen=True, eq=False)
class CoarseRegistration:
    """A pose found without a first guess, with what speaks for it and what else could be."""

    target_from_source: RigidTransform
    """Pose, source to target, both in their reduced frames [m]."""
    support: int
    """How many lines and planes both scans see in this pose."""
    score: float
    """Support share minus the penalty for violated free space; comparable between poses of one pair."""
    support_share: float
    """Mean of both scans' shares of surface that fits the other's, each a geometric mean over directions, 0..1."""
    violation_share: float
    """Mean of both scans' shares of surface that stands where the other looked through, 0..1."""
    overlap: float
    """Larger of both scans' shares that fit, 0..1."""
    runner_up: RigidTransform | None
    """The best clearly different pose (more than 5 gon or 0.3 m away); None if there is none."""
    runner_up_score: float
    """Its score; 0 if there is none."""
    runner_up_support: int
    """How many lines and planes both scans see there; 0 if there is none."""
    hypotheses_tested: int
    """How many poses were tried."""
    free_space_known: bool
    """Whether the instrument's position is known for both scans; else nothing was tested for violation on that side."""
    ambiguous: bool
    """Whether the runner-up is nearly as good."""
    reasons: tuple[str, ...]
    """What makes the answer doubtful, in words with figures; empty when nothing does."""


def match_features(
    target: ScanFeatures, source: ScanFeatures, options: MatchingOptions, *, progress: Progress | None = None
) -> CoarseRegistration:
    """Find the pose of the source scan in the target scan without a first guess.

    Pairs of lines that look alike vote for motions (Lichtenstein's solution, MATH 1.7 and 5.5), planes propose
    more, and every leading motion is tested: how much surface fits, and how much stands where the other instrument
    looked through. Deterministic.

    Parameters
    ----------
    target, source
        Features of the two scans.
    options
        Limits.
    progress
        Is told the steps.

    Raises
    ------
    DegenerateGeometryError
        When the lines and planes of a scan leave a freedom open (parallel pipes only, one plane only).
    TooFewCorrespondencesError
        When no motion lays anything on anything.
    """
    tell = NoProgress() if progress is None else progress
    for features, name in ((target, "target frame"), (source, "source frame")):
        require_determining_geometry(features, name)
    tell.report(0.0, "pairs of lines")
    motions = line_pair_motions(
        target, source, max_angle_rad=options.max_angle_rad, max_distance_m=options.max_distance_m
    )
    indices = [
        surface_index(f.surface.points, f.surface.normals, f.surface.voxel_size_m, f.sensor_m) for f in (target, source)
    ]
    if min(len(index.points) for index in indices) == 0:
        raise TooFewCorrespondencesError(0, 1, "surface points")
    voted = vote_motions(
        motions,
        indices[1].points.mean(axis=0),
        radius_rad=VOTE_RADIUS_RAD,
        radius_m=2.0 * options.max_distance_m,
        most_rotations=MOST_ROTATIONS,
        most=options.max_line_hypotheses,
    )
    tell.report(0.4, "planes")
    hypotheses = joined([voted, plane_motions(target, source, max_angle_rad=options.max_angle_rad)])
    if len(hypotheses) == 0:
        raise TooFewCorrespondencesError(0, 2, "pairs of lines or planes that look alike")
    tell.report(0.5, "testing hypotheses")
    ranked = rank_hypotheses(hypotheses, indices[0], indices[1], noise_m=max(target.noise_std_m, source.noise_std_m))
    if ranked.scores.support[0] < LEAST_SUPPORT:
        raise TooFewCorrespondencesError(0, 1, "surfaces")
    known = all(index.knows_free_space for index in indices)
    result = _described(target, source, ranked, options, free_space_known=known)
    tell.report(1.0, "pose found")
    return result


def _described(
    target: ScanFeatures, source: ScanFeatures, ranked: RankedPoses, options: MatchingOptions, *, free_space_known: bool
) -> CoarseRegistration:
    """Count the supporting features and compare the best pose with the runner-up."""
    pose, scores = ranked.poses[0], ranked.scores
    second = len(ranked.poses) > 1
    runner_up_score = float(scores.score[1]) if second else 0.0
    best = float(scores.score[0])
    ambiguous = second and runner_up_score > 0.0 and runner_up_score >= options.ambiguity_ratio * best
    reasons = []
    if ambiguous:
        turn = np.degrees((ranked.poses[1].rotation * pose.rotation.inv()).magnitude()) / 0.9
        centre = source.surface.points.mean(axis=0)
        shift = float(np.linalg.norm(ranked.poses[1].apply(centre) - pose.apply(centre)))
        reasons.append(
            f"another pose, turned by {turn:.1f} gon and shifted by {shift:.2f} m, scores {runner_up_score:.2f} "
            f"against {best:.2f}"
        )
    if not free_space_known:
        reasons.append("the position of an instrument is unknown, so free space was not tested on that side")
    return CoarseRegistration(
        target_from_source=pose,
        support=_supporters(target, source, pose),
        score=best,
        support_share=float(scores.support[0]),
        violation_share=float(scores.violation[0]),
        overlap=float(scores.overlap[0]),
        runner_up=ranked.poses[1] if second else None,
        runner_up_score=runner_up_score,
        runner_up_support=_supporters(target, source, ranked.poses[1]) if second else 0,
        hypotheses_tested=ranked.tested,
        free_space_known=free_space_known,
        ambiguous=bool(ambiguous),
        reasons=tuple(reasons),
    )


def _supporters(target: ScanFeatures, source: ScanFeatures, pose: RigidTransform) -> int:
    """Count the lines and planes that both scans see in a pose."""
    limits = {"max_angle_rad": SUPPORT_ANGLE_RAD, "max_distance_m": SUPPORT_DISTANCE_M}
    lines = corresponding_lines(target, source, pose, **limits)
    return len(lines) + len(corresponding_planes(target, source, pose, **limits))
