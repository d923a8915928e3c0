"""Rooms of noisy planes seen in two scans, and the lines in which they meet, correlated as extraction gives them."""

from dataclasses import dataclass, fields, replace
from itertools import combinations

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.observations.plane_plane import PlanePlane
from algorithms.geometry.covariances import intersection_covariances, intersection_jacobians, intersection_lines
from algorithms.geometry.lines import Lines, LineSource, lines_from_arrays
from algorithms.geometry.planes import Planes
from tests.scenes.lines.line_scenes import NOISE_M, LineScene, ObservedPair, observed_lines, random_motion, rough

POINTS_PER_M2 = 50.0
SEEN_SHARES = (0.6, 1.0)
"""Smallest and largest share of each side of a plane that one scan sees."""
PIECE_SHARES = (0.4, 0.9)
"""Smallest and largest share of an edge that one scan sees."""
STEEPEST_CEILING_RAD = 0.35


@dataclass(frozen=True, eq=False)
class PlaneRooms:
    """True bounded planes and the edges where two of them meet, in the source scan's frame."""

    normals: np.ndarray
    """(p, 3) towards the air."""
    middles: np.ndarray
    """(p, 3) middles of rectangles [m]."""
    axes: np.ndarray
    """(p, 3, 2) directions of the sides; (first, second, normal) right-handed."""
    sizes: np.ndarray
    """(p, 2) lengths of the sides [m]."""
    matched: np.ndarray
    """(p,) True where the plane itself is an observation, not only its edges."""
    edges: np.ndarray
    """(m, 2) numbers of the planes that meet."""
    edge_middles: np.ndarray
    """(m, 3) near the middle of the edge [m]."""
    edge_lengths: np.ndarray
    """(m,) [m]."""

    def with_edges(self, which: np.ndarray) -> "PlaneRooms":
        """Keep some of the edges, and all planes."""
        return replace(
            self,
            edges=self.edges[which],
            edge_middles=self.edge_middles[which],
            edge_lengths=self.edge_lengths[which],
        )

    def with_plane_moved(self, plane: int, shift_m: float) -> "PlaneRooms":
        """Move one plane along its normal."""
        middles = self.middles.copy()
        middles[plane] += shift_m * self.normals[plane]
        return replace(self, middles=middles)

    def with_edge_elsewhere(self, edge: int, end: int, shift_m: float, turn_rad: float = 0.0) -> "PlaneRooms":
        """Let one of an edge's planes be another one, shifted along its normal and turned so that the edge turns."""
        plane, kept = int(self.edges[edge, end]), int(self.edges[edge, 1 - end])
        across = np.cross(self.normals[plane], np.cross(self.normals[plane], self.normals[kept]))
        turn = Rotation.from_rotvec(turn_rad * across / np.linalg.norm(across))
        middle = self.edge_middles[edge] + turn.apply(self.middles[plane] - self.edge_middles[edge])
        edges = self.edges.copy()
        edges[edge, end] = len(self.normals)
        return replace(
            self,
            normals=np.vstack([self.normals, turn.apply(self.normals[plane])]),
            middles=np.vstack([self.middles, middle + shift_m * self.normals[plane]]),
            axes=np.concatenate([self.axes, turn.apply(self.axes[plane].T).T[None]]),
            sizes=np.vstack([self.sizes, self.sizes[plane]]),
            matched=np.append(self.matched, False),
            edges=edges,
        )


