"""Lines in space from straight edges of a photo: the projecting plane cut with the surface beside the edge.

Chapter 4.1.5 of the dissertation *Geradengestützte Registrierung terrestrischer Laserscans* (2011), with the covariance
of MATH 2.4 and 2.5. The interior orientation of the camera is taken as errorless.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float64, Int32, Int64
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Flags, Indices, Labels, Points, Scalars
from algorithms.features.photo_lines.edge_bands import gather_bands
from algorithms.features.photo_lines.edge_owners import edge_owners
from algorithms.features.photo_lines.edge_planes import EdgePlanes, adjust_edge_planes
from algorithms.features.photo_lines.edge_touches import edge_touches
from algorithms.features.photo_lines.projection_options import EdgeRejection, ProjectionOptions, SpaceEdgeKind
from algorithms.features.photo_lines.side_planes import side_planes
from algorithms.features.photo_lines.side_planes_kernels import crowded_sides, flatly_crossed
from algorithms.features.photo_lines.thin_lines import middles_of_thin_lines
from algorithms.geometry.cameras import Camera
from algorithms.geometry.covariances import intersection_covariances, intersection_jacobians, intersection_lines
from algorithms.geometry.lines import Lines, LineSource, concatenated_lines, lines_from_arrays
from algorithms.geometry.projecting_planes import projecting_planes
from algorithms.photos.segments import ImageSegments
from algorithms.progress import Progress, ProgressSection
from algorithms.scans.scan import Scan
from algorithms.scans.scanner_axis import scanner_axis


@dataclass(frozen=True, eq=False)
class ProjectedEdges:
    """n lines in space that a photo shows, and why m other edges gave none."""

    lines: Lines
    """In the reduced scan frame; covariances hold the errors of edge and surface only, not those of the camera's pose.
    """
    segment_numbers: Indices
    """(n,) edge of the photo each line comes from, ascending."""
    kinds: Labels
    """(n,) `SpaceEdgeKind` values."""
    plane_normals: Points
    """(n, 3) unit normals, towards the camera, of the surface each line was cut with."""
    mount_jacobians: Float64[Array, "n 4 6"]
    """(n, 4, 6) derivatives of (a1, a2, b1, b2) by the errors of `scan_from_camera`: rotation vector on the left in
    scan axes [rad], translation [m]. They are common to all lines of the photo (MATH 2.5)."""
    surface_covariances: Float64[Array, "n 4 4"]
    """(n, 4, 4) the part of the lines' covariances that comes from the surfaces they were cut with; the rest comes from
    the edges. Of rank two: a surface moves the line within its projecting plane. Whatever else was measured with the
    scan's points beside the edge has errors in common with this part."""
    rejected_numbers: Int64[Array, "m"]
    """(m,) edges of the photo that gave no line, ascending."""
    rejected_reasons: Int32[Array, "m"]
    """(m,) `EdgeRejection` values."""
    witnesses: Lines = field(default_factory=Lines.empty)
    """Lines of edges rejected because other edges crowd them or because it is unclear which surface owns them. They
    measure nothing, but poses that differ by decimetres can be told apart by how many of them are found again."""
    witness_normals: Float64[Array, "w 3"] = field(default_factory=lambda: np.empty((0, 3)))
    """(w, 3) unit normals, towards the camera, of their surfaces."""

    def __len__(self) -> int:
        return len(self.lines)

    def __getitem__(self, which: "Array | slice") -> "ProjectedEdges":
        """Select lines by an index array, mask or slice; the rejected edges stay."""
        return ProjectedEdges(
            self.lines[which],
            self.segment_numbers[which],
            self.kinds[which],
            self.plane_normals[which],
            self.mount_jacobians[which],
            self.surface_covariances[which],
            self.rejected_numbers,
            self.rejected_reasons,
            self.witnesses,
            self.witness_normals,
        )


