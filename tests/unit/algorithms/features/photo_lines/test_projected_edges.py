"""Edges of photos become the right lines in space, or say why not."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.features.photo_lines.projected_edges import project_edges
from algorithms.features.photo_lines.projection_options import EdgeRejection, ProjectionOptions, SpaceEdgeKind
from algorithms.geometry.projecting_planes import projecting_planes
from algorithms.progress import NoProgress
from tests.scenes.photos.photo_scenes import CAMERA, line_errors, looking, panel, scan_of, segments_of

STEP_M = 0.02
POSE = looking()
WALL = panel((6.0, -2.0, -1.0), (0, 4, 0), (0, 0, 2.5), STEP_M)
LEFT_HALF = panel((6.0, 0.0, -1.0), (0, 2, 0), (0, 0, 2.5), STEP_M)
RIGHT_HALF = panel((6.0, -2.0, -1.0), (0, 2, 0), (0, 0, 2.5), STEP_M)
START, END = np.array([[6.0, 0.0, -0.6]]), np.array([[6.0, 0.0, 1.0]])


def project(scan, starts=START, ends=END, pose=POSE, **options):
    segments = segments_of(starts, ends, CAMERA, pose)
    chosen = ProjectionOptions(**options)
    return project_edges(segments, CAMERA, pose, scan, chosen, noise_std_m=0.001, progress=NoProgress())


def largest_offset_m(edges, starts=START, ends=END):
    """Largest distance of the ends of the true line from the found line."""
    worst = 0.0
    for points in (starts[edges.segment_numbers], ends[edges.segment_numbers]):
        apart = points - edges.lines.anchors
        along = np.einsum("ni,ni->n", apart, edges.lines.directions)[:, None]
        worst = max(worst, float(np.linalg.norm(apart - along * edges.lines.directions, axis=1).max()))
    return worst


def test_an_edge_without_noise_gives_the_exact_line():
    edges = project(scan_of(LEFT_HALF))
    assert len(edges) == 1
    assert largest_offset_m(edges) < 1e-9


def test_the_seen_piece_runs_from_end_to_end_of_the_edge():
    edges = project(scan_of(LEFT_HALF))
    ends = np.sort(np.concatenate(edges.lines.end_points)[:, 2])
    assert ends == pytest.approx([-0.6, 1.0], abs=1e-9)


def test_the_nearer_surface_owns_an_edge_between_two_depths():
    behind = panel((9.0, -3.0, -1.5), (0, 3, 0), (0, 0, 4), STEP_M)  # what the near wall lets the scanner see
    edges = project(scan_of(LEFT_HALF, behind))
    assert edges.kinds.tolist() == [SpaceEdgeKind.SILHOUETTE]
    assert largest_offset_m(edges) < 1e-9


def test_where_two_walls_meet_the_edge_is_a_crease():
    returning = panel((6.0, 0.0, -1.0), (2, -0.6, 0), (0, 0, 2.5), STEP_M)
    edges = project(scan_of(LEFT_HALF, returning))
    assert edges.kinds.tolist() == [SpaceEdgeKind.CREASE]
    assert largest_offset_m(edges) < 1e-9


def test_a_line_on_one_plane_without_intensities_is_a_surface_edge():
    edges = project(scan_of(WALL))
    assert edges.kinds.tolist() == [SpaceEdgeKind.SURFACE_EDGE]
    assert largest_offset_m(edges) < 1e-9


def test_a_shadow_is_a_surface_edge_because_the_scanner_does_not_see_it():
    edges = project(scan_of(LEFT_HALF, RIGHT_HALF, intensities=(0.5, 0.5)))
    assert edges.kinds.tolist() == [SpaceEdgeKind.SURFACE_EDGE]


def test_a_change_of_material_shows_in_the_intensity():
    edges = project(scan_of(LEFT_HALF, RIGHT_HALF, intensities=(0.5, 0.3)))
    assert edges.kinds.tolist() == [SpaceEdgeKind.MATERIAL_EDGE]
    assert largest_offset_m(edges) < 1e-9


def test_intensity_that_fades_across_the_edge_is_no_change_of_material():
    scan = scan_of(WALL, intensities=(0.5,))
    faded = scan.intensity * (1.0 + 0.3 * scan.points[:, 1]).astype(np.float32)
    edges = project(type(scan)(scan.points, scan.origin_m, intensity=faded, sensor_m=scan.sensor_m))
    assert edges.kinds.tolist() == [SpaceEdgeKind.SURFACE_EDGE]


def test_far_coordinates_of_the_scan_give_the_same_line():
    origin = np.array([500_000.0, 5_600_000.0, 120.0])
    near = project(scan_of(LEFT_HALF))
    segments = segments_of(START, END, CAMERA, POSE)
    far = project_edges(
        segments, CAMERA, looking(origin_m=origin), scan_of(LEFT_HALF, origin_m=origin), ProjectionOptions(),
        noise_std_m=0.001, progress=NoProgress(),
    )  # fmt: skip
    # 1e-9 m: coordinates of 5600 km are rounded to that
    assert far.lines.anchors == pytest.approx(near.lines.anchors, abs=2e-9)


def reason(scan, **changes):
    edges = project(scan, **changes)
    assert len(edges) == 0
    return EdgeRejection(edges.rejected_reasons[0])


def test_an_edge_beside_nothing_has_no_plane():
    assert reason(scan_of(panel((6.0, 1.5, -1.0), (0, 1, 0), (0, 0, 2), STEP_M))) is EdgeRejection.NO_PLANE


def test_a_plane_that_ends_before_the_edge_is_not_taken():
    short = panel((6.0, 0.06, -1.0), (0, 2, 0), (0, 0, 2.5), 0.01)
    assert reason(scan_of(short)) is EdgeRejection.NOT_COVERED


def test_a_surface_along_the_line_of_sight_is_grazing():
    # seen at two degrees
    aside = panel((4.0, 0.4, -1.0), (2, 0.18, 0), (0, 0, 2.5), STEP_M)
    starts, ends = np.array([[6.0, 0.58, -0.6]]), np.array([[6.0, 0.58, 1.0]])
    assert reason(scan_of(aside), starts=starts, ends=ends) is EdgeRejection.GRAZING


def test_a_short_edge_is_left_out():
    assert reason(scan_of(LEFT_HALF), min_length_m=2.0) is EdgeRejection.TOO_SHORT


def test_the_outline_of_a_pipe_is_curved():
    angles = np.linspace(-np.pi / 2, np.pi / 2, 80)
    ring = np.column_stack([6.0 - 0.08 * np.cos(angles), 0.08 * np.sin(angles)])
    heights = np.arange(-1.0, 1.5, 0.01)
    pipe = np.concatenate([np.column_stack([ring, np.full(len(ring), z)]) for z in heights])
    # the sky beside it is the brighter side
    starts, ends = np.array([[6.0, 0.0797, 1.0]]), np.array([[6.0, 0.0797, -0.6]])
    assert reason(scan_of(pipe), starts=starts, ends=ends) is EdgeRejection.CURVED


def test_a_thin_bar_before_a_wall_makes_the_owner_unclear():
    # one column of points, too few for a plane, and the wall behind on both sides
    bar = panel((5.0, 0.0, -1.0), (0, 0.012, 0), (0, 0, 2.5), 0.012)
    starts, ends = np.array([[5.0, 0.012, -0.6]]), np.array([[5.0, 0.012, 1.0]])
    assert reason(scan_of(WALL, bar), starts=starts, ends=ends) is EdgeRejection.OCCLUSION_UNCLEAR


def test_two_edges_within_three_pixels_are_crowded():
    shift = np.array([[0.0, 0.006, 0.0]])  # 1.8 px
    edges = project(scan_of(WALL), np.vstack([START, START + shift]), np.vstack([END, END + shift]))
    assert edges.rejected_reasons.tolist() == [EdgeRejection.CROWDED, EdgeRejection.CROWDED]


def thin_line(scan, width_m=0.014, **options):
    """Project both sides of a thin line, bright outside, about the middle (START, END)."""
    half = np.array([[0.0, 0.5 * width_m, 0.0]])
    return project(scan, np.vstack([START + half, END - half]), np.vstack([END + half, START - half]), **options)


FINE = panel((6.0, -0.4, -1.0), (0, 0.8, 0), (0, 0, 2.5), 0.01)


def test_both_sides_of_a_joint_become_one_line_in_the_middle():
    edges = thin_line(scan_of(FINE))
    assert edges.kinds.tolist() == [SpaceEdgeKind.SURFACE_EDGE]
    assert edges.rejected_reasons.tolist() == [EdgeRejection.CROWDED]
    both = np.vstack([START, START]), np.vstack([END, END])
    assert largest_offset_m(edges, *both) < 1e-9


def test_sides_of_a_reveal_stay_crowded():
    near = panel((6.0, 0.0, -1.0), (0, 0.4, 0), (0, 0, 2.5), 0.01)
    behind = panel((6.3, -0.5, -1.5), (0, 0.5, 0), (0, 0, 4), 0.01)
    edges = thin_line(scan_of(near, behind))
    assert len(edges) == 0
    assert EdgeRejection.NONE not in edges.rejected_reasons.tolist()


def test_a_scan_too_coarse_to_hit_a_thin_line_does_not_tell_that_it_lies_in_the_wall():
    edges = thin_line(scan_of(WALL))
    assert edges.rejected_reasons.tolist() == [EdgeRejection.CROWDED, EdgeRejection.CROWDED]


def test_every_edge_is_a_line_or_has_a_reason():
    starts = START + np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 3.0, 0.0]])
    edges = project(scan_of(LEFT_HALF), starts, starts + (END - START))
    assert sorted([*edges.segment_numbers, *edges.rejected_numbers]) == [0, 1, 2]


def test_no_edges_give_no_lines():
    nothing = segments_of(START, END, CAMERA, POSE)[:0]
    edges = project_edges(
        nothing, CAMERA, POSE, scan_of(WALL), ProjectionOptions(), noise_std_m=0.001, progress=NoProgress()
    )
    assert len(edges) == 0


def disturbed(pose, error):
    return RigidTransform.from_components(
        np.asarray(pose.translation) + error[3:], Rotation.from_rotvec(error[:3]) * pose.rotation
    )


def test_mount_jacobians_agree_with_differences():
    starts = np.array([[6.0, 0.0, -0.6], [6.0, 1.0, -0.7]])
    ends = np.array([[6.0, 0.0, 1.0], [6.0, 1.6, 0.9]])
    segments = segments_of(starts, ends, CAMERA, POSE)
    scan = scan_of(WALL)

    def lines(pose):
        return project_edges(
            segments, CAMERA, pose, scan, ProjectionOptions(), noise_std_m=0.001, progress=NoProgress()
        )

    still = lines(POSE)
    step = 1e-6
    for k in range(6):
        moved = lines(disturbed(POSE, step * np.eye(6)[k])).lines
        change = line_errors(still.lines, moved.anchors - moved.directions, moved.anchors + moved.directions)
        assert change / step == pytest.approx(still.mount_jacobians[:, :, k], abs=2e-5)


def test_projecting_planes_by_edge_errors_agree_with_differences():
    segments = segments_of(START, END + np.array([0.0, 0.4, 0.0]), CAMERA, POSE)
    normals, bases, by_edge, _ = projecting_planes(segments.centres, segments.directions, CAMERA, POSE)
    step = 1e-6
    across = segments.normals
    turned = segments.directions + step * across
    shifted = segments.centres + step * across
    by_angle = projecting_planes(segments.centres, turned, CAMERA, POSE)[0] - normals
    by_offset = projecting_planes(shifted, segments.directions, CAMERA, POSE)[0] - normals
    numeric = np.stack([np.einsum("nij,ni->nj", bases, d) / step for d in (by_angle, by_offset)], axis=2)
    assert numeric == pytest.approx(by_edge, rel=1e-4, abs=1e-9)
