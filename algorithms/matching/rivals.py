"""Which of the poses that were found is the right one, and which others could be right as well.

Surfaces decide first (`pose_scores`), then what little differs between poses that fit alike: lines (`line_evidence`),
and surface that fits in one pose and stands in free space in the other (`surface_evidence`).
"""

from dataclasses import dataclass, field

from scipy.spatial.transform import RigidTransform

from algorithms.features.scan_features import ScanFeatures
from algorithms.matching.feature_fit import GATES, common_features, feature_pose_near
from algorithms.matching.hypotheses import RankedPoses
from algorithms.matching.line_evidence import LineEvidence, LineWitness
from algorithms.matching.options import MatchingOptions
from algorithms.matching.self_likeness import SPOTLESS, Contradiction, is_possible_alternative
from algorithms.matching.spotless import lone_spotless_pose
from algorithms.matching.surface_evidence import SurfaceEvidence, SurfaceWitness

LEAST_SUPPORT = 0.02
"""A pose on which less of the surface fits is no pose, and no rival."""
LEAST_RIVAL_RATIO = 0.25
"""Poses that score below this share of the best matter to no verdict."""
LINES_ALONE_ALPHA, LINES_TOO_ALPHA = 0.005, 0.02
"""Significance with which lines refute a pose that fits the surfaces as well, or that fits them worse anyhow."""
LEAST_SUPPORT_TO_PROVE = 0.1
"""So much of the surface must fit in a pose that is put before the one of best score because it refutes that: less may
fit by chance with nothing against it."""


@dataclass(frozen=True, eq=False)
class Weighed:
    """Poses in the order that surfaces and lines together give them."""

    first: int
    """Number of the best pose: that of the best score, unless another one refutes it or is the only spotless one."""
    spotless: bool
    """Whether the best pose is the only one that nothing speaks against."""
    rivals: list[int] = field(default_factory=list)
    """The others that are not refuted, the best first."""
    symmetric: list[int] = field(default_factory=list)
    """Rivals that a symmetry of the building makes possible, the one with most surface first."""
    refuted: list[tuple[int, LineEvidence, LineEvidence]] = field(default_factory=list)
    """Those that lines refute although the surfaces do not: number, evidence of the best pose, evidence there."""
    told_apart: list[tuple[int, SurfaceEvidence]] = field(default_factory=list)
    """Those that what little differs between the surfaces refutes: number, evidence."""


def weigh_poses(
    target: ScanFeatures,
    source: ScanFeatures,
    ranked: RankedPoses,
    options: MatchingOptions,
    *,
    exhaustive: bool,
) -> Weighed:
    """Choose the best pose, and find those that could be right as well.

    Parameters
    ----------
    target, source
        Features of the two scans.
    ranked
        All poses, by falling score.
    options
        From which ratio of scores on two poses are equally good.
    exhaustive
        Whether all shifts were searched: only then can it be said that nothing speaks against one pose alone, and do
        surfaces that differ refute others, for that proves a pose only if the right one is among those compared.
    """
    return _Weighing(target, source, ranked, options, exhaustive=exhaustive).result()