class _Boxes:
    """Collects the faces and edges of boxes."""

    def __init__(self) -> None:
        self.faces: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = []
        """Normal, middle, axes, sizes."""
        self.edges: list[tuple[int, int]] = []
        self.edge_middles: list[np.ndarray] = []
        self.edge_lengths: list[float] = []

    def add_face(self, low: np.ndarray, size: np.ndarray, turn: Rotation, face: int, sense: float) -> int:
        """Add face 2 axis + side of a box; sense 1 looks outwards, -1 inwards."""
        axis, side = divmod(face, 2)
        normal = sense * (2.0 * side - 1.0) * np.eye(3)[axis]
        first, second = (axis + 1) % 3, (axis + 2) % 3
        local = np.stack([normal[axis] * np.eye(3)[first], np.eye(3)[second]], axis=1)
        middle = low + 0.5 * size + turn.apply((side - 0.5) * size[axis] * np.eye(3)[axis])
        self.faces.append((turn.apply(normal), middle, turn.apply(local.T).T, size[[first, second]]))
        return len(self.faces) - 1

    def add(self, low: np.ndarray, size: np.ndarray, turn: Rotation, shared: dict[int, int], sense: float) -> None:
        """Add a box; `shared` gives the numbers of faces that exist already."""
        numbers = [shared[face] if face in shared else self.add_face(low, size, turn, face, sense) for face in range(6)]
        for face, other in combinations(range(6), 2):
            if face // 2 == other // 2:
                continue
            out = np.zeros(3)
            for number in (face, other):
                out[number // 2] = (number % 2 - 0.5) * size[number // 2]
            self.edges.append((numbers[face], numbers[other]))
            self.edge_middles.append(low + 0.5 * size + turn.apply(out))
            self.edge_lengths.append(float(size[3 - face // 2 - other // 2]))


def plane_rooms(
    rng: np.random.Generator, *, lines: int = 24, rooms: int = 2, bodies: int = 2, matched_share: float = 0.8
) -> PlaneRooms:
    """Build rooms in a row that share floor and slanting ceiling, with pieces of furniture on the floor.

    Parameters
    ----------
    rng
        Of all randomness.
    lines
        How many of the edges are seen: at most 12 for each room and each body.
    rooms, bodies
        Number of rooms and of bodies (a door leaf, a cupboard).
    matched_share
        Share of the planes that are observations themselves.
    """
    height, upright = rng.uniform(2.5, 3.0), Rotation.identity()
    sizes = np.column_stack([rng.uniform(3.0, 5.0, size=(rooms, 2)), np.full(rooms, height)])
    starts = np.concatenate([[0.0], np.cumsum(sizes[:-1, 0] + 0.3)])
    whole = np.array([starts[-1] + sizes[-1, 0], sizes[:, 1].max(), height])
    boxes = _Boxes()
    floor, ceiling = (boxes.add_face(np.zeros(3), whole, upright, face, -1.0) for face in (4, 5))
    for start, size in zip(starts, sizes, strict=True):
        boxes.add(np.array([start, 0.0, 0.0]), size, upright, {4: floor, 5: ceiling}, -1.0)
    for _ in range(bodies):
        size = rng.uniform([0.6, 0.4, 0.8], [2.0, 1.0, 2.0])
        low = np.append(rng.uniform(0.2, 0.7, size=2) * whole[:2], 0.0)
        boxes.add(low, size, Rotation.from_rotvec([0.0, 0.0, rng.uniform(0.0, 3.0)]), {4: floor}, 1.0)
    normals, middles, axes, spans = (np.array(values) for values in zip(*boxes.faces, strict=True))
    tilt = Rotation.from_rotvec([0.0, rng.uniform(0.0, STEEPEST_CEILING_RAD), 0.0])
    normals[ceiling], axes[ceiling] = tilt.apply(normals[ceiling]), tilt.apply(axes[ceiling].T).T
    all_edges = PlaneRooms(
        normals,
        middles,
        axes,
        spans,
        rng.random(len(normals)) < matched_share,
        np.array(boxes.edges, dtype=np.int64),
        np.array(boxes.edge_middles),
        np.array(boxes.edge_lengths),
    )
    return all_edges.with_edges(np.sort(rng.choice(len(boxes.edges), size=lines, replace=False)))


def observed_rooms(
    rooms: PlaneRooms,
    rng: np.random.Generator,
    *,
    noise_m: float = NOISE_M,
    source_rooms: PlaneRooms | None = None,
    pipes: LineScene | None = None,
    source_pipes: LineScene | None = None,
) -> ObservedPair:
    """See rooms from two scans: planes with the noise of their fits, lines from the noisy planes, and pipes.

    Correspondence k is edge k; those of the pipes follow. Planes come in another order in each scan.

    Parameters
    ----------
    rooms
        What the target scan sees.
    rng
        Of all randomness.
    noise_m
        Standard deviation of points.
    source_rooms
        What the source scan sees: the same edges, the same planes and perhaps more; left out, the same rooms.
    pipes, source_pipes
        Lines that lie in no plane, as both scans see them.
    """
    pose = random_motion(rng)
    seen = rooms if source_rooms is None else source_rooms
    piping = LineScene(np.empty((0, 3)), np.empty((0, 3))) if pipes is None else pipes
    target_numbers, source_numbers = rng.permutation(len(rooms.normals)), rng.permutation(len(seen.normals))
    target, target_planes = seen_from(rooms, piping, pose, target_numbers, noise_m, rng)
    source_piping = piping if source_pipes is None else source_pipes
    source, source_planes = seen_from(seen, source_piping, RigidTransform.identity(), source_numbers, noise_m, rng)
    matched = np.flatnonzero(rooms.matched)
    plane_pairs = np.stack([target_numbers[matched], source_numbers[matched]], axis=1).astype(np.int64)
    pairs = np.repeat(np.arange(len(target), dtype=np.int64)[:, None], 2, axis=1)
    return ObservedPair(
        target, source, pairs, pose, rough(pose, rng), PlanePlane(target_planes, source_planes, plane_pairs)
    )


def seen_from(
    rooms: PlaneRooms,
    pipes: LineScene,
    pose: RigidTransform,
    numbers: np.ndarray,
    noise_m: float,
    rng: np.random.Generator,
) -> tuple[Lines, Planes]:
    """See planes and lines from one scan; plane k of the rooms gets number numbers[k]."""
    order = np.argsort(numbers)
    planes = _observed_planes(rooms, pose, order, noise_m, rng)
    i, j = numbers[rooms.edges].T
    points, directions = intersection_lines(
        planes.normals[i], planes.centroids[i], planes.normals[j], planes.centroids[j]
    )
    lengths = rooms.edge_lengths * rng.uniform(*PIECE_SHARES, size=len(i))
    middles = pose.apply(rooms.edge_middles)
    along = np.einsum("ij,ij->i", middles - points, directions)
    along += rng.uniform(-0.5, 0.5, size=len(i)) * (rooms.edge_lengths - lengths)
    anchors = points + along[:, None] * directions
    bases, jacobians = intersection_jacobians(
        anchors, directions,
        planes.normals[i], planes.centroids[i], planes.bases[i],
        planes.normals[j], planes.centroids[j], planes.bases[j],
    )  # fmt: skip
    edges = lines_from_arrays(
        anchors,
        directions,
        intersection_covariances(jacobians, planes.covariances[i], planes.covariances[j]),
        0.5 * lengths[:, None] * np.array([-1.0, 1.0]),
        bases=bases,
        parents=np.stack([i, j], axis=1).astype(np.int64),
        parent_jacobians=jacobians,
    )
    if len(pipes) == 0:
        return edges, planes
    tubes = observed_lines(pose.apply(pipes.points), pose.rotation.apply(pipes.directions), rng, noise_m, fitted=False)
    tubes = replace(tubes, sources=np.full(len(tubes), LineSource.CYLINDER_AXIS, dtype=np.int32))
    columns = [(getattr(edges, f.name), getattr(tubes, f.name)) for f in fields(Lines)]
    return Lines(*(None if column[0] is None else np.concatenate(column) for column in columns)), planes


def _observed_planes(
    rooms: PlaneRooms, pose: RigidTransform, order: np.ndarray, noise_m: float, rng: np.random.Generator
) -> Planes:
    """See a part of each plane; covariance sigma²/n diag(1/var u, 1/var v, 1) of evenly spread points."""
    count = len(order)
    rotation = pose.rotation.as_matrix()
    normals, axes = rooms.normals[order] @ rotation.T, rotation @ rooms.axes[order]
    sizes = rooms.sizes[order]
    spans = sizes * rng.uniform(*SEEN_SHARES, size=(count, 2))
    places = rng.uniform(-0.5, 0.5, size=(count, 2)) * (sizes - spans)
    centroids = pose.apply(rooms.middles[order]) + np.einsum("nij,nj->ni", axes, places)
    points = np.maximum(np.rint(POINTS_PER_M2 * spans.prod(axis=1)), 20.0)
    std = noise_m / np.sqrt(points[:, None] * np.column_stack([spans**2 / 12.0, np.ones(count)]))
    errors = std * rng.normal(size=(count, 3))
    centroids = centroids + normals * errors[:, 2:]
    noisy = normals + np.einsum("nij,nj->ni", axes, errors[:, :2])
    noisy /= np.linalg.norm(noisy, axis=1, keepdims=True)
    first = axes[:, :, 0] - noisy * np.einsum("ni,ni->n", axes[:, :, 0], noisy)[:, None]
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    corners = 0.5 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    return Planes(
        normals=noisy,
        centroids=centroids,
        bases=np.stack([first, np.cross(noisy, first)], axis=2),
        covariances=std[:, :, None] ** 2 * np.eye(3),
        noise_std_m=np.full(count, noise_m),
        point_counts=points.astype(np.int64),
        areas_m2=spans.prod(axis=1),
        boundary=(corners[None] * spans[:, None, :]).reshape(-1, 2),
        boundary_splits=np.arange(0, 4 * count + 1, 4, dtype=np.int64),
    )
