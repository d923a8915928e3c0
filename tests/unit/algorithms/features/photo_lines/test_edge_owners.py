"""Edges whose surface cannot be told, or is too narrow to be trusted, own no line or say how uncertain it is."""

import numpy as np
import pytest

from algorithms.features.photo_lines.projected_edges import project_edges
from algorithms.features.photo_lines.projection_options import EdgeRejection, ProjectionOptions, SpaceEdgeKind
from algorithms.features.photo_lines.side_planes_kernels import flatly_crossed
from algorithms.progress import NoProgress
from tests.scenes.photos.photo_scenes import CAMERA, looking, panel, scan_of, segments_of

POSE = looking()
STEP_M, NOISE_M = 0.012, 0.001
LEFT = (6.0, 0.0, -1.0), (0, 2, 0), (0, 0, 2.5)
START, END = np.array([[6.0, 0.0, -0.6]]), np.array([[6.0, 0.0, 1.0]])


def project(*panels, starts=START, ends=END):
    segments = segments_of(starts, ends, CAMERA, POSE)
    scan = scan_of(*panels)
    return project_edges(segments, CAMERA, POSE, scan, ProjectionOptions(), noise_std_m=NOISE_M, progress=NoProgress())


def reason(*panels, **edge):
    edges = project(*panels, **edge)
    assert len(edges) == 0
    return EdgeRejection(edges.rejected_reasons[0])


def kept(rng, points, share):
    return points[rng.random(len(points)) < share]


def wall(*, to_m=2.0, offset_m=0.0):
    """Give the left half of a wall with noise, from its edge up to a distance."""
    rng = np.random.default_rng(7)
    return panel((6.0, offset_m, -1.0), (0, to_m, 0), (0, 0, 2.5), STEP_M, rng, NOISE_M)


BEHIND = (9.0, -3.0, -1.5), (0, 3.2, 0), (0, 0, 4)


def seen_behind():
    """Give what the wall lets the scanner see of another one behind it."""
    points = panel(*BEHIND, 1.5 * STEP_M, np.random.default_rng(8), NOISE_M)
    return points[points[:, 1] < 0.0]


def test_an_edge_before_a_wall_far_behind_is_a_silhouette():
    assert project(wall(), seen_behind()).kinds.tolist() == [SpaceEdgeKind.SILHOUETTE]


def test_an_edge_before_what_is_hardly_seen_is_unclear():
    # a pane returns every fourth beam
    sparse = kept(np.random.default_rng(9), seen_behind(), 0.25)
    assert reason(wall(), sparse) is EdgeRejection.OCCLUSION_UNCLEAR


def test_an_edge_before_nothing_at_all_is_a_silhouette():
    # the sky beside it is the brighter side
    assert project(wall()).kinds.tolist() == [SpaceEdgeKind.SILHOUETTE]


def test_an_edge_beside_something_dark_that_is_not_measured_is_unclear():
    assert reason(wall(), starts=END, ends=START) is EdgeRejection.OCCLUSION_UNCLEAR


@pytest.mark.parametrize("upwards", [True, False])
def test_only_upwards_bodies_end_before_the_sky(upwards):
    height = 0.9 if upwards else -0.4
    board = panel((6.0, -1.0, height - 0.8 if upwards else height), (0, 2, 0), (0, 0, 0.8), STEP_M)
    ends = np.array([[6.0, -0.8, height]]), np.array([[6.0, 0.8, height]])
    brighter_outside = ends if upwards else ends[::-1]
    edges = project(board, starts=brighter_outside[0], ends=brighter_outside[1])
    assert edges.rejected_reasons.tolist() == ([] if upwards else [EdgeRejection.OCCLUSION_UNCLEAR])