def project_edges(
    segments: ImageSegments,
    camera: Camera,
    scan_from_camera: RigidTransform,
    scan: Scan,
    options: ProjectionOptions,
    *,
    noise_std_m: float,
    progress: Progress,
) -> ProjectedEdges:
    """Turn the edges of a photo into lines in space.

    Parameters
    ----------
    segments
        Edges in ideal pixels.
    camera
        Interior orientation.
    scan_from_camera
        Pose of the camera in the scan frame (full coordinates, not reduced ones).
    scan
        The scan taken from the same set-up.
    options
        Limits.
    noise_std_m
        Typical standard deviation of the scan's points across surfaces, as in `ScanFeatures.noise_std_m` [m].
    progress
        Is told the steps.

    Returns
    -------
    Lines with the anchor in the middle of the edge. Every edge is either among the lines or among the rejected ones.
    """
    reasons = np.full(len(segments), EdgeRejection.TOO_SHORT, dtype=np.int32)
    thin = middles_of_thin_lines(segments, options.min_separation_px)
    # the second side of a thin line stands beside nothing, and nothing beside it
    left = np.flatnonzero(~thin.spent)
    segments = thin.segments
    is_long = segments.lengths >= max(options.min_length_px, 1.0)
    crowded = thin.spent.copy()
    crowded[left] = _crowded(segments[left], thin.half_widths_px[left], options.min_separation_px)
    reasons[is_long & crowded] = EdgeRejection.CROWDED
    arguments = (camera, scan_from_camera, scan, options, noise_std_m)
    first, second = ProgressSection(progress, 0.0, 0.6), ProgressSection(progress, 0.6, 1.0)
    # apart from each other: what is crowded must not speak of spacing and waviness of the rest
    measured = _projected(
        segments, left, thin.half_widths_px, np.flatnonzero(is_long & ~crowded), reasons, *arguments, first
    )
    witnesses = np.flatnonzero(is_long & crowded & ~thin.spent)
    others = _projected(segments, left, thin.half_widths_px, witnesses, reasons.copy(), *arguments, second)
    return replace(
        measured,
        witnesses=concatenated_lines([measured.witnesses, others.lines, others.witnesses]),
        witness_normals=np.concatenate([measured.witness_normals, others.plane_normals, others.witness_normals]),
    )


def _crowded(segments: ImageSegments, half_widths_px: Scalars, separation_px: float) -> Flags:
    """Tell which edges others run along so near that their blurs move each other, or which are two themselves."""
    where = segments.centres, segments.directions, segments.extents
    crowded = crowded_sides(*where, separation_px + half_widths_px).any(axis=1)
    return np.asarray(crowded | flatly_crossed(*where, separation_px) | segments.composite)


def _ended_before(
    segments: ImageSegments, left: Int64[Array, "left"], reach: Float64[Array, "n"]
) -> Bool[Array, "n 2"]:
    """Tell on which sides of edges another one of the edges `left` runs, so that what is beyond ends there."""
    beside = segments[left]
    found = np.zeros((len(segments), 2), dtype=np.bool_)
    found[left] = crowded_sides(beside.centres, beside.directions, beside.extents, reach[left])
    return found


