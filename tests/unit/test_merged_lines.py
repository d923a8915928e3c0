"""What scan and photos show several times becomes one line."""

from dataclasses import replace

import numpy as np
import pytest

from algorithms.features.merged_lines import merge_lines
from algorithms.features.projected_edges import ProjectedEdges
from algorithms.features.projection_options import MergeOptions, SpaceEdgeKind
from algorithms.geometry.line_differences import line_differences, lines_moved
from algorithms.geometry.lines import LineSource, lines_from_arrays

STD = np.array([1e-4, 2e-4, 3e-4, 5e-4])
"""Of (a1, a2, b1, b2) [rad, m]."""
MOUNT = np.diag([2e-4**2] * 3 + [1e-3**2] * 3)
WEIGHTED = MergeOptions(combination="weighted")


def upright(x=5.0, y=1.0, z=0.0, length=2.0, **fields):
    """One vertical line."""
    covariance = np.diag(STD**2)[None]
    extent = np.array([[-0.5 * length, 0.5 * length]])
    return lines_from_arrays(np.array([[x, y, z]]), np.array([[0.0, 0.0, 1.0]]), covariance, extent, **fields)


def crease(**places):
    rng = np.random.default_rng(1)
    return upright(**places, parents=np.array([[3, 7]]), parent_jacobians=rng.normal(size=(1, 4, 6)))


def photo(*lines, seed=2):
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
        np.zeros((n, 4, 4)),
        np.empty(0, dtype=np.int64),
        np.empty(0, dtype=np.int32),
    )


def merged(cloud, *parts, options=None, mount=MOUNT):
    return merge_lines(cloud, parts, [mount] * len(parts), options or MergeOptions())


def test_a_line_of_the_scan_survives_as_it_is():
    cloud = crease()
    result = merged(cloud, photo(upright(x=5.0002)))
    assert len(result.lines) == 1
    assert result.merged_counts.tolist() == [1]
    for name in ("anchors", "directions", "covariances", "parents", "parent_jacobians"):
        assert np.array_equal(getattr(result.lines, name), getattr(cloud, name))
    assert result.lines.photos.tolist() == [-1]


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


def test_of_two_photos_the_more_certain_line_survives():
    good, bad = upright(x=5.0001), upright()
    bad = replace(bad, covariances=4.0 * bad.covariances)
    result = merged(upright()[:0], photo(bad), photo(good, seed=2))
    assert len(result.lines) == 1
    assert result.lines.photos.tolist() == [1]
    assert np.array_equal(result.lines.anchors, good.anchors)


def test_every_line_takes_the_partner_that_fits_best():
    first, second = crease(), crease(x=5.004)
    cloud = lines_from_arrays(
        *(
            np.concatenate([getattr(a, n) for a in (first, second)])
            for n in ("anchors", "directions", "covariances", "extents")
        )
    )
    result = merged(cloud, photo(upright(x=5.0041)))
    assert result.contradictions.differences[0, 2:] == pytest.approx(
        (cloud.bases[1].T @ np.array([1e-4, 0.0, 0.0])), abs=1e-12
    )


def test_the_weighted_mean_has_the_covariance_of_both():
    result = merged(crease(), photo(upright(x=5.0002)), options=WEIGHTED, mount=1e-12 * MOUNT)
    assert result.lines.covariances[0] == pytest.approx(0.5 * np.diag(STD**2), rel=1e-6)


def test_the_weighted_mean_lies_between_both():
    result = merged(crease(), photo(upright(x=5.0002)), options=WEIGHTED)
    assert result.lines.anchors[0] == pytest.approx([5.0001, 1.0, 0.0], abs=1e-9)


def test_planes_and_mount_are_carried_through_the_weights():
    cloud, part = crease(), photo(upright(x=5.0002))
    result = merged(cloud, part, options=WEIGHTED)
    # equal covariances: both weights are a half
    assert result.lines.parent_jacobians == pytest.approx(0.5 * cloud.parent_jacobians)
    assert result.lines.photo_jacobians == pytest.approx(0.5 * part.mount_jacobians)
    assert result.lines.photos.tolist() == [0]
    assert result.private_covariances[0] == pytest.approx(0.25 * np.diag(STD**2))


def test_the_weighted_mean_of_two_photos_depends_on_both_mounts():
    first, second = photo(upright(), seed=3), photo(upright(x=5.0002), seed=4)
    result = merged(upright()[:0], first, second, options=WEIGHTED)
    assert (result.lines.photos[0], result.second_photos[0]) == (0, 1)
    assert result.lines.photo_jacobians == pytest.approx(0.5 * first.mount_jacobians)
    assert result.second_photo_jacobians == pytest.approx(0.5 * second.mount_jacobians)


def test_a_third_photo_changes_nothing_any_more():
    parts = [photo(upright(x=5.0 + 1e-4 * k), seed=k) for k in range(3)]
    two, three = (merged(upright()[:0], *parts[:n], options=WEIGHTED) for n in (2, 3))
    assert len(three.lines) == 1
    assert np.array_equal(two.lines.anchors, three.lines.anchors)


def test_contradictions_depend_on_the_mount_alone():
    """A mount error moves the photo's line; the noted difference is what its derivative says."""
    error = np.array([2e-4, -1e-4, 3e-4, 1e-3, -5e-4, 7e-4]) * 0.3
    part = photo(upright(), seed=5)
    moved = lines_moved(part.lines, (part.mount_jacobians @ error)[:, :])
    result = merged(crease(), replace(part, lines=moved), mount=100.0 * MOUNT)
    note = result.contradictions
    assert note.photos.tolist() == [[-1, 0]]
    # second order of the tilt, 1e-3 squared
    assert note.differences[0] == pytest.approx(note.jacobians[0, :, 6:] @ error, abs=1e-6)


def test_merging_does_not_change_what_it_was_given():
    cloud, part = crease(), photo(upright(x=5.0002))
    before = cloud.anchors.copy(), part.lines.anchors.copy()
    merged(cloud, part, options=WEIGHTED)
    assert np.array_equal(cloud.anchors, before[0])
    assert np.array_equal(part.lines.anchors, before[1])


def test_a_scan_without_photos_keeps_its_lines():
    result = merged(crease())
    assert len(result.lines) == 1
    assert len(result.contradictions.differences) == 0


def test_derivatives_of_line_differences_agree_with_differences():
    first = upright()
    tilted = np.array([[0.02, -0.03, -1.0]])
    second = lines_from_arrays(np.array([[5.02, 1.01, 0.7]]), tilted, np.eye(4)[None], np.array([[-1.0, 1.0]]))
    value, jacobian = line_differences(first, second)
    for k in range(4):
        step = 1e-6 * np.eye(4)[k][None]
        changed, _ = line_differences(first, lines_moved(second, step))
        assert (changed - value)[0] / 1e-6 == pytest.approx(jacobian[0, :, k], abs=1e-5)
