"""Rooms with boxes whose edges a scan measures and photos show, drawn without points or pixels."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.calibration.edge_images import EdgePhoto, StationEdges, moved_mounts
from algorithms.geometry.covariances import intersection_jacobians
from algorithms.geometry.line_differences import lines_moved
from algorithms.geometry.lines import bases_of, lines_from_arrays
from algorithms.photos.segments import ImageSegments
from tests.scenes.photos.photo_scenes import CAMERA, looking, segments_of

HALF_M = np.array([6.0, 5.0, 2.5])
PLANE_STD = (2e-5, 2e-5, 2e-4)
"""Of tilts [rad] and offset [m] of the planes of a scan."""


@dataclass(frozen=True, eq=False)
class EdgeRoom:
    """What was measured, and the truth."""

    stations: list[StationEdges]
    photos: list[EdgePhoto]
    error: np.ndarray
    """(6,) of the stated mount: stated pose times Δ(error) is the true one."""


def edge_room(
    rng: np.random.Generator,
    *,
    error: np.ndarray,
    boxes: int = 6,
    photos: int = 3,
    clutter: int = 200,
    beside: int = 1,
    std_px: float = 0.3,
) -> EdgeRoom:
    """Draw a room with boxes, a scan and photos of it.

    Parameters
    ----------
    rng
        Of everything.
    error
        (6,) error of the mount, of all photos.
    boxes
        Besides the room itself.
    photos
        Taken at regular turns of the head.
    clutter
        Edges of each photo that no line of the scan explains.
    beside
        Parallel edges beside each right one, 4 to 25 pixels off, as of frames.
    std_px
        Of single points of edges.
    """
    corners = [(np.zeros(3), HALF_M, Rotation.identity())]
    for _ in range(boxes):
        size = rng.uniform([0.3, 0.3, 0.3], [0.9, 0.9, 1.2])
        middle = np.append(rng.uniform(-3.5, 3.5, 2), size[2] - HALF_M[2])
        middle[:2] += 2.0 * np.sign(middle[:2])
        corners.append((middle, size, Rotation.from_rotvec([0.0, 0.0, rng.uniform(0.0, 3.0)])))
    anchors, directions, halves, normals, parents = [], [], [], [], []
    for middle, half, turn in corners:
        first = len(normals)
        axes = turn.as_matrix()
        normals += [sign * axes[:, k] for k in range(3) for sign in (-1.0, 1.0)]
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            for a in (0, 1):
                for b in (0, 1):
                    place = half[i] * (2 * a - 1) * axes[:, i] + half[j] * (2 * b - 1) * axes[:, j]
                    anchors.append(middle + place)
                    directions.append(axes[:, k])
                    halves.append(half[k])
                    parents.append((first + 2 * i + a, first + 2 * j + b))
    anchors, directions, halves, normals, parents = map(np.array, (anchors, directions, halves, normals, parents))
    covariances = np.broadcast_to(np.diag(np.square(PLANE_STD)), (len(normals), 3, 3)).copy()
    ours, theirs = parents.T
    bases, by_planes = intersection_jacobians(
        anchors, directions, normals[ours], anchors, bases_of(normals[ours]), normals[theirs], anchors,
        bases_of(normals[theirs]),
    )  # fmt: skip
    wrong = rng.multivariate_normal(np.zeros(3), covariances[0], len(normals))
    true = lines_from_arrays(
        anchors, directions, _through(by_planes, covariances, parents), np.column_stack([-halves, halves]), bases=bases,
        parents=parents, parent_jacobians=by_planes,
    )  # fmt: skip
    moved = lines_moved(true, np.einsum("nij,nj->ni", by_planes, wrong[parents].reshape(len(parents), 6)))
    scanned = replace(true, anchors=moved.anchors, directions=moved.directions, bases=moved.bases)
    taken = []
    for number in range(photos):
        pose = looking(2.0 * np.pi * number / max(photos, 1) + 0.2)
        stated = pose * moved_mounts(RigidTransform.identity(), error).inv()
        segments = _segments(true.end_points, pose, rng, clutter, beside, std_px)
        taken.append(EdgePhoto(0, 0, segments, CAMERA, stated))
    return EdgeRoom([StationEdges(scanned, covariances)], taken, error)


def _through(by_planes, covariances, parents):
    joint = np.zeros((len(parents), 6, 6))
    joint[:, :3, :3], joint[:, 3:, 3:] = covariances[parents[:, 0]], covariances[parents[:, 1]]
    return by_planes @ joint @ np.swapaxes(by_planes, 1, 2)


def _segments(ends, pose, rng, clutter, beside, std_px) -> ImageSegments:
    """Project what lies in front of the camera within its photo, and add what shows something else."""
    starts, stops = (pose.inv().apply(points) for points in ends)
    shares = np.linspace(0.0, 1.0, 60)
    points = starts[:, None] + shares[:, None] * (stops - starts)[:, None]
    flat = points.reshape(-1, 3)
    images = CAMERA.ideal_from_camera(np.where(flat[:, 2:] > 0.1, flat, [0.0, 0.0, 1.0]))
    shown = ((flat[:, 2] > 0.1) & CAMERA.inside(images)).reshape(points.shape[:2])
    from_m, to_m = [], []
    for row in np.flatnonzero(shown.sum(axis=1) > 8):
        places = np.flatnonzero(shown[row])
        from_m.append(points[row, places[0]])
        to_m.append(points[row, places[-1]])
    true = segments_of(from_m, to_m, CAMERA, RigidTransform.identity(), rng, std_px)
    parts = [true]
    for _ in range(beside):
        off = rng.uniform(4.0, 25.0, len(true)) * rng.choice([-1.0, 1.0], len(true))
        parts.append(replace(true, centres=true.centres + off[:, None] * true.normals))
    places = rng.uniform([0.0, 0.0], [CAMERA.width, CAMERA.height], (clutter, 2))
    angles, lengths = rng.uniform(0.0, np.pi, clutter), rng.uniform(30.0, 300.0, clutter)
    angles = np.where(
        rng.random(clutter) < 0.5, np.round(angles / (np.pi / 2)) * np.pi / 2 + rng.normal(0, 0.02), angles
    )
    along = np.column_stack([np.cos(angles), np.sin(angles)])
    parts.append(
        replace(
            true,
            centres=places, directions=along, extents=np.column_stack([-lengths, lengths]) / 2.0,
            covariances=_covariances(lengths, std_px),
            contrasts=np.full(clutter, 40.0), widths_px=np.full(clutter, 0.7),
            point_counts=lengths.astype(np.int64), raw_ends=np.stack([places, places], axis=1),
            composite=np.zeros(clutter, dtype=bool),
        )
    )  # fmt: skip
    return ImageSegments(**{
        name: np.concatenate([getattr(part, name) for part in parts]) for name in ImageSegments.__dataclass_fields__
    })  # fmt: skip


def _covariances(lengths, std_px):
    return np.stack([np.diag([12.0 * std_px**2 / n**3, std_px**2 / n]) for n in lengths]).reshape(-1, 2, 2)
