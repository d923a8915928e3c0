"""Which of two poses the lines speak for: lines that both scans should see must be found again.

A flat facade fits as well a step further along itself; its window edges do not. So of all lines that would lie
elsewhere in the other pose, count those that the other scan should have seen, and of these those it did see. In the
right pose that share is what the extraction of lines repeats; in a pose that differs by a symmetry of the building it
is the same; in any other pose it is close to chance.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import RigidTransform
from scipy.stats import fisher_exact

from algorithms.arrays import Flags, Indices, Points, Scalars
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.lines import Lines, LineSource
from algorithms.matching.correspondences import lines_near
from algorithms.matching.line_pairs import described_lines

FOUND_ANGLE_RAD, FOUND_DISTANCE_M, FOUND_NOISES = 0.02, 0.03, 2.0
"""A line is found again within this angle, and within this distance or so many standard deviations of single points."""
COMMON_SHARE = 0.3
"""So much of the shorter of two pieces must be common."""
SENSITIVE_FACTOR = 4.0
"""A line tells two poses apart when it moves across itself by so many distances at which it counts as found."""
SAMPLE_STEP_M, MOST_SAMPLES = 0.1, 60
SEEN_SHARE, SEEN_REACH = 0.7, 1.2
"""A line should have been seen where the other scan has surface, within so many of its voxels, along this share."""
FARTHEST = 1.5
"""The other instrument may be this much farther away than the one that saw the line: what is seen fades with range, and
a pose must not look better because it lays near things on near things."""
LEAST_FOUND, MOST_RATE = 8, 0.5
"""A pose is refuted by so many found lines at least, and where below this multiple of their share is found."""
PHOTO_REACH_M = 0.5
"""The other scan's photos show the place of a line of photos where one of their own lines is so near."""


@dataclass(frozen=True)
class LineEvidence:
    """What the lines say of one pose beside another."""

    expected: int
    """Lines that would lie elsewhere in the other pose and should have been seen by the other scan."""
    found: int
    """Those of them it has."""

    @property
    def rate(self) -> float:
        """Share of the expected lines that are found; 0 where none is expected."""
        return self.found / self.expected if self.expected else 0.0


class LineWitness:
    """Two scans whose lines are asked about pairs of poses. Holds search trees; O(n log n) to build."""

    def __init__(self, target: ScanFeatures, source: ScanFeatures) -> None:
        """Prepare both scans.

        Parameters
        ----------
        target, source
            Features of the two scans.
        """
        self._scans = (_Witness(target), _Witness(source))
        self._distance_m = max(FOUND_DISTANCE_M, FOUND_NOISES * max(target.noise_std_m, source.noise_std_m))

    def compare(self, pose: RigidTransform, other: RigidTransform) -> tuple[LineEvidence, LineEvidence]:
        """Count the lines that tell two poses apart, in each of them.

        Parameters
        ----------
        pose, other
            Target from source, between the reduced frames.
        """
        counts = np.zeros((2, 2), dtype=np.int64)
        there = (other.inv(), pose.inv())
        for number, (seen_from_target, seen_from_source) in enumerate(((pose.inv(), pose), (other.inv(), other))):
            for scan, partner, motion, rival in (
                (*self._scans, seen_from_target, there[number]),
                (*self._scans[::-1], seen_from_source, (other, pose)[number]),
            ):
                tells = moved_across(scan.features.lines, motion, rival) > SENSITIVE_FACTOR * self._distance_m
                expected = tells & scan.expected_in(partner, motion)
                found = scan.found_in(partner, motion, self._distance_m)
                counts[number] += [np.count_nonzero(expected), np.count_nonzero(expected & found)]
        first, second = (LineEvidence(int(expected), int(found)) for expected, found in counts)
        return first, second


def refutes(evidence: LineEvidence, other: LineEvidence, *, alpha: float) -> bool:
    """Say whether lines found in one pose and missing in the other show that the other is wrong.

    Parameters
    ----------
    evidence, other
        Of the two poses.
    alpha
        Largest probability of such a difference by chance (Fisher's exact test, one-sided).
    """
    if evidence.found < LEAST_FOUND or other.expected == 0 or other.rate > MOST_RATE * evidence.rate:
        return False
    table = np.array([[e.found, e.expected - e.found] for e in (evidence, other)])
    return bool(fisher_exact(table, alternative="greater").pvalue <= alpha)


