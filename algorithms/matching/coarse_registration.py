"""Find the pose of one scan in another without a first guess."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.errors import TooFewCorrespondencesError
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.rotations import rotation_matrix
from algorithms.matching.candidates import candidate_motions
from algorithms.matching.degeneracy import require_determining_geometry
from algorithms.matching.directions import comes_first
from algorithms.matching.feature_fit import common_features
from algorithms.matching.hypotheses import FINE_SIFTS, RankedPoses, rank_hypotheses
from algorithms.matching.options import MatchingOptions
from algorithms.matching.plane_triples import offset_votes
from algorithms.matching.prior_decisions import decided_with_priors, rank_with_priors
from algorithms.matching.priors import PairPriors
from algorithms.matching.rivals import LEAST_SUPPORT, Weighed, weigh_poses
from algorithms.matching.self_likeness import CONTRADICTED, Contradiction, are_near, keeps_directions
from algorithms.matching.surface_correlation import correlated_motions
from algorithms.matching.symmetries import poses_by_symmetry
from algorithms.progress import NoProgress, Progress

SUPPORT_ANGLE_RAD = 0.035
"""Lines and planes support a pose within 2 degrees and `SUPPORT_DISTANCE_M`."""
SUPPORT_DISTANCE_M = 0.15
LEAST_SCORE_TO_DOUBT = 0.1
"""Poses with lower scores are not believed anyhow, whatever else is possible."""
ENOUGH_SCORE, ENOUGH_FEATURES = 0.4, 6
"""Where a pose scores so much, and so many lines and planes are common, the other shifts need not be searched."""
MANY_FEATURES, MANY_FACTOR, MANY_RATIO = 30, 4, 0.3
"""Nor where so many are, so many times those of the best other pose, which scores no more than the third value times as
much: 15 pairs of a garage and a yard were right then, and the search found nothing that mattered."""


@dataclass(frozen=True, eq=False)
class CoarseRegistration:
    """A pose found without a first guess, with what speaks for it and what else could be."""

    target_from_source: RigidTransform
    """Pose, source to target, both in their reduced frames [m]."""
    support: int
    """How many lines and planes both scans see in this pose."""
    score: float
    """Support share, discounted for surface in free space; comparable between poses of one pair."""
    support_share: float
    """Mean of both scans' shares of surface that fits the other's, each a geometric mean over directions, 0..1."""
    violation_share: float
    """Mean of both scans' shares of surface that stands where the other looked through, 0..1."""
    overlap: float
    """Larger of both scans' shares that fit, 0..1."""
    runner_up: RigidTransform | None
    """The best clearly different pose (more than 5 gon or 0.3 m away) that the lines do not refute; None if there is
    none."""
    runner_up_score: float
    """Its score, judged charitably (`PoseScores.charitable`); 0 if there is none."""
    runner_up_support: int
    """How many lines and planes both scans see there; 0 if there is none."""
    hypotheses_tested: int
    """How many poses were tried."""
    free_space_known: bool
    """Whether the instrument's position is known for both scans; else nothing was tested for violation on that side."""
    ambiguous: bool
    """Whether the runner-up is nearly as good, or possible by a symmetry of the building."""
    reasons: tuple[str, ...]
    """What makes the answer doubtful, in words with figures; empty when nothing does."""
    remarks: tuple[str, ...] = ()
    """What the reader should know although it makes nothing doubtful."""
    lone_spotless: bool = False
    """Whether hardly anything speaks against the pose and clearly more against every other (`spotless`), all shifts of
    the surfaces searched."""
    others: tuple[RigidTransform, ...] = ()
    """Clearly different poses, the best first, whose evidence is worth weighing."""

    def inverted(self) -> "CoarseRegistration":
        """Give the same finding with target and source exchanged; its words name neither."""
        return replace(
            self,
            target_from_source=self.target_from_source.inv(),
            runner_up=None if self.runner_up is None else self.runner_up.inv(),
            others=tuple(each.inv() for each in self.others),
        )


