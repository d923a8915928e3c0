"""Poses from merged lines, lines of the scan and lines of photos together have an honest covariance."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.line_adjustment import LineAdjustment, adjust_lines
from algorithms.features.photo_lines.merged_lines import merge_lines
from algorithms.features.photo_lines.projection_options import MergeOptions
from algorithms.geometry.lines import Lines
from tests.scenes.lines.merged_line_scenes import DrawnRoom, drawn_room

pytestmark = pytest.mark.slow

EXACT = MergeOptions(alpha=1e-12, max_distance_m=1.0, rounding_std_m=0.0)
BOTH, ONLY_SCAN, ONLY_PHOTO = 3, 1, 6
"""Edges that scan and photo see, and those that only one of them sees."""
DRAWS = 80


def merged(room: DrawnRoom) -> tuple[Lines, Lines]:
    """The station's lines, and the true ones in the same order."""
    scan = np.arange(BOTH + ONLY_SCAN)
    photo = np.r_[0:BOTH, BOTH + ONLY_SCAN : BOTH + ONLY_SCAN + ONLY_PHOTO]
    result = merge_lines(room.cloud[scan], [room.part[photo]], [room.mount], EXACT)
    assert len(result.lines) == len(room.true)
    return result.lines, replace(room.true, covariances=np.tile(1e-14 * np.eye(4), (len(room.true), 1, 1)))


def adjusted(room: DrawnRoom) -> LineAdjustment:
    """The pose of the station against an errorless one, by lines; true: identity."""
    lines, true = merged(room)
    pairs = np.repeat(np.arange(len(lines), dtype=np.int64)[:, None], 2, axis=1)
    return adjust_lines(
        true, lines, pairs, RigidTransform.identity(),
        source_plane_covariances=room.planes, source_photo_covariances=room.mount[None],
    )  # fmt: skip


def normalised(adjustment: LineAdjustment) -> float:
    pose = adjustment.pose.target_from_source
    error = np.concatenate([pose.rotation.as_rotvec(), pose.translation])
    return float(error @ np.linalg.solve(adjustment.pose.covariance, error))


@pytest.fixture(scope="module")
def rooms() -> list[DrawnRoom]:
    rng = np.random.default_rng(1)
    return [drawn_room(rng, BOTH + ONLY_SCAN + ONLY_PHOTO, mount_std=(6e-4, 3e-3)) for _ in range(DRAWS)]


def test_poses_from_merged_lines_have_a_normalised_error_of_six(rooms: list[DrawnRoom]) -> None:
    squares = [normalised(adjusted(room)) for room in rooms]
    # 6 with a standard deviation of the mean of sqrt(12 / 80) = 0.39
    assert np.mean(squares) == pytest.approx(6.0, abs=1.1)


def test_residuals_of_merged_lines_are_as_large_as_expected(rooms: list[DrawnRoom]) -> None:
    ratios = [(a.omega, a.redundancy) for a in (adjusted(room) for room in rooms[:50])]
    omega, redundancy = np.sum(ratios, axis=0)
    # chi-square with 50 x 34 degrees of freedom: 1 +- 0.034
    assert omega / redundancy == pytest.approx(1.0, abs=0.1)
