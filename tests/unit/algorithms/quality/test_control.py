"""Planes that fit in a pose control each other, or they do not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.features.scan_features import ScanFeatures, SurfaceSample
from algorithms.geometry.lines import Lines
from algorithms.quality.acceptance import AcceptanceStatus, judge
from algorithms.quality.control import controlled_area_m2
from algorithms.quality.overlap import verify_pose
from algorithms.scans.pose_scores import strict_limits
from tests.scenes.buildings.indexed_rooms import walls
from tests.scenes.lines.feature_scenes import NO_CYLINDERS, NO_PLANES

FLOOR = ((0, 0, 0), (5, 0, 0), (0, 4, 0))
WALL_X = ((0, 0, 0), (0, 4, 0), (0, 0, 2.5))
WALL_Y = ((0, 0, 0), (0, 0, 2.5), (5, 0, 0))
CORNER = (FLOOR, WALL_X, WALL_Y)
BESIDE_A_DOOR = ((0, 5, 0), (0, 2, 0), (0, 0, 2.5))
"""The wall x = 0 goes on behind a gap."""
CUPBOARD = (((1.0, 2.0, 0), (0, 1.0, 0), (0, 0, 2.0)), ((2.0, 2.0, 0), (0, 0, 2.0), (1.0, 0, 0)))
"""Two faces of 2 m2, across x and across y; none of them faces up."""
TABLE = ((2.0, 0.5, 0.7), (1.5, 0, 0), (0, 1.0, 0))
MOTION = RigidTransform.from_components([3.0, -2.0, 0.7], Rotation.from_rotvec([0.4, -0.9, 1.3]))
HERE = RigidTransform.identity()
LIMITS = strict_limits(0.002, 0.1)


def scan(*rectangles, moved=HERE) -> ScanFeatures:
    points, normals = walls(*rectangles)
    sides = np.array([[a, b] for _, a, b in rectangles], float)
    across = np.cross(sides[:, 0], sides[:, 1])
    middles = np.array([corner for corner, _, _ in rectangles], float) + 0.5 * sides.sum(axis=1)
    n = len(rectangles)
    planes = replace(
        NO_PLANES,
        normals=moved.rotation.apply(across / np.linalg.norm(across, axis=1, keepdims=True)),
        centroids=moved.apply(middles),
        bases=np.zeros((n, 3, 2)),
        covariances=np.zeros((n, 3, 3)),
        noise_std_m=np.zeros(n),
        point_counts=np.zeros(n, np.int64),
        areas_m2=np.zeros(n),
        boundary_splits=np.zeros(n + 1, np.int64),
    )
    return ScanFeatures(
        lines=Lines.empty(),
        planes=planes,
        cylinders=NO_CYLINDERS,
        surface=SurfaceSample(
            moved.apply(points), moved.rotation.apply(normals), np.full(len(points), -1, np.int32), 0.1
        ),
        seen=None,
        origin_m=np.zeros(3),
        sensor_m=moved.apply([3.0, 2.5, 1.5]),
        point_count=len(points),
        noise_std_m=0.002,
    )


def control(*rectangles, moved=HERE) -> float:
    return controlled_area_m2(scan(*rectangles), scan(*rectangles, moved=moved.inv()), moved, LIMITS)


def test_a_corner_on_a_corner_controls_nothing() -> None:
    assert control(*CORNER) == pytest.approx(0.0, abs=0.01)


def test_two_pieces_of_one_wall_do_not_control_each_other() -> None:
    assert control(*CORNER, BESIDE_A_DOOR, *CUPBOARD[1:], TABLE) == pytest.approx(0.0, abs=0.01)


def test_every_direction_of_the_shift_must_be_controlled() -> None:
    assert control(*CORNER, *CUPBOARD) == pytest.approx(0.0, abs=0.01)


def test_what_is_left_is_the_smallest_second_surface_across_any_direction() -> None:
    assert control(*CORNER, *CUPBOARD, TABLE) == pytest.approx(1.5, rel=0.05)


def test_it_does_not_depend_on_the_frames_nor_on_which_scan_is_the_target() -> None:
    rectangles = (*CORNER, *CUPBOARD, TABLE)
    apart = control(*rectangles, moved=MOTION)
    assert apart == pytest.approx(control(*rectangles), rel=0.05)
    more, less = scan(*rectangles, BESIDE_A_DOOR), scan(*rectangles, moved=MOTION.inv())
    one_way = controlled_area_m2(more, less, MOTION, LIMITS)
    assert one_way == pytest.approx(controlled_area_m2(less, more, MOTION.inv(), LIMITS), rel=1e-9)


def test_scans_that_lie_nowhere_on_each_other_control_nothing() -> None:
    away = RigidTransform.from_translation([0.0, 0.0, 40.0])
    assert controlled_area_m2(scan(*CORNER), scan(*CORNER), away, LIMITS) == 0.0


CRATE = ((2.5, 1.0, 0.5), (0, 0, 1.0), (1.0, 0, 0))
"""A face that only one of the scans shows, where the other instrument looked through."""


@pytest.mark.parametrize(
    ("common", "more", "status"),
    [
        (CORNER, (), AcceptanceStatus.ACCEPTED),
        (CORNER, (CRATE,), AcceptanceStatus.DOUBTFUL),
        ((*CORNER, *CUPBOARD, TABLE), (CRATE,), AcceptanceStatus.ACCEPTED),
    ],
)
def test_a_corner_is_doubted_as_soon_as_something_speaks_against_it(common, more, status) -> None:
    verdict = judge(verify_pose(scan(*common), scan(*common, *more), HERE), runner_up_score=0.0, supporters=20)
    assert verdict.status is status
    assert any("single plane" in reason for reason in verdict.reasons) == (common is CORNER)


def test_a_corner_is_doubted_where_free_space_is_unknown() -> None:
    blind = replace(scan(*CORNER), sensor_m=None)
    verdict = judge(verify_pose(scan(*CORNER), blind, HERE), runner_up_score=0.0, supporters=20)
    assert verdict.status is AcceptanceStatus.DOUBTFUL
    assert "free space, which could tell, is not known" in verdict.reasons[-1]