def match_features(
    target: ScanFeatures,
    source: ScanFeatures,
    options: MatchingOptions,
    *,
    progress: Progress | None = None,
    priors: PairPriors | None = None,
) -> CoarseRegistration:
    """Find the pose of the source scan in the target scan without a first guess.

    Pairs of lines that look alike vote for motions (Lichtenstein's solution, MATH 1.7 and 5.5), planes propose
    more, and every leading motion is tested: how much surface fits, and how much stands where the other instrument
    looked through. Deterministic, and the same whichever scan is called the target (`directions`).

    Parameters
    ----------
    target, source
        Features of the two scans.
    options
        Limits.
    progress
        Is told the steps.
    priors
        What is known of the stations beforehand; None: nothing.

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
    if min(len(features.index.points) for features in (target, source)) == 0:
        raise TooFewCorrespondencesError(0, 1, "surface points")
    if comes_first(target, source):
        return _found(target, source, options, tell, priors)
    return _found(source, target, options, tell, None if priors is None else priors.exchanged()).inverted()


def _found(
    target: ScanFeatures, source: ScanFeatures, options: MatchingOptions, tell: Progress, priors: PairPriors | None
) -> CoarseRegistration:
    """Find the pose in one direction."""
    tell.report(0.0, "pairs of lines and planes")
    hypotheses = candidate_motions(target, source, options)
    hypotheses = hypotheses if priors is None else priors.proposed(hypotheses)
    if len(hypotheses) == 0:
        raise TooFewCorrespondencesError(0, 2, "pairs of lines or planes that look alike")
    tell.report(0.4, "testing hypotheses")
    noise = max(target.noise_std_m, source.noise_std_m)
    if priors is None:
        ranked = rank_hypotheses(hypotheses, target.index, source.index, noise_m=noise)
    else:
        ranked = rank_with_priors(hypotheses, target.index, source.index, priors, noise_m=noise)
    exhaustive = options.all_shifts and not convinces(target, source, ranked)
    if exhaustive or (options.all_shifts and _is_contradicted(ranked)):
        tell.report(0.6, "testing all shifts")
        # what repetitions alone show makes a pose doubtful and leads to the search of all, below; it proves none
        ranked = with_all_shifts(ranked, target, source, options, repetitions_only=not exhaustive)
    if ranked.scores.support[0] < LEAST_SUPPORT:
        raise TooFewCorrespondencesError(0, 1, "surfaces")
    tell.report(0.7, "looking for symmetries")
    ranked = with_symmetries(ranked, target, source, options)
    result = _described(target, source, ranked, options, exhaustive=exhaustive)
    if result.ambiguous and options.all_shifts and not exhaustive:
        # refuting the others proves a pose only if the right one is among them
        tell.report(0.8, "testing all shifts")
        exhaustive, ranked = True, with_all_shifts(ranked, target, source, options)
        ranked = with_symmetries(ranked, target, source, options)
        result = _described(target, source, ranked, options, exhaustive=exhaustive)
    if priors is not None:
        result = decided_with_priors(
            result, ranked, priors, lambda some: _described(target, source, some, options, exhaustive=exhaustive)
        )
    tell.report(1.0, "pose found")
    return result


def convinces(target: ScanFeatures, source: ScanFeatures, ranked: RankedPoses) -> bool:
    """Say whether the best pose needs no search of all other shifts.

    Parameters
    ----------
    target, source
        Features of the two scans.
    ranked
        The poses that lines, planes and surfaces propose.
    """
    score, best = ranked.scores.score, ranked.poses[0]
    supporters = _supporters(target, source, best)
    if score[0] >= ENOUGH_SCORE and supporters >= ENOUGH_FEATURES:
        return True
    if score[0] < LEAST_SCORE_TO_DOUBT or supporters < MANY_FEATURES:
        return False
    by_worth = np.argsort(-ranked.scores.charitable, kind="stable").tolist()
    others = (k for k in by_worth if k and not are_near(best, ranked.poses[k], target.index, source.index))
    rival = next(others, None)
    return rival is None or bool(
        ranked.scores.charitable[rival] <= MANY_RATIO * score[0]
        and MANY_FACTOR * _supporters(target, source, ranked.poses[rival]) <= supporters
    )


def _is_contradicted(ranked: RankedPoses) -> bool:
    """Say whether so much speaks against the best pose that a repetition of the building may have made it.

    In a hall of equal bays the right pose may share little and be proposed by nothing, while a wrong one, bays away,
    lays most of the surface on surface: it is seen to be wrong only beside the right one, against which nothing speaks.
    """
    support, violation = float(ranked.scores.support[0]), float(ranked.scores.violation[0])
    return Contradiction.of(support, violation).share > CONTRADICTED


def with_all_shifts(
    ranked: RankedPoses,
    target: ScanFeatures,
    source: ScanFeatures,
    options: MatchingOptions,
    *,
    repetitions_only: bool = False,
) -> RankedPoses:
    """Add the best of all shifts at the rotations that planes propose.

    Of repetitions of the building only: at the rotations that, beside the best pose, lay its directions on themselves.
    """
    votes = offset_votes(target, source, max_angle_rad=options.max_angle_rad)
    if repetitions_only:
        best = rotation_matrix(ranked.poses[0])
        turns = np.array([each.rotation for each in votes]).reshape(-1, 3, 3)
        kept = keeps_directions(target.index, turns @ best.T) | keeps_directions(source.index, best.T @ turns)
        votes = [each for each, is_kept in zip(votes, kept, strict=True) if is_kept]
    shifts = correlated_motions(votes, target.index, source.index)
    if len(shifts) == 0:
        return ranked
    noise = max(target.noise_std_m, source.noise_std_m)
    found = rank_hypotheses(shifts, target.index, source.index, noise_m=noise, sifts=FINE_SIFTS, settle_first=True)
    return ranked.joined(found, source.index)


def with_symmetries(
    ranked: RankedPoses, target: ScanFeatures, source: ScanFeatures, options: MatchingOptions
) -> RankedPoses:
    """Add the poses that differ from the best one by a motion that lays a scan onto itself."""
    if ranked.scores.score[0] < LEAST_SCORE_TO_DOUBT:
        return ranked
    others = poses_by_symmetry(target, source, ranked.poses[0], options)
    if len(others) == 0:
        return ranked
    noise = max(target.noise_std_m, source.noise_std_m)
    return ranked.joined(rank_hypotheses(others, target.index, source.index, noise_m=noise), source.index)


def _described(
    target: ScanFeatures,
    source: ScanFeatures,
    ranked: RankedPoses,
    options: MatchingOptions,
    *,
    exhaustive: bool,
) -> CoarseRegistration:
    """Count the supporting features and compare the best pose with the best other one that is not refuted."""
    weighed = weigh_poses(target, source, ranked, options, exhaustive=exhaustive)
    pose, scores = ranked.poses[weighed.first], ranked.scores
    best = float(scores.score[weighed.first])
    second = next(iter([*weighed.symmetric, *weighed.rivals]), None)
    runner_up_score = 0.0 if second is None else float(scores.charitable[second])
    # what fits as well but is contradicted is no rival of the only pose that nothing speaks against
    close = not weighed.spotless and runner_up_score > 0.0 and runner_up_score >= options.ambiguity_ratio * best
    free_space_known = target.index.knows_free_space and source.index.knows_free_space
    reasons = []
    if weighed.symmetric:
        other = weighed.symmetric[0]
        count = len(weighed.symmetric)
        reasons.append(
            f"the building looks like itself elsewhere: another pose, {_apart(source, pose, ranked.poses[other])}, "
            f"lays {scores.support[other]:.0%} of the surface on surface and only {scores.violation[other]:.1%} stands "
            f"where the other scan looked through{f' ({count - 1} more such poses)' if count > 1 else ''}"
        )
    elif close and second is not None:
        reasons.append(
            f"another pose, {_apart(source, pose, ranked.poses[second])}, scores {runner_up_score:.2f} "
            f"against {best:.2f}"
        )
    if not free_space_known:
        reasons.append("the position of an instrument is unknown, so free space was not tested on that side")
    return CoarseRegistration(
        target_from_source=pose,
        support=_supporters(target, source, pose),
        score=best,
        support_share=float(scores.support[weighed.first]),
        violation_share=float(scores.violation[weighed.first]),
        overlap=float(scores.overlap[weighed.first]),
        runner_up=None if second is None else ranked.poses[second],
        runner_up_score=runner_up_score,
        runner_up_support=0 if second is None else _supporters(target, source, ranked.poses[second]),
        hypotheses_tested=ranked.tested,
        free_space_known=free_space_known,
        ambiguous=bool(close or weighed.symmetric),
        reasons=tuple(reasons),
        remarks=_remarks(source, ranked, weighed),
        lone_spotless=weighed.spotless,
        others=tuple(ranked.poses[k] for k in ranked.worth_weighing() if k != weighed.first),
    )


def _remarks(source: ScanFeatures, ranked: RankedPoses, weighed: Weighed) -> tuple[str, ...]:
    """Say which other poses were refuted, and by what."""
    pose, scores, remarks = ranked.poses[weighed.first], ranked.scores, []
    if weighed.refuted:
        rival, here, there = weighed.refuted[0]
        remarks.append(
            f"another pose, {_apart(source, pose, ranked.poses[rival])}, fits the surfaces nearly as well (score "
            f"{scores.score[rival]:.2f} against {scores.score[weighed.first]:.2f}) but not the lines: of those that "
            f"tell the two apart {there.found} of {there.expected} are found again there, here {here.found} of "
            f"{here.expected}"
        )
    if weighed.told_apart:
        rival, evidence = weighed.told_apart[0]
        count = len(weighed.told_apart)
        remarks.append(
            f"another pose, {_apart(source, pose, ranked.poses[rival])}, lays {scores.support[rival]:.0%} of the "
            f"surface on surface, but about {evidence.here_m2:.2f} m2 that fits here stands there in free space or "
            f"beside a surface, and only {evidence.there_m2:.2f} m2 the other way round"
            f"{f' (so with {count - 1} more poses)' if count > 1 else ''}"
        )
    return tuple(remarks)


def _apart(source: ScanFeatures, pose: RigidTransform, other: RigidTransform) -> str:
    """Say in words how far another pose is from the first."""
    turn = np.degrees((other.rotation * pose.rotation.inv()).magnitude()) / 0.9
    centre = source.surface.points.mean(axis=0)
    return f"turned by {turn:.1f} gon and shifted by {np.linalg.norm(other.apply(centre) - pose.apply(centre)):.2f} m"


def _supporters(target: ScanFeatures, source: ScanFeatures, pose: RigidTransform) -> int:
    """Count the lines and planes that both scans see in a pose."""
    return common_features(target, source, pose, max_angle_rad=SUPPORT_ANGLE_RAD, max_distance_m=SUPPORT_DISTANCE_M)
