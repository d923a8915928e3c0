"""Which of two poses the lines speak for: lines that both scans should see must be found again.

A flat facade fits as well a step further along itself; its window edges do not. So of all lines that would lie
elsewhere in the other pose, count those that the other scan should have seen, because it has the surfaces beside them,
and of these those it did see. In the right pose that share is what the extraction of lines repeats; in a pose that
differs by a symmetry of the building it is the same; in any other pose it is close to chance.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import Delaunay
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Flags, Indices, Matrix3, Points, Scalars, Vector3
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.lines import Lines, LineSource, bases_of, concatenated_lines
from algorithms.geometry.rotations import rotation_matrix, turn_between
from algorithms.matching.correspondences import lines_near
from algorithms.matching.line_pairs import described_lines
from algorithms.probabilities import fisher_exact_greater
from algorithms.scans.surface_index import EvidenceLimits, SurfaceIndex
from algorithms.scans.surface_matches import fitting

FOUND_ANGLE_RAD, FOUND_DISTANCE_M, FOUND_NOISES = 0.02, 0.03, 2.0
"""A line is found again within this angle, and within this distance or so many standard deviations of single points."""
COMMON_SHARE = 0.3
"""So much of the shorter of two pieces must be common."""
SENSITIVE_FACTOR = 4.0
"""A line tells two poses apart when it moves across itself by so many distances at which it counts as found."""
SAMPLE_STEP_M, MOST_SAMPLES = 0.1, 60
SEEN_SHARE = 0.7
"""A line should have been seen where the other scan has the surfaces beside it along this share."""
SIDE_VOXELS, SIDE_DISTANCE_M, SIDE_ANGLE_RAD = 1.5, 0.08, np.radians(25.0)
"""The surfaces are looked for so many voxels beside the line, within this distance and angle."""
FARTHEST = 1.5
"""The other instrument may be this much farther away than the one that saw the line: what is seen fades with range, and
a pose must not look better because it lays near things on near things."""
LEAST_FOUND, LEAST_EXPECTED, MOST_RATE = 8, 10, 0.5
"""A pose is refuted by so many found lines at least, where so many are expected and below this multiple of the share is
found: a few lines can be missing for one common reason."""
ALIKE_VIEWS_RAD = 0.2
"""Views of a line from directions that differ by less show the same of it."""
LEAST_VIEW_ENDS = 6
"""A photo needs so many ends of lines to have an outline."""
MIN_VIEW_COSINE = 0.2
"""Directions farther than this from the middle of a photo's lines are taken as outside of it."""


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

    def __add__(self, other: "LineEvidence") -> "LineEvidence":
        """Count two kinds of evidence together."""
        return LineEvidence(self.expected + other.expected, self.found + other.found)


@dataclass(frozen=True, eq=False)
class _Laid:
    """What becomes of n lines of a scan where a motion lays them on a scan."""

    between: Flags
    """(n,) True for lines that this scan should have seen because it has both surfaces beside them."""
    beside: Flags
    """(n,) True for those that it should have seen if one of these surfaces suffices."""
    found: Flags
    """(n,) True for lines that this scan has."""