class _Weighing:
    """The poses of one pair, and what speaks for and against each."""

    def __init__(
        self,
        target: ScanFeatures,
        source: ScanFeatures,
        ranked: RankedPoses,
        options: MatchingOptions,
        *,
        exhaustive: bool,
    ) -> None:
        self.target, self.source, self.ranked, self.options = target, source, ranked, options
        self.noise_m = max(target.noise_std_m, source.noise_std_m)
        self.judged = [
            Contradiction.of(float(support), float(violation))
            for support, violation in zip(ranked.scores.support, ranked.scores.violation, strict=True)
        ]
        self.lines = LineWitness(target, source)
        self.surfaces = SurfaceWitness(target.index, source.index, self.noise_m) if exhaustive else None
        score = ranked.scores.score
        self.close = [k for k in range(1, len(score)) if ranked.scores.charitable[k] > LEAST_RIVAL_RATIO * score[0]]
        self.fitted = {k: feature_pose_near(target, source, ranked.poses[k]) for k in (0, *self.close)}

    def result(self) -> Weighed:
        """Weigh all poses."""
        poses, charitable = self.ranked.poses, self.ranked.scores.charitable
        first, spotless = self._first()
        weighed = Weighed(first, spotless)
        for k in range(len(poses)):
            if k == first:
                continue
            possible = is_possible_alternative(
                poses[first],
                poses[k],
                best=self.judged[first],
                alternative=self.judged[k],
                target=self.target.index,
                source=self.source.index,
                noise_m=self.noise_m,
            )
            if (k in self.fitted or possible) and self._refutes(first, k, weighed, possible=possible):
                continue
            weighed.rivals.append(k)
            if possible:
                weighed.symmetric.append(k)
        weighed.rivals.sort(key=lambda k: -charitable[k])
        weighed.symmetric.sort(key=lambda k: -self.judged[k].support)
        return weighed

    def _first(self) -> tuple[int, bool]:
        """Give the number of the best pose, and whether it is the only one that nothing speaks against."""
        poses, score = self.ranked.poses, self.ranked.scores.score
        if self.surfaces is not None:
            lone = lone_spotless_pose(poses, self.judged, self.target.index, self.source.index, self._common)
            first = self._proven(self.surfaces) if lone is None else lone
            if first != 0 or lone is not None:
                return first, lone is not None
        first = 0
        for k in self.close:
            nearly_as_good = score[k] >= self.options.ambiguity_ratio * score[0]
            if nearly_as_good and self.lines.refutation(self.fitted[k], self.fitted[first], alpha=LINES_ALONE_ALPHA):
                first = k
        return first, False

    def _proven(self, surfaces: SurfaceWitness) -> int:
        """Find a pose that refutes the one of best score and that no other refutes; 0, that one, if there is none.

        Nothing may speak against such a pose by itself either.
        """
        poses, judged = self.ranked.poses, self.judged
        clean = [k for k in range(1, len(poses)) if self._is_clean(k) and judged[k].support >= LEAST_SUPPORT_TO_PROVE]
        refuting = [k for k in clean if surfaces.refutation(poses[k], poses[0]) is not None]
        unrefuted = (
            k
            for k in sorted(refuting, key=lambda k: -judged[k].support)
            if all(surfaces.refutation(poses[other], poses[k]) is None for other in clean if other != k)
        )
        return next(unrefuted, 0)

    def _is_clean(self, k: int) -> bool:
        return self.judged[k].share <= SPOTLESS

    def _refutes(self, first: int, k: int, weighed: Weighed, *, possible: bool) -> bool:
        """Say whether lines or surfaces show that the best pose is right and another one is not, and note how."""
        score, charitable = self.ranked.scores.score, self.ranked.scores.charitable
        best, other = self._fitted(first), self._fitted(k)
        alone = possible or charitable[k] >= self.options.ambiguity_ratio * score[first]
        found = self.lines.refutation(best, other, alpha=LINES_ALONE_ALPHA if alone else LINES_TOO_ALPHA)
        if found is not None:
            weighed.refuted.append((k, *found))
            return True
        if self.surfaces is None or not self._is_clean(first):
            return False
        proof = self.surfaces.refutation(self.ranked.poses[first], self.ranked.poses[k])
        if proof is not None:
            weighed.told_apart.append((k, proof))
        return proof is not None

    def _common(self, k: int) -> int:
        """Count the lines and planes that lie closely on each other in a pose that is fitted to them."""
        max_angle_rad, max_distance_m = GATES[-1]
        return common_features(
            self.target, self.source, self._fitted(k), max_angle_rad=max_angle_rad, max_distance_m=max_distance_m
        )

    def _fitted(self, k: int) -> RigidTransform:
        """Give a pose with the features laid on each other."""
        if k not in self.fitted:
            self.fitted[k] = feature_pose_near(self.target, self.source, self.ranked.poses[k])
        return self.fitted[k]
