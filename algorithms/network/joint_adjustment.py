"""One adjustment of all stations to everything that two or more of them see (MATH 3.1, 4, 6.4).

Unknowns are the poses only: planes and lines are eliminated track by track (`FeatureTracks`), so the normal equations
have six unknowns for each station, are sparse, and cost O(sum of k³ over tracks) to build. Of their inverse the blocks
of stations that see something together are computed, which is what tests and covariances need (`Inverse`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.observations import Observation
from algorithms.adjustment.options import AdjustmentOptions
from algorithms.adjustment.problem import Problem
from algorithms.adjustment.snooping import robust_variance_factor
from algorithms.adjustment.solver import Solution, solve
from algorithms.adjustment.testing import BlockTests, GlobalTest, GlobalVerdict, global_test
from algorithms.adjustment.unknowns import UnknownKind, Unknowns
from algorithms.arrays import Matrix6
from algorithms.errors import TooFewCorrespondencesError
from algorithms.network.pose_graph import unknowns_of
from algorithms.network.track_observations import Track, TrackGroup, TrackKind, TrackLayout, largest_first
from algorithms.network.track_tests import TrackTests
from algorithms.network.tracks import Member, StationFeatures, Tracks
from algorithms.probabilities import chi2_isf

DEFAULT_OPTIONS = AdjustmentOptions()


@dataclass(frozen=True)
class RemovedMember:
    """A feature that does not fit the others of its track."""

    track: int
    """Number of the track: those of planes, then those of lines, then those of targets."""
    member: Member
    statistic: float
    """T with the features that remain, variance factor included."""
    critical: float
    """Limit of T."""


@dataclass(frozen=True, eq=False)
class JointAdjustment:
    """Adjusted poses of all stations with their tests."""

    stations: tuple[int, ...]
    """Numbers of the stations; the first one is fixed."""
    solution: Solution
    """Poses in the order of `stations`, with the inverse of the normal equations."""
    tracks: tuple[Track, ...]
    """Those that were used, with the members that were used."""
    removed: tuple[RemovedMember, ...]
    global_test: GlobalTest
    test_variance_factor: float
    """Variance factor that the tests of tracks allow for, at least 1."""

    @property
    def variance_factor(self) -> float:
        """Factor on the covariances: sigma0² where the global test finds the residuals too large, else 1 (MATH 4.1)."""
        if self.global_test.verdict is not GlobalVerdict.TOO_LARGE:
            return 1.0
        return self.solution.omega / self.solution.redundancy

    @property
    def observation_count(self) -> int:
        """Differences that must vanish, components counted; six more for each mount of a photo."""
        return len(self.solution.system.residuals)

    def pose(self, station: int) -> RigidTransform:
        """Give the pose of a station in the first one's frame."""
        return self.solution.unknowns.poses[self.stations.index(station)]

    def covariance(self, station: int) -> Matrix6:
        """Give the (6, 6) covariance of a station's pose, a posteriori where the residuals are too large."""
        place = np.array([self.stations.index(station)], dtype=np.int64)
        first = int(self.solution.unknowns.first_columns(UnknownKind.POSE, place)[0])
        if first < 0:
            return np.zeros((6, 6))
        return np.asarray(self.solution.inverse.blocks(first + np.arange(6)[None])[0] * self.variance_factor)


def adjust_jointly(
    features: Mapping[int, StationFeatures],
    tracks: Tracks,
    stations: Sequence[int],
    start: Mapping[int, RigidTransform],
    options: AdjustmentOptions = DEFAULT_OPTIONS,
) -> JointAdjustment:
    """Adjust the poses of all stations, and remove features that are not what their track is (MATH 4.5).

    The worst feature goes first; features of stations that no other one of the same round concerns are judged at once,
    because they hardly tell of each other. In the end everything removed is tested against the solution and taken back,
    in the same way, if it fits.

    Parameters
    ----------
    features
        Of each station, in its reduced frame.
    tracks
        Objects and the features that show them.
    stations
        Stations in the adjustment; the first one is fixed and defines the frame.
    start
        Poses in a common frame, good to some degrees and decimetres.
    options
        Levels and limits.

    Raises
    ------
    DegenerateGeometryError
        When the tracks leave a pose undetermined.
    TooFewCorrespondencesError
        Without any track.
    """
    found = [
        *(largest_first(TrackKind.PLANE, members, features) for members in tracks.planes),
        *(largest_first(TrackKind.LINE, members, features) for members in tracks.lines),
        *(largest_first(TrackKind.POINT, members, features) for members in tracks.points),
    ]
    search = _Search(features, found, stations, start, options)
    search.run(1.0)
    factor = search.robust_variance_factor() if options.robust_variance and search.removed else 1.0
    if factor > 1.0:
        search = _Search(features, found, stations, search.poses(), options)
        search.run(factor)
    solution = search.solved(rough=False)
    return JointAdjustment(
        stations=tuple(stations),
        solution=solution,
        tracks=tuple(track for _, track in search.active()),
        removed=search.removed_members(),
        global_test=global_test(solution.omega, solution.redundancy, options.alpha_global),
        test_variance_factor=factor,
    )