class LineWitness:
    """Two scans whose lines are asked about pairs of poses. Holds search trees; O(n log n) to build.

    What one pose shows is remembered: it is asked beside many others.
    """

    def __init__(self, target: ScanFeatures, source: ScanFeatures) -> None:
        """Prepare both scans.

        Parameters
        ----------
        target, source
            Features of the two scans.
        """
        self._scans = (_Witness(target), _Witness(source))
        self._distance_m = max(FOUND_DISTANCE_M, FOUND_NOISES * max(target.noise_std_m, source.noise_std_m))
        self._laid: dict[tuple[int, int, bytes], _Laid] = {}

    def compare(
        self, pose: RigidTransform, other: RigidTransform, *, alike_views: bool = False
    ) -> tuple[LineEvidence, LineEvidence]:
        """Count the lines that tell two poses apart, in each of them.

        Parameters
        ----------
        pose, other
            Target from source, between the reduced frames.
        alike_views
            Count the lines that both poses show from nearly the same direction, where one surface beside them suffices:
            a window's reveal that is not there cannot be seen, but the wall on which it should be can.
        """
        back, there = pose.inv(), other.inv()
        here = self._count(0, 1, back, (back, there), alike_views) + self._count(1, 0, pose, (pose, other), alike_views)
        return here, (
            self._count(0, 1, there, (there, back), alike_views) + self._count(1, 0, other, (other, pose), alike_views)
        )

    def seen_in(self, pose: RigidTransform) -> LineEvidence:
        """Count the lines that the other scan should have seen in a pose, and of them those that it has.

        Parameters
        ----------
        pose
            Target from source, between the reduced frames.
        """
        laid = self._laid_on(0, 1, pose.inv()), self._laid_on(1, 0, pose)
        return LineEvidence(
            sum(int(np.count_nonzero(each.between)) for each in laid),
            sum(int(np.count_nonzero(each.between & each.found)) for each in laid),
        )

    def _laid_on(self, own: int, partner: int, motion: RigidTransform) -> _Laid:
        """Lay the lines of a scan on its partner."""
        key = (own, partner, motion.as_matrix().tobytes())
        if key not in self._laid:
            self._laid[key] = self._scans[own].laid_on(self._scans[partner], motion, self._distance_m)
        return self._laid[key]

    def _count(
        self, own: int, partner: int, motion: RigidTransform, apart: tuple[RigidTransform, RigidTransform], alike: bool
    ) -> LineEvidence:
        """Count the lines of a scan, laid on its partner by a motion, that lie elsewhere between two motions."""
        scan, laid = self._scans[own], self._laid_on(own, partner, motion)
        asked = moved_across(scan.features.lines, *apart) > SENSITIVE_FACTOR * self._distance_m
        if alike:
            asked &= laid.beside & scan.viewed_alike(self._scans[partner], *apart)
        else:
            asked &= laid.between
        return LineEvidence(int(np.count_nonzero(asked)), int(np.count_nonzero(asked & laid.found)))

    def refutation(
        self, pose: RigidTransform, other: RigidTransform, *, alpha: float
    ) -> tuple[LineEvidence, LineEvidence] | None:
        """Show that another pose is wrong by lines found in the first and missing in the other, or give None.

        Parameters
        ----------
        pose, other
            Target from source, between the reduced frames.
        alpha
            Largest probability of such a difference by chance (Fisher's exact test, one-sided).

        Returns
        -------
        Evidence of the first pose, and of the other one together with the repetition it would need.
        """
        for alike_views in (False, True):
            here, there = self.compare(pose, other, alike_views=alike_views)
            if here.found < LEAST_FOUND:
                continue
            there = there + self.self_likeness(pose, other, alike_views=alike_views)
            if there.expected < LEAST_EXPECTED or there.rate > MOST_RATE * here.rate:
                continue
            if fisher_exact_greater(here.found, here.expected, there.found, there.expected) <= alpha:
                return here, there
        return None

    def self_likeness(self, pose: RigidTransform, other: RigidTransform, *, alike_views: bool = False) -> LineEvidence:
        """Lay each scan's lines onto themselves by the motion between two poses, and count those found again.

        If the other pose were right, and this one only looked right because the building repeats itself, then the
        building would show the same repetition to each scan alone.

        Parameters
        ----------
        pose, other
            Target from source, between the reduced frames.
        alike_views
            As for `compare`.
        """
        evidence, rest = LineEvidence(0, 0), RigidTransform.identity()
        for k, motion in enumerate((other * pose.inv(), pose.inv() * other)):
            for each in (motion, motion.inv()):
                evidence = evidence + self._count(k, k, each, (rest, each), alike_views)
        return evidence


