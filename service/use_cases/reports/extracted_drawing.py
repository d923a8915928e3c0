"""Lines, planes and outlines of one station as a drawing."""

from collections.abc import Sequence

import numpy as np

from algorithms.features.photo_lines.outlines import Outline
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.lines import LineSource
from service.formats.dxf_lines_writer import LineLayer, dxf_lines

COLORS = {
    LineSource.PLANE_INTERSECTION: (0, 128, 96),
    LineSource.CYLINDER_AXIS: (150, 80, 160),
    LineSource.PHOTO_EDGE: (214, 138, 0),
}
PLANE_COLOR, OUTLINE_COLOR = (150, 150, 150), (200, 40, 40)


def extracted_dxf(features: ScanFeatures, found: Sequence[Outline]) -> bytes:
    """Draw in the file's coordinates: a layer for each kind of line, borders of planes, outlines of photo edges."""
    lines, planes, origin = features.lines, features.planes, features.origin_m
    starts, ends = (points + origin for points in lines.end_points)
    layers = [
        LineLayer(source.label, color, starts[lines.sources == source], ends[lines.sources == source])
        for source, color in COLORS.items()
    ]
    none = np.empty((0, 3))
    borders = [planes.centroids[k] + origin + planes.boundary_of(k) @ planes.bases[k].T for k in range(len(planes))]
    layers.append(LineLayer("planes", PLANE_COLOR, none, none, borders))
    rings = [outline.corners + origin for outline in found]
    layers.append(LineLayer("outlines", OUTLINE_COLOR, none, none, rings))
    return dxf_lines(layers)