class _Search:
    """The search for features that do not fit: what is used, and the solution so far."""

    def __init__(
        self,
        features: Mapping[int, StationFeatures],
        tracks: Sequence[Track],
        stations: Sequence[int],
        start: Mapping[int, RigidTransform],
        options: AdjustmentOptions,
    ) -> None:
        self._tracks, self._options = tracks, options
        self._stations = tuple(stations)
        self._layout = TrackLayout(features, stations, tracks)
        base = start[stations[0]].inv()
        poses = [base * start[station] for station in stations]
        self._unknowns: Unknowns = unknowns_of(poses, self._layout.mount_count)
        self.removed: set[tuple[int, Member]] = set()
        self._returned: set[tuple[int, Member]] = set()
        self._factor = 1.0
        if not tracks:
            raise TooFewCorrespondencesError(0, 1, "features of several stations")

    def run(self, factor: float) -> None:
        """Remove until everything fits, then take back what fits after all."""
        self._factor = factor
        allowed = int(self._options.max_removed_share * sum(len(track.members) for track in self._tracks))
        while True:
            solution = self.solved(rough=True)
            worst = self._worst(solution, allowed - len(self.removed))
            if worst:
                self.removed |= worst
                continue
            returning = self._returning(solution)
            if not returning:
                return
            self.removed -= returning
            self._returned |= returning

    def poses(self) -> dict[int, RigidTransform]:
        """Give the poses so far."""
        return {station: self._unknowns.poses[k] for k, station in enumerate(self._stations)}

    def solved(self, *, rough: bool) -> Solution:
        """Adjust what is used."""
        observations: list[Observation] = [group.observations for group in self._groups(self.active())]
        if self._layout.mount_count:
            observations.append(self._layout.mount_observations())
        problem, start = Problem(observations), self._unknowns
        nothing_held = np.zeros((start.count, 0))
        solution = solve(problem, start, nothing_held, self._options.max_iterations, rough=rough)
        self._unknowns = solution.unknowns
        return solution

    def active(self) -> list[tuple[int, Track]]:
        """Give the tracks that still tie stations together, with their numbers and the members in use."""
        found = []
        for number, track in enumerate(self._tracks):
            members = self._used_of(number)
            if len(members) > 1:
                found.append((number, Track(track.kind, members)))
        return found

    def removed_members(self) -> tuple[RemovedMember, ...]:
        """Give what was removed with its test against the solution, worst first."""
        solution = self.solved(rough=True)
        found = [
            RemovedMember(number, member, statistic / self._factor, self._critical(degrees))
            for number, member, statistic, degrees in self._tested_outside(solution)
        ]
        return tuple(sorted(found, key=lambda entry: (-entry.statistic, entry.track, entry.member)))

    def robust_variance_factor(self) -> float:
        """Estimate the variance factor from the tracks in use (MATH 4.8)."""
        solution = self.solved(rough=True)
        tests = [
            TrackTests(group.observations, solution.unknowns, solution.inverse, in_solution=True).of_tracks()
            for group in self._groups(self.active())
        ]
        statistics = np.concatenate([test.statistics for test in tests])
        degrees = np.concatenate([test.degrees for test in tests])
        return robust_variance_factor(BlockTests(statistics, degrees, np.ones(len(degrees))), solution.redundancy)

    def _used_of(self, number: int) -> tuple[Member, ...]:
        return tuple(member for member in self._tracks[number].members if (number, member) not in self.removed)

    def _groups(self, tracks: Sequence[tuple[int, Track]]) -> list[TrackGroup]:
        return self._layout.grouped([track for _, track in tracks])

    def _critical(self, degrees: float) -> float:
        return float(chi2_isf(self._options.alpha_single, degrees)) if degrees > 0 else np.inf

    def _worst(self, solution: Solution, allowed: int) -> set[tuple[int, Member]]:
        """Find the features that fit least, at most one for each station and those that see it."""
        active = self.active()
        failing: list[tuple[float, int, Member]] = []
        for group in self._groups(active):
            tests = TrackTests(group.observations, solution.unknowns, solution.inverse, in_solution=True)
            size = group.observations.stations.shape[1]
            for slot in range(1 if size == 2 else 0, size):  # of two members either may be wrong: one test
                members = tests.of_members(slot)
                log_p = members.log_p(self._factor)
                for k in np.flatnonzero(log_p < np.log(self._options.alpha_single)).tolist():
                    number, track = active[group.numbers[k]]
                    if (number, track.members[slot]) not in self._returned:
                        failing.append((float(log_p[k]), number, track.members[slot]))
        return self._apart([(number, member) for _, number, member in sorted(failing)], allowed)

    def _returning(self, solution: Solution) -> set[tuple[int, Member]]:
        """Find the removed features that pass their tests best, at most one for each station and those that see it."""
        fitting = [
            (statistic / self._factor / self._critical(degrees), number, member)
            for number, member, statistic, degrees in self._tested_outside(solution)
            if degrees > 0 and statistic / self._factor <= self._critical(degrees)
        ]
        return self._apart([(number, member) for _, number, member in sorted(fitting)], len(fitting))

    def _apart(self, ranked: Sequence[tuple[int, Member]], most: int) -> set[tuple[int, Member]]:
        """Choose from features, the first one first, those that touch no station which a chosen one touches already."""
        chosen: set[tuple[int, Member]] = set()
        concerned: set[int] = set()
        for number, member in ranked:
            stations = {member[0], *(station for station, _ in self._used_of(number))}
            if len(chosen) < most and not stations & concerned:
                chosen.add((number, member))
                concerned |= stations
        return chosen

    def _tested_outside(self, solution: Solution) -> list[tuple[int, Member, float, float]]:
        """Test each removed feature with those of its track that are used: number, feature, T, degrees of freedom."""
        candidates = sorted(self.removed)
        tracks = [
            (number, Track(self._tracks[number].kind, (*self._used_of(number), member)))
            for number, member in candidates
        ]
        found = []
        for group in self._groups(tracks):
            tests = TrackTests(group.observations, solution.unknowns, solution.inverse, in_solution=False)
            members = tests.of_members(group.observations.stations.shape[1] - 1)
            for k, place in enumerate(group.numbers):
                number, member = candidates[place]
                found.append((number, member, float(members.statistics[k]), float(members.degrees[k])))
        return found