def moved_across(lines: Lines, motion: RigidTransform, other: RigidTransform) -> Scalars:
    """Measure how far each line lies from itself between two motions, across it at the nearer end, (n,) [m]."""
    directions = lines.directions @ rotation_matrix(motion).T
    across = []
    for ends in lines.end_points:
        shift = other.apply(ends) - motion.apply(ends) if len(lines) else ends
        along = np.einsum("ij,ij->i", shift, directions)
        across.append(np.sqrt(np.maximum(np.einsum("ij,ij->i", shift, shift) - along**2, 0.0)))
    return np.asarray(np.minimum(*across))


def with_witnesses(features: ScanFeatures) -> ScanFeatures:
    """Add the edges of photos that measure nothing but can be recognised."""
    edges = features.photo_edges
    if edges is None or edges.witnesses is None or edges.witness_normals is None:
        return features
    normals = np.concatenate([edges.line_normals, edges.witness_normals])
    more = replace(edges, line_normals=normals, line_kinds=np.zeros(len(normals), dtype=np.int32))
    return replace(features, lines=concatenated_lines([features.lines, edges.witnesses]), photo_edges=more)


class _Witness:
    """One scan: its lines, with samples of the surfaces beside them, and what its photos show."""

    def __init__(self, scan: ScanFeatures) -> None:
        features = with_witnesses(scan)
        self.features, self.index = features, scan.index
        self.described = described_lines(features)
        self._owners, self._samples = _along(features.lines)
        self._counts = np.maximum(np.bincount(self._owners, minlength=len(features.lines)), 1)
        self._sides = _sides(features, SIDE_VOXELS * self.index.spacing_m)
        self._of_photos = features.lines.sources == int(LineSource.PHOTO_EDGE)
        self._views = _views(scan)

    def laid_on(self, other: "_Witness", other_from_own: RigidTransform, distance_m: float) -> _Laid:
        """Say which of the own lines the other scan should have seen, and which it has."""
        found = self._found_in(other, other_from_own, distance_m)
        if len(self._samples) == 0:
            nothing = np.zeros(len(self.features.lines), dtype=bool)
            return _Laid(nothing, nothing, found)
        places = other_from_own.apply(self._samples)
        shown = self._near_enough(other, places)
        in_photos = self._of_photos[self._owners]
        shown[in_photos] &= other.in_photos(places[in_photos])
        all_fit, one_fits = shown.copy(), np.zeros(len(shown), dtype=bool)
        for offsets, normals, present in self._sides:
            points, there = self._samples + offsets[self._owners], present[self._owners]
            fit = fitting(other_from_own, points, normals[self._owners], other.index, _side_limits(other.index))
            all_fit &= fit | ~there
            one_fits |= fit & there
        enough = SEEN_SHARE * self._counts
        between, beside = (
            np.bincount(self._owners, seen, len(self._counts)) >= enough for seen in (all_fit, one_fits & shown)
        )
        return _Laid(between, beside, found)

    def viewed_alike(self, other: "_Witness", motion: RigidTransform, rival: RigidTransform) -> Flags:
        """Say which of the own lines the other instrument sees from nearly the same direction after both motions."""
        lines, sensor = self.features.lines, other.features.sensor_m
        if len(lines) == 0 or sensor is None or turn_between(motion, rival) > ALIKE_VIEWS_RAD:
            return np.zeros(len(lines), dtype=bool)
        middles = np.mean(lines.end_points, axis=0)
        here, there = motion.apply(middles), rival.apply(middles)
        nearer = np.minimum(np.linalg.norm(here - sensor, axis=1), np.linalg.norm(there - sensor, axis=1))
        return np.asarray(np.linalg.norm(here - there, axis=1) <= ALIKE_VIEWS_RAD * nearer)

    def in_photos(self, places: Points) -> Flags:
        """Say which places the photos show: those between the directions of their lines."""
        shown = np.zeros(len(places), dtype=bool)
        for origin, axes, outline in self._views:
            local = (places - origin) @ axes
            ahead = local[:, 0] > MIN_VIEW_COSINE * np.linalg.norm(local, axis=1)
            flat = local[ahead, 1:] / local[ahead, :1]
            shown[ahead] |= outline.find_simplex(flat) >= 0
        return shown

    def _found_in(self, other: "_Witness", other_from_own: RigidTransform, distance_m: float) -> Flags:
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


