"""Where the edges of a scene run in a photo, whether they are seen or not."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Flags, Indices, Points, Scalars, Vectors2
from algorithms.geometry.cameras import Camera

NEAR_M = 0.02
"""What is nearer to the focal plane than this is cut off."""
RIM_POINTS = 65
"""Points along each side of the photo that tell how far its undistorted frame reaches."""


@dataclass(frozen=True, eq=False)
class EdgeSamples:
    """n points along edges, evenly spaced along each of them in the undistorted photo."""

    edges: Indices
    """(n,) numbers of the edges, ascending."""
    ideal: Vectors2
    """(n, 2) ideal pixels, inside the frame."""
    points: Points
    """(n, 3) the same points in the camera frame [m]."""

    def __getitem__(self, which: Flags) -> "EdgeSamples":
        """Select points by a mask."""
        return EdgeSamples(self.edges[which], self.ideal[which], self.points[which])


def sample_edges(edges: Array, world_from_camera: RigidTransform, camera: Camera, step_px: float) -> EdgeSamples:
    """Walk along edges through the photo.

    Parameters
    ----------
    edges
        (e, 2, 3) ends in the world [m].
    world_from_camera, camera
        Where the photo was taken from, and with what.
    step_px
        At most so far from one point to the next.
    """
    in_camera = world_from_camera.inv().apply(edges.reshape(-1, 3)).reshape(-1, 2, 3)
    numbers, ends = _cut_in_front(in_camera)
    ideal = camera.ideal_from_camera(ends.reshape(-1, 3)).reshape(-1, 2, 2)
    first, last = _cut_to_frame(ideal, camera)
    kept = last > first
    numbers, ends, ideal, first, last = numbers[kept], ends[kept], ideal[kept], first[kept], last[kept]
    lengths = np.linalg.norm(ideal[:, 1] - ideal[:, 0], axis=1) * (last - first)
    counts = np.ceil(lengths / step_px).astype(np.int64) + 1
    which = np.repeat(np.arange(len(counts)), counts)
    steps = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = first[which] + (last - first)[which] * steps / np.maximum(counts[which] - 1, 1)
    pixels = ideal[which, 0] + share[:, None] * (ideal[which, 1] - ideal[which, 0])
    # Evenly spaced in the photo is evenly spaced in 1/z, not in space.
    weights = np.column_stack([(1.0 - share) / ends[which, 0, 2], share / ends[which, 1, 2]])
    points = np.einsum("ni,nij->nj", weights / weights.sum(axis=1, keepdims=True), ends[which])
    samples = EdgeSamples(numbers[which], pixels, points)
    return samples[camera.within_reach(pixels)]


def _cut_in_front(edges: Array) -> tuple[Indices, Array]:
    """Cut edges (e, 2, 3) in the camera frame off behind the lens; the numbers (k,) and ends (k, 2, 3) of the rest."""
    numbers = np.flatnonzero(edges[:, :, 2].max(axis=1, initial=-np.inf) > 2.0 * NEAR_M)
    ends = edges[numbers].copy()
    for k in range(2):
        behind = ends[:, k, 2] < NEAR_M
        near, far = ends[behind, k], ends[behind, 1 - k]
        share = (NEAR_M - near[:, 2]) / (far[:, 2] - near[:, 2])
        ends[behind, k] = near + share[:, None] * (far - near)
    return numbers.astype(np.int64), ends


def _cut_to_frame(ideal: Array, camera: Camera) -> tuple[Scalars, Scalars]:
    """Give where edges (k, 2, 2) in ideal pixels enter and leave the box around the undistorted photo, 0..1 each.

    The way of Liang and Barsky (doi:10.1145/357332.357333); an edge that misses the box leaves before it enters.
    """
    along = np.linspace(0.0, 1.0, RIM_POINTS)
    box = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    rim = np.vstack([a + along[:, None] * (b - a) for a, b in zip(box, np.roll(box, -1, axis=0), strict=True)])
    undistorted = camera.ideal_from_image(rim * np.array([camera.width, camera.height]) - 0.5)
    low, high = undistorted.min(axis=0), undistorted.max(axis=0)
    start, run = ideal[:, 0], ideal[:, 1] - ideal[:, 0]
    first, last = np.zeros(len(ideal)), np.ones(len(ideal))
    for k in range(2):
        moves = np.abs(run[:, k]) > 1e-12
        safe = np.where(moves, run[:, k], 1.0)
        cuts = np.sort(np.column_stack([(low[k] - start[:, k]) / safe, (high[k] - start[:, k]) / safe]), axis=1)
        outside = ~moves & ((start[:, k] < low[k]) | (start[:, k] > high[k]))
        first = np.where(moves, np.maximum(first, cuts[:, 0]), np.where(outside, 1.0, first))
        last = np.where(moves, np.minimum(last, cuts[:, 1]), np.where(outside, 0.0, last))
    return first, last
