"""Edges of scans in photos: where the intersection of two planes should appear, and how far the photo's edge is off.

With T the stated pose of the camera in the scan's frame and m = (rotation vector, translation) in the camera's axes,
the true pose is T Δ(m), and a point X of the scan's line is seen at q = Δ(m)⁻¹ T⁻¹ X. Its image is compared with the
two ends of the photo's edge, across the edge, at those points of the line whose images lie beside the ends (MATH 2.10).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Array, Points, Vectors2
from algorithms.features.photo_lines.same_lines import rounding_covariances
from algorithms.geometry.cameras import Camera
from algorithms.geometry.lines import Lines
from algorithms.geometry.rotations import cross_matrices
from algorithms.photos.segments import ImageSegments

LEAST_DEPTH_M = 0.1
"""What is nearer to the camera's focal plane has no image to compare."""
LEAST_OVERLAP = 0.3
"""Share of the photo's edge along which the scan must have seen its line."""
LONGER = 0.5
"""The photo's edge may exceed the seen piece of the line by this share of its length: scans lose the ends."""
MAX_ANGLE_RAD = np.radians(4.0)
"""Largest angle in the photo between edge and line; errors of the mount turn images by less."""


@dataclass(frozen=True, eq=False)
class StationEdges:
    """What a scan says of its edges."""

    lines: Lines
    """In the frame of the scan, reduced; only intersections of planes."""
    plane_covariances: Float64[Array, "p 3 3"]
    """(p, 3, 3) of the planes that `Lines.parents` counts, (a1, a2, b)."""


@dataclass(frozen=True, eq=False)
class EdgePhoto:
    """A photo of a station."""

    station: int
    """Number of its station."""
    mount: int
    """Number of its mount: photos of one camera on one scanner share it."""
    segments: ImageSegments
    camera: Camera
    scan_from_camera: RigidTransform
    """As stated, in the reduced frame of the scan."""


@dataclass(frozen=True, eq=False)
class EdgePairs:
    """n pairs of a line of a scan and an edge of a photo, whatever the mount."""

    photos: Int64[Array, "n"]
    """(n,) number of the photo."""
    lines: Int64[Array, "n"]
    """(n,) number of the line in its station."""
    segments: Int64[Array, "n"]
    """(n,) number of the edge in its photo."""

    def __len__(self) -> int:
        return len(self.photos)

    def __getitem__(self, which: Array) -> "EdgePairs":
        return EdgePairs(self.photos[which], self.lines[which], self.segments[which])


@dataclass(frozen=True, eq=False)
class EdgeGaps:
    """How far n pairs are apart with certain mounts."""

    values: Float64[Array, "n 2"]
    """(n, 2) image of the line minus edge, across the edge at its two ends [px]."""
    by_mount: Float64[Array, "n 2 6"]
    """(n, 2, 6) derivatives by (rotation vector, translation) in the camera's axes [px/rad, px/m]."""
    by_line: Float64[Array, "n 2 4"]
    """(n, 2, 4) derivatives by the line's (a1, a2, b1, b2)."""


def moved_mounts(stated: RigidTransform, error: Array) -> RigidTransform:
    """Give T Δ(m) for a mount's (6,) correction m in the camera's axes."""
    return stated * RigidTransform.from_components(error[3:], Rotation.from_rotvec(error[:3]))


def near_edges(edges: StationEdges, photo: EdgePhoto, number: int, reach_px: Array) -> EdgePairs:
    """Pair the lines of a scan with the edges of a photo that may show them.

    Parameters
    ----------
    edges
        Of the station.
    photo
        Of that station.
    number
        Its number, which the pairs get.
    reach_px
        (lines,) largest gap [px].
    """
    ends = _seen_pieces(edges.lines, photo)
    found = [np.zeros((0, 2), dtype=np.int64)]
    segments = photo.segments
    for line in np.flatnonzero(np.isfinite(ends[:, 0, 0])).tolist():
        start, end = ends[line]
        length = float(np.linalg.norm(end - start))
        along = (end - start) / max(length, 1e-9)
        cosines = np.abs(segments.directions @ along)
        across = np.abs((segments.ends - start) @ np.array([-along[1], along[0]]))
        places = np.sort((segments.ends - start) @ along, axis=1)
        common = np.minimum(places[:, 1], length) - np.maximum(places[:, 0], 0.0)
        fits = (cosines > np.cos(MAX_ANGLE_RAD)) & (across.max(axis=1) < reach_px[line])
        fits &= (common > LEAST_OVERLAP * segments.lengths) & (segments.lengths < (1.0 + LONGER) * length)
        chosen = np.flatnonzero(fits & ~segments.composite)
        found.append(np.column_stack([np.full(len(chosen), line), chosen]))
    pairs = np.concatenate(found)
    return EdgePairs(np.full(len(pairs), number, dtype=np.int64), pairs[:, 0], pairs[:, 1])


