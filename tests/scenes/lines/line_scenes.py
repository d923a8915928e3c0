"""Noisy lines seen in two scans, without a scanner: the scenes of MATH 10 and their exact noise (MATH 2.2)."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.line_adjustment import LineAdjustment, adjust_lines
from algorithms.adjustment.observations.plane_plane import PlanePlane
from algorithms.adjustment.options import AdjustmentOptions
from algorithms.geometry.lines import Lines, bases_of, lines_from_arrays

NOISE_M = 0.005
"""Standard deviation of each coordinate of single points."""
POINTS_PER_M = 20.0
LENGTHS_M = (1.0, 4.0)
"""Shortest and longest piece of a line that one scan sees."""
PIECE_SHIFT_M = 1.0
"""The middle of a seen piece lies up to this far along the line from the line's own middle."""
STATION_DISTANCE_M = 7.0
"""Between the two frames' origins."""
START_TURN_RAD, START_SHIFT_M = 0.005, 0.02
"""Standard deviation of the start values, about that of a pose from matching."""
KEEP_ALL = AdjustmentOptions(max_removed_share=0.0, robust_variance=False)
"""Test, but remove nothing."""


@dataclass(frozen=True, eq=False)
class LineScene:
    """Endless true lines, in the source scan's frame."""

    points: np.ndarray
    """(n, 3) middle of what is visible of each line [m]."""
    directions: np.ndarray
    """(n, 3) unit directions."""

    def __len__(self) -> int:
        return len(self.points)

    def moved(self, k: int, shift_m: np.ndarray, turn_rad: np.ndarray | None = None) -> "LineScene":
        """Give the scene with line k shifted by a vector, and turned by a rotation vector about its middle."""
        points, directions = self.points.copy(), self.directions.copy()
        points[k] += shift_m
        if turn_rad is not None:
            directions[k] = Rotation.from_rotvec(turn_rad).apply(directions[k])
        return LineScene(points, directions)


@dataclass(frozen=True, eq=False)
class ObservedPair:
    """What two scans see, and the truth."""

    target: Lines
    source: Lines
    correspondences: np.ndarray
    """(n, 2) target line, source line."""
    pose: RigidTransform
    """True target_from_source."""
    start: RigidTransform
    """Approximate target_from_source."""
    planes: PlanePlane | None = None
    """Planes that both see, for scenes made of planes."""

    def adjusted(self, options: AdjustmentOptions = KEEP_ALL) -> LineAdjustment:
        """Adjust with the planes, where there are any."""
        return adjust_lines(
            self.target, self.source, self.correspondences, self.start, planes=self.planes, options=options
        )


def pose_error(pose: RigidTransform, truth: RigidTransform) -> np.ndarray:
    """Give (rotation vector on the left, shift) that lead from a pose to the truth."""
    turn = (truth.rotation * pose.rotation.inv()).as_rotvec()
    return np.concatenate([turn, np.asarray(truth.translation) - np.asarray(pose.translation)])


def normalised_error(result: LineAdjustment, truth: RigidTransform) -> float:
    """Give the squared error of the pose in units of its covariance (NEES): chi-square with six degrees."""
    error = pose_error(result.pose.target_from_source, truth)
    return float(error @ np.linalg.solve(result.pose.covariance, error))


def random_motion(rng: np.random.Generator, distance_m: float = STATION_DISTANCE_M) -> RigidTransform:
    """Draw any rotation and a shift of the given length."""
    shift = rng.normal(size=3)
    return RigidTransform.from_components(distance_m * shift / np.linalg.norm(shift), Rotation.random(rng=rng))


def rough(pose: RigidTransform, rng: np.random.Generator) -> RigidTransform:
    """Draw start values near a pose."""
    turn = Rotation.from_rotvec(START_TURN_RAD * rng.normal(size=3))
    shift = START_SHIFT_M * rng.normal(size=3)
    return RigidTransform.from_components(np.asarray(pose.translation) + shift, turn * pose.rotation)


def observed_pair(
    scene: LineScene,
    rng: np.random.Generator,
    *,
    noise_m: float = NOISE_M,
    fitted: bool = False,
    source_scene: LineScene | None = None,
    pose: RigidTransform | None = None,
) -> ObservedPair:
    """See a scene from two scans, a different piece of each line in both.

    Parameters
    ----------
    scene
        What the target scan sees.
    rng
        Of all randomness.
    noise_m
        Standard deviation of points.
    fitted
        Fit lines to noisy points, instead of drawing their errors from the exact covariance of such a fit.
    source_scene
        What the source scan sees, line by line; left out, the same.
    pose
        True target_from_source; left out, any rotation and 7 m.
    """
    pose = random_motion(rng) if pose is None else pose
    seen = scene if source_scene is None else source_scene
    source = observed_lines(seen.points, seen.directions, rng, noise_m, fitted=fitted)
    target_points, target_directions = pose.apply(scene.points), pose.rotation.apply(scene.directions)
    target = observed_lines(target_points, target_directions, rng, noise_m, fitted=fitted)
    order = rng.permutation(len(scene))
    pairs = np.stack([order, np.arange(len(scene))], axis=1).astype(np.int64)
    return ObservedPair(target[np.argsort(order)], source, pairs, pose, rough(pose, rng))