@pytest.mark.parametrize("above", [True, False])
def test_hardly_above_the_camera_what_is_not_measured_beyond_an_upper_end_is_no_sky(above):
    # a bank ends upwards; the meadow on it is seen too flatly to be measured, and may end or lie in shadow farther off
    height = 1.2 if above else 0.5
    board = panel((6.0, -1.0, height - 0.8), (0, 2, 0), (0, 0, 0.8), STEP_M)
    starts, ends = np.array([[6.0, -0.8, height]]), np.array([[6.0, 0.8, height]])
    edges = project(board, starts=starts, ends=ends)
    assert edges.rejected_reasons.tolist() == ([] if above else [EdgeRejection.OCCLUSION_UNCLEAR])


def test_hardly_above_the_camera_an_upper_end_before_something_measured_is_a_silhouette():
    board = panel((6.0, -1.0, -0.3), (0, 2, 0), (0, 0, 0.8), STEP_M)
    behind = panel((9.0, -1.6, 0.66), (0, 3.2, 0), (0, 0, 1.5), 1.5 * STEP_M)
    starts, ends = np.array([[6.0, -0.8, 0.5]]), np.array([[6.0, 0.8, 0.5]])
    assert project(board, behind, starts=starts, ends=ends).kinds.tolist() == [SpaceEdgeKind.SILHOUETTE]


def test_something_between_both_planes_makes_the_edge_unclear():
    # half of what lies right beside the edge is neither of the wall nor of the one behind it
    behind = seen_behind()
    rng = np.random.default_rng(10)
    beside = (behind[:, 1] > -0.1) & (rng.random(len(behind)) < 0.5)
    behind[beside] *= 7.0 / 9.0
    assert reason(wall(), behind) is EdgeRejection.OCCLUSION_UNCLEAR


def test_a_face_that_bounds_the_body_and_is_turned_to_the_camera_may_own_the_edge():
    # the wall ends to the left of the camera: the body's side would be seen if it were a box
    starts, ends = np.array([[6.0, 0.6, -0.6]]), np.array([[6.0, 0.6, 1.0]])
    far = panel((9.0, -1.0, -1.5), (0, 1.9, 0), (0, 0, 4), 1.5 * STEP_M)
    assert reason(wall(offset_m=0.6), far, starts=starts, ends=ends) is EdgeRejection.OCCLUSION_UNCLEAR


def test_two_rows_of_points_make_no_plane():
    assert reason(wall(to_m=2 * STEP_M)) is EdgeRejection.NO_PLANE


def offset_std_m(edges):
    return float(np.sqrt(np.linalg.eigvalsh(edges.surface_covariances[0, 2:, 2:])[-1]))


def test_a_narrow_strip_is_less_certain_than_its_noise_says(monkeypatch):
    strip = wall(to_m=5 * STEP_M)
    honest = offset_std_m(project(strip))
    monkeypatch.setattr("algorithms.features.photo_lines.edge_planes.RIM_SHARE", 0.0)
    assert honest > 1.5 * offset_std_m(project(strip))


def test_rims_add_nothing_to_wide_surfaces(monkeypatch):
    honest = offset_std_m(project(wall()))
    monkeypatch.setattr("algorithms.features.photo_lines.edge_planes.RIM_SHARE", 0.0)
    assert honest == pytest.approx(offset_std_m(project(wall())), rel=1e-12)


def crossing(angle_deg, share):
    """Tell of an edge of 100 px whether it is crossed by one that comes within 5 px along a share of it."""
    angle = np.deg2rad(angle_deg)
    directions = np.array([[1.0, 0.0], [np.cos(angle), np.sin(angle)]])
    centres = np.array([[200.0, 200.0], [250.0, 200.0]])  # they meet where the first one ends
    extents = np.array([[-50.0, 50.0], [-share * 100.0 / np.cos(angle), 30.0]])
    return bool(flatly_crossed(centres, directions, extents, 5.0)[0])


def test_an_edge_that_another_one_meets_at_a_flat_angle_is_crossed():
    assert crossing(8.0, 0.3)


def test_an_edge_that_meets_only_the_end_of_another_one_does_not_cross_it():
    assert not crossing(8.0, 0.1)


def test_edges_at_a_steep_angle_do_not_disturb_each_other():
    assert not crossing(30.0, 0.3)
