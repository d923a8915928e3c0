"""Planes are reported as fully as lines, and a plane that was moved is named with all that depends on it."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from algorithms.adjustment.line_adjustment import AdjustmentOptions, LineAdjustment, adjust_lines
from algorithms.adjustment.observations.plane_plane import PlanePlane
from algorithms.adjustment.removals import Removal
from algorithms.adjustment.reports import CorrespondenceReport
from tests.scenes.buildings.plane_rooms import observed_rooms, plane_rooms
from tests.scenes.lines.line_scenes import ObservedPair

KEEP_ALL = AdjustmentOptions(max_removed_share=0.0)
SEED = 4


@cache
def rooms_and_planes() -> tuple[ObservedPair, PlanePlane]:
    pair = observed_rooms(plane_rooms(np.random.default_rng(SEED)), np.random.default_rng(SEED + 1))
    assert pair.planes is not None
    return pair, pair.planes


@cache
def undisturbed() -> LineAdjustment:
    return rooms_and_planes()[0].adjusted()


@cache
def with_a_plane() -> tuple[tuple[Removal, ...], int, np.ndarray]:
    """Move a matched plane that at least two edges depend on by 5 cm; give removals, its pair and its edges."""
    rng = np.random.default_rng(SEED)
    rooms = plane_rooms(rng)
    dependents = np.array([(rooms.edges == k).any(axis=1).sum() for k in range(len(rooms.normals))])
    plane = int(np.flatnonzero(rooms.matched & (dependents == 2))[0])
    pair = observed_rooms(rooms, rng, source_rooms=rooms.with_plane_moved(plane, 0.05))
    number = int(rooms.matched[:plane].sum())
    edges = np.flatnonzero((rooms.edges == plane).any(axis=1))
    return pair.adjusted(AdjustmentOptions()).removals, number, edges


@pytest.mark.parametrize("part", ["lines", "planes"])
def test_every_row_has_as_many_figures_as_components(part: str) -> None:
    report: CorrespondenceReport = getattr(undisturbed(), part)
    n, d = report.residuals.shape
    assert d == {"lines": 4, "planes": 3}[part]
    for table in (report.residual_std, report.w, report.redundancy, report.controlled, report.detectable):
        assert table.shape == (n, d)
    assert report.effects.shape == (n, d, 6)
    assert report.global_effects.shape == (n, d)
    for column in (report.statistics, report.degrees, report.critical, report.critical_b_method, report.p_values):
        assert column.shape == (n,)


def test_redundancy_of_lines_and_planes_together_is_that_of_the_adjustment() -> None:
    result = undisturbed()
    # lines and planes are bound by shared planes: the sum holds for both together only
    assert result.lines.redundancy.sum() + result.planes.redundancy.sum() == pytest.approx(result.redundancy, abs=1e-6)


def test_an_undetected_error_of_a_plane_moves_the_pose_by_the_reported_effect() -> None:
    pair, planes = rooms_and_planes()
    clean = undisturbed()
    k = int(np.argmax(np.linalg.norm(clean.planes.effects[:, 2, 3:], axis=1)))
    number = int(planes.pairs[k, 0])
    centroids = planes.target.centroids.copy()
    centroids[number] -= clean.planes.detectable[k, 2] * planes.target.normals[number]
    planes = replace(planes, target=replace(planes.target, centroids=centroids))
    disturbed = adjust_lines(
        pair.target, pair.source, pair.correspondences, pair.start, planes=planes, options=KEEP_ALL
    )
    moved = disturbed.pose.target_from_source * clean.pose.target_from_source.inv()
    shift = moved.apply(clean.centroid_m) - clean.centroid_m
    effect = clean.planes.effects[k, 2]
    # the weights of a scene with errors differ a little from those of one without
    np.testing.assert_allclose(moved.rotation.as_rotvec(), effect[:3], atol=0.05 * np.linalg.norm(effect[:3]))
    np.testing.assert_allclose(shift, effect[3:], atol=0.05 * np.linalg.norm(effect[3:]))


def test_a_plane_is_named_with_its_edges() -> None:
    removals, number, edges = with_a_plane()
    by_plane = [removal for removal in removals if removal.plane is not None]
    named = {(removal.kind, removal.correspondence) for removal in by_plane}
    assert named == {("plane", 24 + number), *(("line", int(edge)) for edge in edges)}
    assert len({removal.plane for removal in by_plane}) == 1


def test_the_reason_of_a_plane_speaks_of_doors_not_of_statistics() -> None:
    removals, _, _ = with_a_plane()
    reasons = {removal.kind: removal.reason for removal in removals if removal.plane is not None}
    assert reasons["plane"].startswith("is plane P")
    assert reasons["line"].startswith("depends on plane P")
    assert "moved between the scans" in reasons["line"]
