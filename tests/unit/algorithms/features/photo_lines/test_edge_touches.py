"""Where a scan's rows meet an edge in all phases, the surface that comes up to the edge itself owns it."""

import numpy as np
import pytest

from algorithms.features.photo_lines.projected_edges import project_edges
from algorithms.features.photo_lines.projection_options import EdgeRejection, ProjectionOptions, SpaceEdgeKind
from algorithms.progress import NoProgress
from tests.scenes.photos.photo_scenes import CAMERA, line_errors, looking, scan_of, segments_of

STEP_RAD, TILT_RAD = np.deg2rad(0.3), np.deg2rad(4.0)
"""A coarse scan, nine pixels of the photo apart, by an instrument that is a little tilted."""
AT_M, NOISE_M = 0.6, 0.0005
"""A wall 6 m away begins so far to the left of the camera, which looks at the face that bounds its opening."""
POSE = looking(position_m=(0.0, 0.0, 0.0))
PX_M = 6.0 / CAMERA.fx


def scanned(depth_m, *, tilt_rad=TILT_RAD, wall_from_m=AT_M, behind_to_m=AT_M, at_m=AT_M):
    """Scan a wall beside an opening; what closes the opening stands `depth_m` behind the wall.

    The wall's points begin at `wall_from_m`, those of what is behind end where a ray meets the wall's plane at
    `behind_to_m`; in between nothing comes back.
    """
    across, up = np.meshgrid(np.arange(-0.12, 0.35, STEP_RAD), np.arange(-0.15, 0.2, STEP_RAD))
    y = np.cos(tilt_rad) * across - np.sin(tilt_rad) * up
    z = np.sin(tilt_rad) * across + np.cos(tilt_rad) * up
    rays = np.column_stack([np.ones(y.size), y.ravel(), z.ravel()])
    places = 6.0 * rays[:, 1]
    behind_range, face_range = 6.0 + depth_m, at_m / np.maximum(rays[:, 1], 1e-9)
    ranges = np.where(places > at_m, 6.0, np.minimum(behind_range, face_range))
    seen = (places >= wall_from_m) | (places <= behind_to_m)
    noise = np.random.default_rng(3).normal(0.0, NOISE_M, len(ranges))
    return scan_of(((ranges + noise)[:, None] * rays)[seen])


def project(scan, at_m=AT_M):
    starts, ends = np.array([[6.0, at_m, -0.6]]), np.array([[6.0, at_m, 1.0]])
    segments = segments_of(starts, ends, CAMERA, POSE)
    return project_edges(segments, CAMERA, POSE, scan, ProjectionOptions(), noise_std_m=NOISE_M, progress=NoProgress())


def rejections(edges):
    return [EdgeRejection(reason) for reason in edges.rejected_reasons]


def test_a_wall_seen_up_to_the_edge_owns_it_though_the_face_of_its_opening_is_seen():
    # the face is six pixels wide
    edges = project(scanned(0.2))
    assert edges.kinds.tolist() == [SpaceEdgeKind.SILHOUETTE]
    errors = line_errors(edges.lines, np.array([[6.0, AT_M, -0.6]]), np.array([[6.0, AT_M, 1.0]]))
    assert np.abs(errors[0, 2:]).max() < 4.0 * NOISE_M


def test_a_face_too_narrow_to_be_told_from_its_far_end_leaves_the_owner_open():
    # a pixel and a half wide
    assert rejections(project(scanned(0.05))) == [EdgeRejection.OCCLUSION_UNCLEAR]


def test_a_wall_that_ends_six_pixels_before_the_edge_does_not_own_it():
    scan = scanned(0.2, wall_from_m=AT_M + 6.0 * PX_M)
    assert rejections(project(scan)) == [EdgeRejection.OCCLUSION_UNCLEAR]


def test_what_is_not_measured_beyond_the_edge_may_own_it():
    scan = scanned(0.2, behind_to_m=AT_M - 6.0 * PX_M)
    assert rejections(project(scan)) == [EdgeRejection.OCCLUSION_UNCLEAR]


@pytest.mark.parametrize("begins_px", [3.5, 5.5])
def test_columns_parallel_to_the_edge_tell_less_of_where_the_wall_ends(begins_px):
    # the wall's nearest column of points is as far from the edge as the scanner's step has it
    spacing_m = 6.0 * STEP_RAD
    first = spacing_m * np.round(AT_M / spacing_m)
    at_m = first - begins_px * PX_M
    edges = project(scanned(0.2, tilt_rad=0.0, at_m=at_m, wall_from_m=at_m, behind_to_m=at_m), at_m)
    assert rejections(edges) == [EdgeRejection.OCCLUSION_UNCLEAR]
