"""What scan and photos show several times becomes one line."""

from dataclasses import replace

import numpy as np
import pytest

from algorithms.features.photo_lines.merged_lines import merge_lines
from algorithms.features.photo_lines.projected_edges import ProjectedEdges
from algorithms.features.photo_lines.projection_options import MergeOptions, SpaceEdgeKind
from algorithms.geometry.line_differences import line_differences, lines_moved
from algorithms.geometry.lines import LineSource, lines_from_arrays

STD = np.array([1e-4, 2e-4, 3e-4, 5e-4])
"""Of (a1, a2, b1, b2) [rad, m]."""
MOUNT = np.diag([2e-4**2] * 3 + [1e-3**2] * 3)
EXACT = MergeOptions(rounding_std_m=0.0)


def upright(x=5.0, y=1.0, z=0.0, length=2.0, **fields):
    """One vertical line."""
    covariance = np.diag(STD**2)[None]
    extent = np.array([[-0.5 * length, 0.5 * length]])
    return lines_from_arrays(np.array([[x, y, z]]), np.array([[0.0, 0.0, 1.0]]), covariance, extent, **fields)


def crease(**places):
    rng = np.random.default_rng(1)
    return upright(**places, parents=np.array([[3, 7]]), parent_jacobians=rng.normal(size=(1, 4, 6)))


def photo(*lines, seed=2, surface=None):
    rng = np.random.default_rng(seed)
    n = len(lines)
    arrays = {
        name: np.concatenate([getattr(line, name) for line in lines])
        for name in ("anchors", "directions", "covariances", "extents", "bases")
    }
    joined = lines_from_arrays(**arrays, sources=np.full(n, LineSource.PHOTO_EDGE, dtype=np.int32))
    return ProjectedEdges(
        joined,
        np.arange(n),
        np.full(n, SpaceEdgeKind.CREASE, dtype=np.int32),
        np.tile([-1.0, 0.0, 0.0], (n, 1)),
        rng.normal(size=(n, 4, 6)),
        np.zeros((n, 4, 4)) if surface is None else np.tile(surface, (n, 1, 1)),
        np.empty(0, dtype=np.int64),
        np.empty(0, dtype=np.int32),
    )


def merged(cloud, *parts, options=None, mount=MOUNT):
    return merge_lines(cloud, parts, [mount] * len(parts), options or EXACT)


def test_a_line_without_partner_stays_as_it_is():
    cloud = crease()
    result = merged(cloud, photo(upright(y=3.0)))
    assert len(result.lines) == 2
    assert result.merged_counts.tolist() == [0]
    for name in ("anchors", "directions", "covariances", "parents", "parent_jacobians"):
        assert np.array_equal(getattr(result.lines, name)[:1], getattr(cloud, name))
    assert result.lines.photos.tolist() == [-1, 0]


def test_a_line_merged_with_one_of_the_scan_stays_one_of_the_scan():
    cloud = crease()
    result = merged(cloud, photo(upright(x=5.0002)))
    assert len(result.lines) == 1
    assert result.merged_counts.tolist() == [1]
    assert np.array_equal(result.lines.parents, cloud.parents)
    assert result.lines.sources.tolist() == [LineSource.PLANE_INTERSECTION]
    assert result.kinds.tolist() == [-1]


def test_a_line_far_off_for_its_standard_deviation_stays_by_itself():
    # 12 mm where mount, noise and rounding make 7 mm at 3.3 standard deviations
    result = merged(crease(), photo(upright(y=1.012)), options=MergeOptions(max_distance_m=1.0), mount=0.01 * MOUNT)
    assert len(result.lines) == 2
    assert result.lines.photos.tolist() == [-1, 0]


def test_an_uncertain_mount_lets_the_same_difference_pass():
    result = merged(crease(), photo(upright(y=1.012)), options=MergeOptions(max_distance_m=1.0), mount=100.0 * MOUNT)
    assert len(result.lines) == 1


def test_pieces_of_one_line_that_do_not_overlap_stay_apart():
    result = merged(crease(), photo(upright(z=3.0)))
    assert len(result.lines) == 2