def observed_lines(
    points: np.ndarray, directions: np.ndarray, rng: np.random.Generator, noise_m: float, *, fitted: bool
) -> Lines:
    """See 1 to 4 m of each line, in either sense; covariance sigma² diag(1/Sss, 1/Sss, 1/n, 1/n) (MATH 2.2)."""
    count = len(points)
    directions = directions * rng.choice([-1.0, 1.0], size=(count, 1))
    lengths = rng.uniform(*LENGTHS_M, size=count)
    middles = points + rng.uniform(-PIECE_SHIFT_M, PIECE_SHIFT_M, size=(count, 1)) * directions
    places = [np.linspace(-0.5, 0.5, round(POINTS_PER_M * length)) * length for length in lengths]
    if fitted:
        fits = [
            _fitted(c + s[:, None] * d + rng.normal(0.0, noise_m, (len(s), 3)), d)
            for c, d, s in zip(middles, directions, places, strict=True)
        ]
        middles, directions = (np.array([fit[k] for fit in fits]) for k in (0, 1))
        places = [fit[2] for fit in fits]
    weights = np.array([[s @ s, s @ s, len(s), len(s)] for s in places])
    std = noise_m / np.sqrt(weights)
    if not fitted:
        bases, errors = bases_of(directions), std * rng.normal(size=(count, 4))
        directions = directions + np.einsum("nij,nj->ni", bases, errors[:, :2])
        middles = middles + np.einsum("nij,nj->ni", bases, errors[:, 2:])
    extents = np.array([[s.min(), s.max()] for s in places])
    return lines_from_arrays(middles, directions, std[:, :, None] ** 2 * np.eye(4), extents)


def _fitted(points: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fit a line by total least squares: centroid, direction, and the points' places along it."""
    centroid = points.mean(axis=0)
    axis = np.linalg.svd(points - centroid, full_matrices=False)[2][0]
    axis = axis * np.sign(axis @ direction)
    return centroid, axis, (points - centroid) @ axis


def generic_lines(rng: np.random.Generator, count: int) -> LineScene:
    """Draw lines of any direction in a hall of 8 x 6 x 3 m."""
    directions = rng.normal(size=(count, 3))
    return LineScene(
        rng.uniform(-0.5, 0.5, size=(count, 3)) * [8.0, 6.0, 3.0],
        directions / np.linalg.norm(directions, axis=1, keepdims=True),
    )


def axis_lines(rng: np.random.Generator) -> LineScene:  # noqa: ARG001 - one of several scenes, most of which draw
    """Give three lines from one corner along the axes: example 1 of the dissertation."""
    return LineScene(2.0 * np.eye(3), np.eye(3))


def room_lines(rng: np.random.Generator, rooms: int = 2) -> LineScene:
    """Give the twelve edges of each of some rooms side by side: three directions."""
    points, directions = [], []
    low = 0.0
    for _ in range(rooms):
        size = rng.uniform([3.0, 3.0, 2.4], [5.0, 5.0, 3.0])
        for axis in range(3):
            others = [k for k in range(3) if k != axis]
            for corner in ((0, 0), (0, 1), (1, 0), (1, 1)):
                point = 0.5 * size
                point[others] = np.array(corner) * size[others]
                points.append(point + np.array([low, 0.0, 0.0]))
                directions.append(np.eye(3)[axis])
        low += size[0] + 0.3
    return LineScene(np.array(points), np.array(directions))


def facade_lines(rng: np.random.Generator, count: int = 24) -> LineScene:
    """Draw upright and level lines of a facade of 20 x 8 m: all in one plane."""
    points = rng.uniform(-0.5, 0.5, size=(count, 3)) * [20.0, 0.0, 8.0]
    return LineScene(points, np.eye(3)[np.where(np.arange(count) % 2 == 0, 0, 2)])


def bridge_lines(rng: np.random.Generator) -> LineScene:
    """Draw 14 parallel girder edges over 30 m, and two lines of a pier."""
    girders = rng.uniform(-0.5, 0.5, size=(14, 3)) * [30.0, 4.0, 1.5]
    pier = np.array([[2.0, 1.0, -3.0], [2.0, 0.0, -1.5]])
    return LineScene(np.vstack([girders, pier]), np.eye(3)[[0] * 14 + [2, 1]])


LINE_SCENES: Mapping[str, Callable[[np.random.Generator], LineScene]] = MappingProxyType(
    {
        "axes 3": axis_lines,
        "generic 3": partial(generic_lines, count=3),
        "generic 8": partial(generic_lines, count=8),
        "generic 24": partial(generic_lines, count=24),
        "rooms 24": room_lines,
        "facade 24": facade_lines,
        "bridge 14+2": bridge_lines,
    }
)
"""Scenes of MATH 10 by name; each draws a new scene of its kind."""


def one_line_shifted(pair: ObservedPair, k: int, component: int, size: float) -> ObservedPair:
    """Give a pair with one error parameter (a1, a2, b1, b2) of the target line of correspondence k changed."""
    line = int(pair.correspondences[k, 0])
    anchors, directions, bases = pair.target.anchors.copy(), pair.target.directions.copy(), pair.target.bases.copy()
    change = size * bases[line, :, component % 2]
    if component < 2:
        bases[line, :, component % 2] -= size * directions[line]
        directions[line] += change
    else:
        anchors[line] += change
    return replace(pair, target=replace(pair.target, anchors=anchors, directions=directions, bases=bases))