def _views(features: ScanFeatures) -> list[tuple[Vector3, Matrix3, Delaunay]]:
    """Give for each photo the origin, the axes of a picture towards its lines, and the outline of the lines in it."""
    lines = features.lines
    if lines.photos is None:
        return []
    origin = np.zeros(3) if features.sensor_m is None else features.sensor_m
    views = []
    for photo in np.unique(lines.photos[lines.photos >= 0]):
        ends = np.concatenate(lines[lines.photos == photo].end_points) - origin
        directions = ends / np.linalg.norm(ends, axis=1, keepdims=True)
        middle = directions.mean(axis=0)
        middle /= np.linalg.norm(middle)
        axes = np.column_stack([middle, bases_of(middle[None])[0]])
        local = directions @ axes
        local = local[local[:, 0] > MIN_VIEW_COSINE]
        if len(local) >= LEAST_VIEW_ENDS:
            views.append((origin, axes, Delaunay(local[:, 1:] / local[:, :1], qhull_options="QJ")))
    return views


def _side_limits(index: SurfaceIndex) -> EvidenceLimits:
    return EvidenceLimits(SIDE_DISTANCE_M, SIDE_ANGLE_RAD, 2.5 * index.spacing_m)


def _sides(features: ScanFeatures, aside_m: float) -> tuple[tuple[Points, Points, Flags], ...]:
    """Give the surfaces that make a line visible, up to two: offset from the line, normal, and whether there is one.

    Beside an edge its two planes; the flank of a cylinder that its own instrument saw; the surface of a photo edge.
    """
    lines, planes = features.lines, features.planes
    n = len(lines)
    first = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n, dtype=bool)
    second = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n, dtype=bool)
    edges = np.flatnonzero((lines.parents >= 0).all(axis=1) & (lines.sources == int(LineSource.PLANE_INTERSECTION)))
    for side, (offsets, normals, present) in enumerate((first, second)):
        plane = lines.parents[edges, side]
        inwards = np.cross(planes.normals[plane], lines.directions[edges])
        towards = np.einsum("ij,ij->i", planes.centroids[plane] - lines.anchors[edges], inwards)
        offsets[edges] = aside_m * np.sign(towards)[:, None] * inwards
        normals[edges], present[edges] = planes.normals[plane], True
    offsets, normals, present = first
    axes = np.flatnonzero((lines.sources == int(LineSource.CYLINDER_AXIS)) & (lines.parents[:, 0] >= 0))
    if len(axes) and features.sensor_m is not None:
        numbers = lines.parents[axes, 0]
        towards = features.sensor_m - lines.anchors[axes]
        towards -= np.einsum("ij,ij->i", towards, lines.directions[axes])[:, None] * lines.directions[axes]
        towards /= np.maximum(np.linalg.norm(towards, axis=1), 1e-9)[:, None]
        outside = np.where(features.cylinders.convex[numbers], 1.0, -1.0)[:, None]
        offsets[axes] = outside * features.cylinders.radii_m[numbers, None] * towards
        normals[axes], present[axes] = towards, True
    in_photos = np.flatnonzero(lines.sources == int(LineSource.PHOTO_EDGE))
    if features.photo_edges is not None and len(in_photos):
        normals[in_photos], present[in_photos] = features.photo_edges.line_normals[in_photos], True
    return first, second


def _along(lines: Lines) -> tuple[Indices, Points]:
    """Sample the seen pieces evenly: owner and position of each sample."""
    counts = np.clip(np.ceil(lines.lengths / SAMPLE_STEP_M), 2, MOST_SAMPLES).astype(np.int64)
    owners = np.repeat(np.arange(len(lines)), counts)
    first = np.repeat(np.cumsum(counts) - counts, counts)
    shares = (np.arange(len(owners)) - first) / (counts[owners] - 1)
    places = lines.extents[owners, 0] + shares * lines.lengths[owners]
    return owners, lines.anchors[owners] + places[:, None] * lines.directions[owners]