def test_lines_of_one_photo_are_never_merged_with_each_other():
    result = merged(upright()[:0], photo(upright(), upright(x=5.0001)))
    assert len(result.lines) == 2


def test_of_two_photos_the_one_with_the_better_surface_is_the_base():
    surface = in_projecting_plane([1.0, 0.0])
    good, bad = upright(x=5.0001), upright()
    good, bad = (replace(line, covariances=line.covariances + k * surface) for line, k in ((good, 1.0), (bad, 400.0)))
    parts = photo(bad, surface=400.0 * surface), photo(good, seed=2, surface=surface)
    result = merged(upright()[:0], *parts, mount=1e-12 * MOUNT)
    assert len(result.lines) == 1
    assert result.lines.photos.tolist() == [1]
    assert result.lines.second_photos.tolist() == [0]
    assert result.lines.covariances[0, 2, 2] == pytest.approx(good.covariances[0, 2, 2], rel=1e-6)


def test_every_line_takes_the_partner_that_fits_best():
    first, second = crease(), crease(x=5.004)
    cloud = lines_from_arrays(
        *(
            np.concatenate([getattr(a, n) for a in (first, second)])
            for n in ("anchors", "directions", "covariances", "extents")
        )
    )
    result = merged(cloud, photo(upright(x=5.0041)))
    assert result.lines.photos.tolist() == [-1, 0]


def test_the_weighted_mean_has_the_covariance_of_both():
    result = merged(crease(), photo(upright(x=5.0002)), mount=1e-12 * MOUNT)
    assert result.lines.covariances[0] == pytest.approx(0.5 * np.diag(STD**2), rel=1e-6)


def test_the_weighted_mean_lies_between_both():
    result = merged(crease(), photo(upright(x=5.0002)), mount=1e-12 * MOUNT)
    assert result.lines.anchors[0] == pytest.approx([5.0001, 1.0, 0.0], abs=1e-9)


def test_planes_and_mount_are_carried_through_the_weights():
    cloud, part = crease(), photo(upright(x=5.0002))
    result = merged(cloud, part, mount=1e-12 * MOUNT)
    # equal covariances: both weights are a half
    assert result.lines.parent_jacobians == pytest.approx(0.5 * cloud.parent_jacobians, rel=1e-6, abs=1e-9)
    assert result.lines.photo_jacobians == pytest.approx(0.5 * part.mount_jacobians, rel=1e-6, abs=1e-9)
    assert result.lines.photos.tolist() == [0]
    assert result.lines.private_covariances[0] == pytest.approx(0.25 * np.diag(STD**2), rel=1e-6, abs=1e-15)


def test_the_weighted_mean_of_two_photos_depends_on_both_mounts():
    first, second = photo(upright(), seed=3), photo(upright(x=5.0002), seed=4)
    lines = merged(upright()[:0], first, second, mount=1e-12 * MOUNT).lines
    assert (lines.photos[0], lines.second_photos[0]) == (0, 1)
    assert lines.photo_jacobians == pytest.approx(0.5 * first.mount_jacobians, rel=1e-6, abs=1e-9)
    assert lines.second_photo_jacobians == pytest.approx(0.5 * second.mount_jacobians, rel=1e-6, abs=1e-9)


def test_a_third_photo_changes_nothing_any_more():
    parts = [photo(upright(x=5.0 + 1e-4 * k), seed=k) for k in range(3)]
    two, three = (merged(upright()[:0], *parts[:n]) for n in (2, 3))
    assert len(three.lines) == 1
    assert np.array_equal(two.lines.anchors, three.lines.anchors)


def in_projecting_plane(across):
    """The covariance (1, 4, 4) of a surface that moves a line along one direction only, `across` = (b1, b2)."""
    along = np.kron(np.eye(2), np.asarray(across)[:, None])
    return (along @ np.diag([1e-8, 4e-8]) @ along.T)[None]