def _projected(
    segments: ImageSegments,
    left: Int64[Array, "left"],
    half_widths_px: Float64[Array, "n"],
    long: Array,
    reasons: Array,
    camera: Camera,
    scan_from_camera: RigidTransform,
    scan: Scan,
    options: ProjectionOptions,
    noise_std_m: float,
    progress: Progress,
) -> ProjectedEdges:
    """Turn the chosen edges into lines; writes why others of them give none into `reasons`, of all segments.

    Among the edges `left` it is seen where another one runs beside a chosen one. Middles of thin lines, which
    have half a width, are lines where both sides are one plane: of a reveal or a frame the sides lie at different
    depths, and the middle is no line in space. And the scan must be so fine that it has points on them, which tell
    what stands before the plane, such as a cable.
    """
    if len(long) == 0:
        return _nothing(reasons)
    chosen = segments[long]
    pose = RigidTransform.from_components(
        np.asarray(scan_from_camera.translation) - scan.origin_m, scan_from_camera.rotation
    )
    centre = np.asarray(pose.translation, dtype=np.float64)
    progress.report(0.0, "points beside edges")
    bands = gather_bands(chosen, camera, pose, scan.points, options)
    progress.report(0.4, "planes beside edges")
    normals, bases, by_edge, by_pose = projecting_planes(chosen.centres, chosen.directions, camera, pose)
    planes = side_planes(bands, centre, options, noise_std_m)
    variances = planes.variances(centre, noise_std_m**2)
    least_angle = options.min_angle_gon * np.pi / 200.0
    reach = np.zeros(len(segments))
    reach[long] = options.gap_px + bands.spacings_px
    ends_before = _ended_before(segments, left, reach)[long]
    rays = _edge_rays(chosen, camera, pose)
    uneven = planes.uneven(centre, noise_std_m**2)
    touches = edge_touches(bands, planes, normals, centre, options.gap_px)
    up = scanner_axis(scan)
    owners = edge_owners(planes, normals, rays, centre, variances, uneven, ends_before, touches, up, least_angle)
    reasons[long] = owners.reasons
    clear = owners.reasons == EdgeRejection.NONE
    owned = clear | (owners.reasons == EdgeRejection.OCCLUSION_UNCLEAR)
    owners = replace(owners, reasons=np.where(owned, np.int32(EdgeRejection.NONE), owners.reasons))
    kept = np.flatnonzero(owned)
    if len(kept) == 0:
        return _nothing(reasons)
    progress.report(0.7, "lines in space")
    sensor = centre if scan.sensor_m is None else scan.sensor_m  # the camera sits close to the scanner
    adjusted = adjust_edge_planes(bands, planes.used, owners, normals, scan.intensity, sensor, options)
    bent = kept[adjusted.curved[kept]]
    reasons[long[bent[clear[bent]]]] = EdgeRejection.CURVED
    kept = kept[~adjusted.curved[kept]]
    in_a_plane = np.isin(adjusted.kinds[kept], (SpaceEdgeKind.SURFACE_EDGE, SpaceEdgeKind.MATERIAL_EDGE))
    widths = 2.0 * half_widths_px[long]
    hollow = kept[(widths[kept] > 0.0) & ~(in_a_plane & (bands.spacings_px[kept] <= widths[kept]))]
    reasons[long[hollow[clear[hollow]]]] = EdgeRejection.CROWDED
    clear[hollow] = False
    ones = np.broadcast_to(centre, (len(kept), 3)).copy()
    lines, jacobians, by_surface = _cut(
        chosen[kept], camera, pose, ones, normals[kept], bases[kept], by_edge[kept], adjusted.select(kept),
        options.systematic_px,
    )  # fmt: skip
    ends = np.abs(lines.extents).max(axis=1)
    certain = np.sqrt(_largest_variance_m2(lines.covariances, ends)) <= options.max_std_m
    enough = lines.lengths >= options.min_length_m
    measures = clear[kept]
    witnesses, good = np.flatnonzero(certain & enough & ~measures), np.flatnonzero(certain & enough & measures)
    reasons[long[kept[measures & ~enough]]] = EdgeRejection.TOO_SHORT
    reasons[long[kept[measures & ~certain]]] = EdgeRejection.TOO_UNCERTAIN
    witness_normals = adjusted.normals[kept[witnesses]]
    kept = kept[good]
    progress.report(1.0, f"{len(kept)} lines in space")
    rejected = np.flatnonzero(reasons != EdgeRejection.NONE)
    return ProjectedEdges(
        lines=lines[good],
        segment_numbers=long[kept].astype(np.int64),
        kinds=adjusted.kinds[kept],
        plane_normals=adjusted.normals[kept],
        mount_jacobians=jacobians[good] @ by_pose[kept],
        surface_covariances=by_surface[good],
        witnesses=lines[witnesses],
        witness_normals=witness_normals,
        rejected_numbers=rejected.astype(np.int64),
        rejected_reasons=reasons[rejected],
    )


