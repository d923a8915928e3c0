"""Stations whose scan and photos see one edge of two planes, with every error drawn from its own cause.

The scan's planes are adjusted from points beside the edge and from others; the lines of photos are cut with a surface
that was adjusted from those beside the edge alone. So scan and photos have errors in common.
"""

from dataclasses import dataclass, replace

import numpy as np

from algorithms.features.photo_lines.projected_edges import ProjectedEdges
from algorithms.geometry.covariances import intersection_jacobians
from algorithms.geometry.line_differences import lines_moved
from algorithms.geometry.lines import Lines, LineSource, bases_of, lines_from_arrays


@dataclass(frozen=True)
class DrawnStation:
    """What a station recorded of one edge."""

    true: Lines
    cloud: Lines
    parts: list[ProjectedEdges]
    mounts: list[np.ndarray]
    planes: np.ndarray
    """(2, 3, 3) covariances of the scan's planes."""


def drawn_station(
    rng: np.random.Generator,
    photos: int,
    *,
    seen: bool = True,
    mount_std: tuple[float, float] = (2e-4, 1e-3),
    mount_error: np.ndarray | None = None,
) -> DrawnStation:
    """Draw an edge 5 to 15 m away, planes at 20 to 86 degrees, and everybody's errors; `seen`: the scan has it."""
    along = _unit(rng.normal(size=3))
    anchor = _unit(np.cross(rng.normal(size=3), along)) * rng.uniform(5.0, 15.0)
    away, side = _unit(anchor), np.cross(_unit(anchor), along)
    turn = rng.uniform(-0.5, 0.5)
    surface = np.cos(turn) * away + np.sin(turn) * side
    turn += rng.uniform(0.35, 1.5)
    other = np.cos(turn) * away + np.sin(turn) * side
    normals = np.stack([surface, other])
    near = [_plane_covariance(rng) for _ in range(2)]
    far = [_plane_covariance(rng) for _ in range(2)]
    errors_near = [rng.multivariate_normal(np.zeros(3), c) for c in near]
    errors_far = [rng.multivariate_normal(np.zeros(3), c) for c in far]
    planes = np.stack([np.linalg.inv(np.linalg.inv(a) + np.linalg.inv(b)) for a, b in zip(near, far, strict=True)])
    errors = [
        planes[k] @ (np.linalg.solve(near[k], errors_near[k]) + np.linalg.solve(far[k], errors_far[k]))
        for k in range(2)
    ]
    bases, by_planes = _cut(anchor, along, normals[0], normals[1])
    cloud_covariance = sum(
        by_planes[:, 3 * k : 3 * k + 3] @ planes[k] @ by_planes[:, 3 * k : 3 * k + 3].T for k in (0, 1)
    )
    true = _line(anchor, along, np.asarray(cloud_covariance), bases)
    moved = lines_moved(true, (by_planes @ np.concatenate(errors))[None])
    cloud = lines_from_arrays(
        moved.anchors, moved.directions, moved.covariances, moved.extents, bases=moved.bases,
        parents=np.array([[0, 1]]), parent_jacobians=by_planes[None],
    )  # fmt: skip
    mount = np.diag([mount_std[0] ** 2] * 3 + [mount_std[1] ** 2] * 3)
    parts = []
    for _ in range(photos):
        centre = rng.normal(size=3) * 0.2
        place = anchor + rng.uniform(-0.5, 0.5) * along
        k = int(rng.integers(2))
        if abs(normals[k] @ _unit(place - centre)) < np.sin(0.3):
            k = 0  # the other surface contains the ray, nearly
        error = rng.multivariate_normal(np.zeros(6), mount) if mount_error is None else mount_error
        parts.append(_photo(rng, place, along, centre, normals[k], near[k], errors_near[k], error))
    return DrawnStation(true, cloud if seen else cloud[:0], parts, [mount] * photos, planes)