def test_what_a_surface_says_of_a_line_of_the_scan_is_not_counted_twice():
    surface = in_projecting_plane([1.0, 0.0])
    cloud, part = crease(), photo(upright(x=5.0002, y=1.0003), surface=surface)
    lines = merged(cloud, part, mount=1e-12 * MOUNT).lines
    moved, _ = line_differences(cloud, lines)
    # the basis of upright lines is (y, -x) or alike: only the second component, across the projecting plane, changes
    assert moved[0, [0, 2]] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert lines.covariances[0, 0, 0] == pytest.approx(STD[0] ** 2, rel=1e-9)
    assert lines.covariances[0, 2, 2] == pytest.approx(STD[2] ** 2, rel=1e-9)


def test_what_an_edge_says_of_a_line_of_the_scan_is_used():
    part = photo(upright(), surface=in_projecting_plane([1.0, 0.0]))
    lines = merged(crease(), part, mount=1e-12 * MOUNT).lines
    assert lines.covariances[0, 1, 1] == pytest.approx(0.5 * STD[1] ** 2, rel=1e-6)
    assert lines.covariances[0, 3, 3] == pytest.approx(0.5 * STD[3] ** 2, rel=1e-6)


def test_a_badly_known_mount_adds_next_to_nothing():
    cloud, part = crease(), photo(upright(x=5.001))
    lines = merged(cloud, part, mount=1e8 * MOUNT).lines
    assert lines.anchors[0] == pytest.approx(cloud.anchors[0], abs=1e-6)
    assert lines.covariances[0] == pytest.approx(cloud.covariances[0], rel=1e-3, abs=1e-12)


def test_two_pieces_in_one_photo_share_its_mount():
    pieces = photo(upright(z=-0.4), upright(z=0.4))
    pieces = replace(pieces, mount_jacobians=np.tile(np.eye(4, 6), (2, 1, 1)))
    mount = 1e4 * MOUNT
    lines = merged(crease(), pieces, mount=mount).lines
    assert lines.photos.tolist() == [0]
    assert lines.second_photos.tolist() == [-1]
    # what both have in common does not vanish by taking them together
    by_mount = lines.photo_jacobians[0] @ mount @ lines.photo_jacobians[0].T
    total = lines.private_covariances[0] + by_mount
    planes = lines.covariances[0] - total
    assert np.linalg.eigvalsh(planes)[0] > -1e-15


def test_axes_of_cylinders_are_not_merged_with_edges():
    axis = upright(sources=np.array([LineSource.CYLINDER_AXIS], dtype=np.int32), parents=np.array([[0, -1]]))
    result = merged(axis, photo(upright()))
    assert len(result.lines) == 2


def test_rounded_edges_keep_the_mean_near_the_scan():
    rounded = MergeOptions(rounding_std_m=0.005)
    cloud, part = crease(), photo(upright(x=5.004))
    lines = merged(cloud, part, options=rounded, mount=1e-12 * MOUNT).lines
    # 0.5 mm against 5 mm: the photo has a weight of a hundredth
    assert np.linalg.norm(lines.anchors[0] - cloud.anchors[0]) < 1e-4


def test_merging_does_not_change_what_it_was_given():
    cloud, part = crease(), photo(upright(x=5.0002))
    before = cloud.anchors.copy(), part.lines.anchors.copy()
    merged(cloud, part)
    assert np.array_equal(cloud.anchors, before[0])
    assert np.array_equal(part.lines.anchors, before[1])


def test_a_scan_without_photos_keeps_its_lines():
    result = merged(crease())
    assert len(result.lines) == 1
    assert np.array_equal(result.lines.covariances, crease().covariances)


def test_derivatives_of_line_differences_agree_with_differences():
    first = upright()
    tilted = np.array([[0.02, -0.03, -1.0]])
    second = lines_from_arrays(np.array([[5.02, 1.01, 0.7]]), tilted, np.eye(4)[None], np.array([[-1.0, 1.0]]))
    value, jacobian = line_differences(first, second)
    for k in range(4):
        step = 1e-6 * np.eye(4)[k][None]
        changed, _ = line_differences(first, lines_moved(second, step))
        assert (changed - value)[0] / 1e-6 == pytest.approx(jacobian[0, :, k], abs=1e-5)