def _nothing(reasons: Labels) -> ProjectedEdges:
    """Give the result of a photo of which no edge leads to a line."""
    return ProjectedEdges(
        Lines.empty(),
        np.empty(0, dtype=np.int64),
        np.empty(0, dtype=np.int32),
        np.empty((0, 3)),
        np.empty((0, 4, 6)),
        np.empty((0, 4, 4)),
        np.arange(len(reasons), dtype=np.int64),
        reasons,
    )


def _edge_rays(segments: ImageSegments, camera: Camera, pose: RigidTransform) -> Float64[Array, "n 3 3"]:
    """Give the unit rays through start, middle and end of the edges in scan axes."""
    ends = segments.ends
    places = np.stack([ends[:, 0], ends.mean(axis=1), ends[:, 1]], axis=1).reshape(-1, 2)
    rays = camera.rays_from_ideal(places) @ pose.rotation.as_matrix().T
    return np.ascontiguousarray(rays.reshape(-1, 3, 3))


def _cut(
    segments: ImageSegments,
    camera: Camera,
    pose: RigidTransform,
    centres: Points,
    normals: Points,
    bases: Array,
    by_edge: Array,
    planes: EdgePlanes,
    systematic_px: float,
) -> tuple[Lines, Float64[Array, "n 4 3"], Float64[Array, "n 4 4"]]:
    """Cut projecting planes with surfaces.

    Returns
    -------
    Lines, their derivatives by the projecting planes' (a1, a2, b), and the part of their covariances that comes from
    the surfaces.
    """
    points, directions = intersection_lines(normals, centres, planes.normals, planes.centroids)
    rays = _edge_rays(segments, camera, pose)
    heights = np.einsum("ni,ni->n", planes.normals, planes.centroids - centres)
    ranges = heights[:, None] / np.einsum("nei,ni->ne", rays, planes.normals)
    places = np.einsum("nei,ni->ne", centres[:, None, :] + ranges[:, :, None] * rays - points[:, None, :], directions)
    middle = 0.5 * (places[:, 0] + places[:, 2])
    anchors = points + middle[:, None] * directions
    line_bases, jacobians = intersection_jacobians(
        anchors, directions, normals, centres, bases, planes.normals, planes.centroids, planes.bases
    )
    edge_covariances = np.zeros((len(segments), 3, 3))
    edge_covariances[:, :2, :2] = by_edge @ _edge_covariances(segments, systematic_px) @ np.swapaxes(by_edge, 1, 2)
    extents = np.sort(places[:, [0, 2]] - middle[:, None], axis=1)
    lines = lines_from_arrays(
        anchors,
        directions,
        intersection_covariances(jacobians, edge_covariances, planes.covariances),
        extents,
        bases=line_bases,
        sources=np.full(len(segments), LineSource.PHOTO_EDGE, dtype=np.int32),
    )
    by_surface = jacobians[:, :, 3:] @ planes.covariances @ np.swapaxes(jacobians[:, :, 3:], 1, 2)
    return lines, np.ascontiguousarray(jacobians[:, :, :3]), by_surface


def _edge_covariances(segments: ImageSegments, systematic_px: float) -> Float64[Array, "n 2 2"]:
    """Add what calibration and light leave: as much to the offset, and to the angle what that makes at both ends."""
    covariances = segments.covariances.copy()
    covariances[:, 0, 0] += (2.0 * systematic_px / segments.lengths) ** 2
    covariances[:, 1, 1] += systematic_px**2
    return covariances


def _largest_variance_m2(covariances: Array, places: Scalars) -> Scalars:
    """Give the largest variance across lines at places (n,) along them, at either sign of the place."""
    largest = []
    for sign in (-1.0, 1.0):
        transfer = np.concatenate(
            [np.eye(2) * (sign * places)[:, None, None], np.tile(np.eye(2), (len(places), 1, 1))], axis=2
        )
        largest.append(np.linalg.eigvalsh(transfer @ covariances @ np.swapaxes(transfer, 1, 2))[:, -1])
    return np.maximum(*largest)