def _seen_pieces(lines: Lines, photo: EdgePhoto) -> Float64[Array, "n 2 2"]:
    """Give the images (n, 2, 2) of the seen pieces within the photo, NaN where there is none."""
    camera, inside = photo.camera, photo.scan_from_camera.inv()
    found = np.full((len(lines), 2, 2), np.nan)
    if len(lines) == 0:
        return found
    steps = np.linspace(0.0, 1.0, 41)
    starts, ends = lines.end_points
    points = starts[:, None] + steps[:, None] * (ends - starts)[:, None]
    seen = inside.apply(points.reshape(-1, 3))
    shown = (seen[:, 2] > LEAST_DEPTH_M) & camera.projectable(seen)
    ideal = np.full((len(seen), 2), np.nan)
    ideal[shown] = camera.ideal_from_camera(seen[shown])
    shown[shown] = camera.inside(camera.image_from_ideal(ideal[shown]))
    images, flags = ideal.reshape(len(lines), -1, 2), shown.reshape(len(lines), -1)
    for k in np.flatnonzero(flags.sum(axis=1) > 1).tolist():
        places = np.flatnonzero(flags[k])
        found[k] = images[k, [places[0], places[-1]]]
    return found


def edge_gaps(
    stations: Sequence[StationEdges],
    photos: Sequence[EdgePhoto],
    pairs: EdgePairs,
    errors: Float64[Array, "mounts 6"],
) -> EdgeGaps:
    """Compare lines and edges with corrected mounts.

    Parameters
    ----------
    stations, photos
        What was seen.
    pairs
        Which are compared.
    errors
        (mounts, 6) corrections m of the stated mounts.
    """
    n = len(pairs)
    values, by_mount, by_line = np.zeros((n, 2)), np.zeros((n, 2, 6)), np.zeros((n, 2, 4))
    for number in np.unique(pairs.photos).tolist():
        rows = np.flatnonzero(pairs.photos == number)
        photo = photos[number]
        pose = moved_mounts(photo.scan_from_camera, errors[photo.mount])
        lines = stations[photo.station].lines[pairs.lines[rows]]
        segments = photo.segments[pairs.segments[rows]]
        into = pose.inv()
        anchors, directions = into.apply(lines.anchors), into.rotation.apply(lines.directions)
        bases = np.einsum("ij,njk->nik", into.rotation.as_matrix(), lines.bases)
        for end in range(2):
            found = _gaps_at(photo.camera, segments, segments.ends[:, end], anchors, directions)
            values[rows, end] = found[0]
            by_point, points, places = found[1:]
            # q = Δ⁻¹ p: a turn w moves it by -w × q, a shift by -d
            by_mount[rows, end, :3] = np.einsum("ni,nij->nj", by_point, cross_matrices(points))
            by_mount[rows, end, 3:] = -by_point
            across = np.einsum("ni,nij->nj", by_point, bases)
            by_line[rows, end, :2] = across * places[:, None]
            by_line[rows, end, 2:] = across
    return EdgeGaps(values, by_mount, by_line)


def _gaps_at(
    camera: Camera, segments: ImageSegments, ends: Vectors2, anchors: Points, directions: Points
) -> tuple[Array, Array, Array, Array]:
    """Give gaps [px], derivatives (n, 3) by the point [px/m], the points (n, 3) and their places on the lines [m]."""
    along, normals = segments.directions, segments.normals
    scale, centre = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    # the plane through the projection centre and the perpendicular to the edge at its end
    planes = np.column_stack([along * scale, np.einsum("ni,ni->n", along, centre - ends)])
    places = -np.einsum("ni,ni->n", planes, anchors) / _apart(np.einsum("ni,ni->n", planes, directions))
    points = anchors + places[:, None] * directions
    depth = np.maximum(points[:, 2], LEAST_DEPTH_M)
    images = points[:, :2] / depth[:, None] * scale + centre
    gaps = np.einsum("ni,ni->n", normals, images - ends)
    across = normals * scale / depth[:, None]
    by_point = np.column_stack([across, -np.einsum("ni,ni->n", across, points[:, :2]) / depth])
    # the point beside the edge's end moves along the line as well, which counts where both are not quite parallel
    moved = np.einsum("ni,ni->n", by_point, directions) / _apart(np.einsum("ni,ni->n", planes, directions))
    return gaps, by_point - moved[:, None] * planes, points, places


def _apart(values: Array) -> Array:
    return np.where(np.abs(values) < 1e-9, 1e-9, values)


def line_noise(stations: Sequence[StationEdges], rounding_std_m: float) -> list[Array]:
    """Give for every station the (n, 4, 4) covariance of how far real edges lie from where their planes meet."""
    return [
        rounding_covariances(each.lines.lengths, each.lines.extents.mean(axis=1), rounding_std_m) for each in stations
    ]
