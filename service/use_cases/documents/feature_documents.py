"""Lines, planes and cylinders of one scan, as clients read them."""

import math
from collections.abc import Sequence
from typing import cast

import numpy as np

from algorithms.arrays import Array
from algorithms.features.photo_lines.outlines import Outline
from algorithms.features.photo_lines.projection_options import SpaceEdgeKind
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.lines import LineSource
from schemas.results.lines_result import ExtractedCylinder, ExtractedLine, ExtractedOutline, ExtractedPlane, Vector
from service.use_cases.documents.feature_names import line_name, plane_name


def vector(values: Array) -> Vector:
    """Turn a (3,) array into a JSON triple."""
    return cast("Vector", tuple(float(value) for value in values))


def extracted_lines(features: ScanFeatures) -> list[ExtractedLine]:
    """Describe the lines of a scan in the coordinates of its file."""
    lines = features.lines
    starts, ends = lines.end_points
    surfaces = _surfaces(features)
    out = []
    for k in range(len(lines)):
        source = LineSource(int(lines.sources[k]))
        is_axis = source is LineSource.CYLINDER_AXIS
        parents = [int(p) for p in lines.parents[k] if p >= 0]
        out.append(
            ExtractedLine(
                name=line_name(k),
                source=source.label,
                anchor_m=vector(lines.anchors[k] + features.origin_m),
                direction=vector(lines.directions[k]),
                basis=(vector(lines.bases[k, :, 0]), vector(lines.bases[k, :, 1])),
                covariance=lines.covariances[k].tolist(),
                start_m=vector(starts[k] + features.origin_m),
                end_m=vector(ends[k] + features.origin_m),
                length_m=float(lines.lengths[k]),
                planes=[] if is_axis else [plane_name(p) for p in parents],
                cylinder=f"C{parents[0] + 1}" if is_axis and parents else None,
                photo=None if lines.photos is None or lines.photos[k] < 0 else int(lines.photos[k]),
                surface=surfaces[k],
            )
        )
    return out


def _surfaces(features: ScanFeatures) -> list[str | None]:
    """Say what the edges of photos are in space, None for other lines."""
    if features.photo_edges is None:
        return [None] * len(features.lines)
    return [None if kind < 0 else SpaceEdgeKind(kind).label for kind in features.photo_edges.line_kinds.tolist()]


def extracted_planes(features: ScanFeatures) -> list[ExtractedPlane]:
    """Describe the planes of a scan in the coordinates of its file."""
    planes = features.planes
    return [
        ExtractedPlane(
            name=plane_name(k),
            normal=vector(planes.normals[k]),
            centroid_m=vector(planes.centroids[k] + features.origin_m),
            basis=(vector(planes.bases[k, :, 0]), vector(planes.bases[k, :, 1])),
            covariance=planes.covariances[k].tolist(),
            noise_std_m=float(planes.noise_std_m[k]),
            points=int(planes.point_counts[k]),
            area_m2=float(planes.areas_m2[k]),
            boundary_m=[
                vector(corner)
                for corner in planes.centroids[k] + features.origin_m + planes.boundary_of(k) @ planes.bases[k].T
            ],
        )
        for k in range(len(planes))
    ]


def extracted_cylinders(features: ScanFeatures) -> list[ExtractedCylinder]:
    """Describe the cylinders of a scan; their axes are among its lines."""
    cylinders, lines = features.cylinders, features.lines
    axes = {int(lines.parents[k, 0]): int(k) for k in np.flatnonzero(lines.sources == LineSource.CYLINDER_AXIS)}
    return [
        ExtractedCylinder(
            name=f"C{k + 1}",
            axis=line_name(axes[k]),
            radius_m=float(cylinders.radii_m[k]),
            radius_std_m=float(cylinders.radius_std_m[k]),
            arc_gon=float(cylinders.arcs_rad[k]) * 200.0 / math.pi,
            seen_from="outside" if cylinders.convex[k] else "inside",
            points=int(cylinders.point_counts[k]),
        )
        for k in range(len(cylinders))
    ]


def extracted_outlines(features: ScanFeatures, found: Sequence[Outline]) -> list[ExtractedOutline]:
    """Put the outlines that photos show on the planes into the file's coordinates."""
    return [
        ExtractedOutline(
            plane=plane_name(outline.plane),
            lines=[line_name(k) for k in outline.lines],
            corners_m=[vector(corner) for corner in outline.corners + features.origin_m],
            area_m2=outline.area_m2,
        )
        for outline in found
    ]