def _photo(rng, place, along, centre, surface, covariance, surface_error, mount_error):
    """A line cut from a projecting plane through the camera's centre and a surface."""
    projecting = _unit(np.cross(place - centre, along))
    basis = bases_of(projecting[None])[0]
    bases, jacobian = _cut(place, along, projecting, surface, first_point=centre)
    by_edge = jacobian[:, :2]
    root = np.diag(rng.uniform(0.5e-4, 2e-4, 2)) @ (np.eye(2) + 0.3 * rng.normal(size=(2, 2)))
    edge_covariance = by_edge @ root @ root.T @ by_edge.T
    surface_covariance = jacobian[:, 3:] @ covariance @ jacobian[:, 3:].T
    by_pose = np.zeros((3, 6))
    by_pose[:2, :3] = np.cross(projecting[None], basis.T)
    by_pose[2, 3:] = projecting
    by_mount = jacobian[:, :3] @ by_pose
    error = by_edge @ root @ rng.normal(size=2) + jacobian[:, 3:] @ surface_error + by_mount @ mount_error
    true = _line(place, along, edge_covariance + surface_covariance, bases)
    moved = lines_moved(true, error[None])
    lines = lines_from_arrays(
        moved.anchors, moved.directions, moved.covariances, moved.extents, bases=moved.bases,
        sources=np.full(1, LineSource.PHOTO_EDGE, dtype=np.int32),
    )  # fmt: skip
    none = np.empty(0, dtype=np.int64)
    return ProjectedEdges(
        lines, np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int32), -surface[None], by_mount[None],
        surface_covariance[None], none, none.astype(np.int32),
    )  # fmt: skip


def _cut(anchor, along, first, second, first_point=None):
    """Basis of the line and its derivatives by the two planes' (a1, a2, b)."""
    points = [anchor if first_point is None else first_point, anchor]
    bases, jacobians = intersection_jacobians(
        anchor[None], along[None], first[None], points[0][None], bases_of(first[None]),
        second[None], points[1][None], bases_of(second[None]),
    )  # fmt: skip
    return bases, jacobians[0]


def _line(anchor, along, covariance, bases):
    return lines_from_arrays(anchor[None], along[None], covariance[None], np.array([[-1.0, 1.0]]), bases=bases)


def _plane_covariance(rng):
    root = np.diag(rng.uniform(1e-4, 6e-4, 3)) @ (np.eye(3) + 0.3 * rng.normal(size=(3, 3)))
    return root @ root.T


def _unit(vector):
    return vector / np.linalg.norm(vector)


@dataclass(frozen=True)
class DrawnRoom:
    """Many edges seen by a scan and one photo."""

    true: Lines
    cloud: Lines
    part: ProjectedEdges
    mount: np.ndarray
    planes: np.ndarray
    """(p, 3, 3)."""


def drawn_room(
    rng: np.random.Generator,
    edges: int,
    *,
    mount_std: tuple[float, float] = (2e-4, 1e-3),
    mount_error: np.ndarray | None = None,
    wrong: int = 0,
) -> DrawnRoom:
    """Draw edges all around, each of two planes of its own, and one error of the camera's mount.

    Of `wrong` further edges the photo shows something else, 20 to 40 mm beside.
    """
    mount = np.diag([mount_std[0] ** 2] * 3 + [mount_std[1] ** 2] * 3)
    error = rng.multivariate_normal(np.zeros(6), mount) if mount_error is None else mount_error
    stations = [drawn_station(rng, 1, mount_std=mount_std, mount_error=error) for _ in range(edges + wrong)]
    clouds, parts = [station.cloud for station in stations], [station.parts[0] for station in stations]
    for k in range(edges, edges + wrong):
        beside = np.concatenate([np.zeros(2), rng.uniform(0.02, 0.04, 2) * rng.choice([-1.0, 1.0], 2)])[None]
        parts[k] = replace(parts[k], lines=lines_moved(parts[k].lines, beside))
    parents = np.arange(2 * len(stations), dtype=np.int64).reshape(-1, 2)
    cloud = replace(_joined(clouds), parents=parents)
    part = ProjectedEdges(
        _joined([one.lines for one in parts]),
        np.arange(len(parts), dtype=np.int64),
        *(
            np.concatenate([getattr(one, name) for one in parts])
            for name in ("kinds", "plane_normals", "mount_jacobians", "surface_covariances")
        ),
        parts[0].rejected_numbers,
        parts[0].rejected_reasons,
    )
    return DrawnRoom(
        _joined([station.true for station in stations]),
        cloud,
        part,
        mount,
        np.concatenate([station.planes for station in stations]),
    )


def _joined(many: list[Lines]) -> Lines:
    names = ("anchors", "directions", "bases", "covariances", "extents", "sources", "parents", "parent_jacobians")
    return Lines(*(np.concatenate([getattr(lines, name) for lines in many]) for name in names))