def moved_across(lines: Lines, motion: RigidTransform, other: RigidTransform) -> Scalars:
    """Measure how far each line lies from itself between two motions, across it at the nearer end, (n,) [m]."""
    directions = motion.rotation.apply(lines.directions) if len(lines) else lines.directions
    across = []
    for ends in lines.end_points:
        shift = other.apply(ends) - motion.apply(ends) if len(lines) else ends
        along = np.einsum("ij,ij->i", shift, directions)
        across.append(np.sqrt(np.maximum(np.einsum("ij,ij->i", shift, shift) - along**2, 0.0)))
    return np.asarray(np.minimum(*across))


class _Witness:
    """One scan: its lines, samples along them, and trees of its surface and of its photo lines."""

    def __init__(self, features: ScanFeatures) -> None:
        self.features = features
        self.described = described_lines(features)
        self._owners, self._samples = _along(features.lines)
        self._counts = np.maximum(np.bincount(self._owners, minlength=len(features.lines)), 1)
        self._of_photos = features.lines.sources == int(LineSource.PHOTO_EDGE)
        self.surface = cKDTree(features.surface.points)
        self.photo_lines = cKDTree(self._samples[self._of_photos[self._owners]])

    def expected_in(self, other: "_Witness", other_from_own: RigidTransform) -> Flags:
        """Say which of the own lines the other scan should have seen."""
        if len(self._samples) == 0:
            return np.zeros(len(self.features.lines), dtype=bool)
        places = other_from_own.apply(self._samples)
        reach = SEEN_REACH * other.features.surface.voxel_size_m + FOUND_DISTANCE_M
        seen = _has_within(other.surface, places, reach) & self._near_enough(other, places)
        in_photos = self._of_photos[self._owners]
        seen[in_photos] &= _has_within(other.photo_lines, places[in_photos], PHOTO_REACH_M)
        return np.bincount(self._owners, seen, len(self._counts)) >= SEEN_SHARE * self._counts

    def found_in(self, other: "_Witness", other_from_own: RigidTransform, distance_m: float) -> Flags:
        """Say which of the own lines the other scan has."""
        near = lines_near(
            self.described,
            other.described,
            other_from_own.inv(),
            max_angle_rad=FOUND_ANGLE_RAD,
            max_distance_m=distance_m,
        )
        own, others = self.features.lines.lengths, other.features.lines.lengths
        shorter = np.minimum(own[near.pairs[:, 0]], others[near.pairs[:, 1]])
        found = np.zeros(len(own), dtype=bool)
        found[near.pairs[near.overlaps_m >= COMMON_SHARE * shorter, 0]] = True
        return found

    def _near_enough(self, other: "_Witness", places: Points) -> Flags:
        if self.features.sensor_m is None or other.features.sensor_m is None:
            return np.ones(len(places), dtype=bool)
        own = np.linalg.norm(self._samples - self.features.sensor_m, axis=1)
        return np.asarray(np.linalg.norm(places - other.features.sensor_m, axis=1) <= FARTHEST * own)


def _has_within(tree: cKDTree, places: Points, reach_m: float) -> Flags:
    if tree.n == 0:
        return np.zeros(len(places), dtype=bool)
    return np.isfinite(tree.query(places, distance_upper_bound=reach_m)[0])


def _along(lines: Lines) -> tuple[Indices, Points]:
    """Sample the seen pieces evenly: owner and position of each sample."""
    counts = np.clip(np.ceil(lines.lengths / SAMPLE_STEP_M), 2, MOST_SAMPLES).astype(np.int64)
    owners = np.repeat(np.arange(len(lines)), counts)
    first = np.repeat(np.cumsum(counts) - counts, counts)
    shares = (np.arange(len(owners)) - first) / (counts[owners] - 1)
    places = lines.extents[owners, 0] + shares * lines.lengths[owners]
    return owners, lines.anchors[owners] + places[:, None] * lines.directions[owners]
