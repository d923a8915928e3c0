"""The judgement of poses."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.features.scan_features import SurfaceSample
from algorithms.quality.acceptance import AMBIGUOUS_RATIO, AcceptanceStatus, Verdict, Verification, judge
from algorithms.quality.overlap import surface_distances
from algorithms.scans.pose_scores import PoseScores, score_poses, strict_limits
from algorithms.scans.surface_index import SurfaceIndex, direction_weights, surface_index

CLEAR = Verification(
    overlap_decimetre=0.7,
    overlap_half_metre=0.85,
    rms_m=0.01,
    support_share=0.6,
    violation_share=0.001,
    score=0.6,
    free_space_known=True,
    controlled_m2=5.0,
)


def _judged(verification: Verification, runner_up: float = 0.1, supporters: int = 30, others: int = 3) -> Verdict:
    return judge(verification, runner_up_score=runner_up, supporters=supporters, runner_up_supporters=others)


def room(sensor: np.ndarray, length: float = 9.0) -> SurfaceIndex:
    """A room of `length` x 6 x 3 m whose wall x = 0 has a niche, seen from inside."""
    step = 0.15
    parts = []
    for axis, value, inward in ((2, 0.0, 1), (2, 3.0, -1), (0, 0.0, 1), (0, length, -1), (1, 0.0, 1), (1, 6.0, -1)):
        others = [k for k in range(3) if k != axis]
        spans = [np.arange(0.5 * step, (length, 6.0, 3.0)[k], step) for k in others]
        a, b = (grid.ravel() for grid in np.meshgrid(*spans))
        wall = np.empty((len(a), 6))
        wall[:, axis], wall[:, others[0]], wall[:, others[1]] = value, a, b
        wall[:, 3:] = inward * np.eye(3)[axis]
        parts.append(wall)
    cloud = np.vstack(parts)
    niche = (cloud[:, 0] == 0.0) & (cloud[:, 1] > 1.0) & (cloud[:, 1] < 2.5)
    cloud[niche, 0] = -0.6
    return surface_index(np.ascontiguousarray(cloud[:, :3]), np.ascontiguousarray(cloud[:, 3:]), step, sensor)


def _scored(pose: RigidTransform, target: SurfaceIndex, source: SurfaceIndex) -> PoseScores:
    return score_poses(
        pose.rotation.as_matrix()[None],
        np.asarray(pose.translation)[None],
        target,
        source,
        points=4000,
        limits=strict_limits(0.002, 0.15),
    )


def test_a_room_fits_itself_and_violates_nothing() -> None:
    index = room(np.array([4.0, 3.0, 1.5]))
    scores = _scored(RigidTransform.identity(), index, index)
    # Points at the edges may find the other wall first.
    assert scores.support[0] > 0.95
    assert scores.violation[0] == 0.0


def test_a_shorter_room_laid_into_a_longer_one_stands_in_its_free_space() -> None:
    target, source = room(np.array([4.0, 3.0, 1.5])), room(np.array([3.0, 3.0, 1.5]), length=6.0)
    scores = _scored(RigidTransform.identity(), target, source)
    assert scores.violation[0] > 0.02


def test_a_floor_on_a_floor_alone_is_no_support() -> None:
    index = room(np.array([4.0, 3.0, 1.5]))
    turned = RigidTransform.from_components([12.0, 2.0, 0.0], Rotation.from_euler("z", 40.0, degrees=True))
    scores = _scored(turned, index, index)
    # A tenth of the floors still overlap; no wall does.
    assert scores.support[0] < 0.05


def test_unknown_sensor_positions_leave_free_space_unknown() -> None:
    index = room(np.array([4.0, 3.0, 1.5]))
    blind = surface_index(index.points, index.normals, index.spacing_m, None)
    assert not blind.knows_free_space
    shifted = RigidTransform.from_components([1.0, 0.0, 0.0], Rotation.identity())
    assert _scored(shifted, blind, blind).violation[0] == 0.0


def test_walls_weigh_as_much_as_the_larger_floor() -> None:
    normals = np.vstack([np.tile([0.0, 0.0, 1.0], (900, 1)), np.tile([1.0, 0.0, 0.0], (100, 1))])
    weights = direction_weights(normals)
    assert weights.mean() == pytest.approx(1.0)
    # Limits of the weights keep the ratio below full balance (9), yet the wall's say grows several times.
    assert weights[950] / weights[0] > 4.0


def test_distances_of_a_shifted_plane_are_the_shift() -> None:
    a, b = (grid.ravel() for grid in np.meshgrid(np.arange(20) * 0.1, np.arange(20) * 0.1))
    points = np.column_stack([a, b, np.zeros(len(a))])
    plane = SurfaceSample(
        points, np.tile([0.0, 0.0, 1.0], (len(a), 1)), np.zeros(len(a), dtype=np.int32), voxel_size_m=0.1
    )
    off, aside = surface_distances(plane, plane, RigidTransform.from_translation([0.02, 0.03, 0.05]))
    np.testing.assert_allclose(off, 0.05, atol=1e-12)
    assert np.quantile(aside, 0.8) == 0.0


def test_a_clear_pose_is_accepted() -> None:
    assert _judged(CLEAR).status is AcceptanceStatus.ACCEPTED


def test_a_runner_up_nearly_as_good_makes_the_pose_ambiguous() -> None:
    assert _judged(CLEAR, runner_up=0.55).status is AcceptanceStatus.AMBIGUOUS


def test_a_pose_on_which_hardly_anything_fits_is_rejected() -> None:
    assert _judged(replace(CLEAR, support_share=0.05, score=0.05), runner_up=0.0).status is AcceptanceStatus.REJECTED


def test_surface_in_free_space_rejects_however_much_fits() -> None:
    assert _judged(replace(CLEAR, violation_share=0.1)).status is AcceptanceStatus.REJECTED


def test_a_contradicted_pose_is_doubtful_when_another_one_comes_near() -> None:
    contradicted = replace(CLEAR, support_share=0.26, violation_share=0.014, score=0.25)
    assert _judged(contradicted, runner_up=0.11).status is AcceptanceStatus.DOUBTFUL
    assert _judged(contradicted, runner_up=0.02).status is AcceptanceStatus.ACCEPTED
    assert _judged(replace(contradicted, violation_share=0.001), runner_up=0.11).status is AcceptanceStatus.ACCEPTED


def test_a_middling_score_with_a_middling_runner_up_is_doubtful() -> None:
    assert _judged(replace(CLEAR, score=0.22), runner_up=0.15).status is AcceptanceStatus.DOUBTFUL


def test_few_common_features_are_a_doubt_with_a_figure() -> None:
    verdict = _judged(CLEAR, supporters=3)
    assert verdict.status is AcceptanceStatus.DOUBTFUL
    assert any("only 3 lines and planes" in reason for reason in verdict.reasons)


def test_without_free_space_more_is_asked() -> None:
    seen, blind = replace(CLEAR, score=0.4), replace(CLEAR, score=0.4, free_space_known=False)
    assert _judged(seen).status is AcceptanceStatus.ACCEPTED
    assert _judged(blind).status is AcceptanceStatus.DOUBTFUL


def test_many_common_features_make_up_for_a_low_score() -> None:
    low = replace(CLEAR, score=0.15)
    assert _judged(low, runner_up=0.03, supporters=60, others=4).status is AcceptanceStatus.ACCEPTED
    assert _judged(low, runner_up=0.03, supporters=20, others=4).status is AcceptanceStatus.DOUBTFUL


FAINT = replace(
    CLEAR, overlap_decimetre=0.1, overlap_half_metre=0.2, support_share=0.07, violation_share=0.0, score=0.07
)
"""Little in common, and nothing against it."""


def test_a_pose_with_little_in_common_is_rejected_when_others_are_as_clean() -> None:
    assert _judged(FAINT, runner_up=0.02).status is AcceptanceStatus.REJECTED


def test_the_only_pose_that_nothing_speaks_against_is_accepted_with_little_in_common() -> None:
    verdict = judge(FAINT, runner_up_score=0.0, supporters=3, lone_spotless=True)
    assert verdict.status is AcceptanceStatus.ACCEPTED
    assert "the only pose" in verdict.reasons[0]


def test_it_is_doubtful_with_so_little_in_common_that_chance_gives_as_much() -> None:
    verdict = judge(
        replace(FAINT, support_share=0.05, score=0.05), runner_up_score=0.0, supporters=3, lone_spotless=True
    )
    assert verdict.status is AcceptanceStatus.DOUBTFUL
    assert "by chance" in verdict.reasons[1]


def test_what_is_contradicted_in_the_final_pose_is_not_the_only_clean_one_any_more() -> None:
    stained = replace(FAINT, violation_share=0.005)
    assert judge(stained, runner_up_score=0.0, supporters=30, lone_spotless=True).status is AcceptanceStatus.REJECTED


def test_a_contradicted_pose_that_fits_as_well_is_no_rival_of_the_only_clean_one() -> None:
    verdict = judge(FAINT, runner_up_score=0.2, supporters=3, lone_spotless=True)
    assert verdict.status is AcceptanceStatus.ACCEPTED
    assert "scores 0.20" in verdict.reasons[0]


def test_where_an_instrument_is_unknown_nothing_is_clean() -> None:
    blind = replace(FAINT, free_space_known=False)
    assert judge(blind, runner_up_score=0.0, supporters=30, lone_spotless=True).status is AcceptanceStatus.REJECTED


@pytest.mark.parametrize(
    ("support", "conditions", "status"),
    [
        (0.04, 25, AcceptanceStatus.ACCEPTED),
        (0.04, 13, AcceptanceStatus.DOUBTFUL),
        (0.025, 40, AcceptanceStatus.DOUBTFUL),
    ],
)
def test_with_less_in_common_it_is_accepted_where_lines_and_planes_control_each_other(
    support: float, conditions: int, status: AcceptanceStatus
) -> None:
    faint = replace(FAINT, support_share=support, score=support)
    verdict = judge(faint, runner_up_score=0.0, supporters=8, lone_spotless=True, conditions=conditions)
    assert verdict.status is status
    plain = judge(faint, runner_up_score=0.0, supporters=8, conditions=conditions)
    assert plain.status is AcceptanceStatus.REJECTED


@pytest.mark.parametrize(
    ("ambiguity_ratio", "status"),
    [
        (0.5, AcceptanceStatus.AMBIGUOUS),
        (AMBIGUOUS_RATIO, AcceptanceStatus.AMBIGUOUS),
        (0.95, AcceptanceStatus.DOUBTFUL),
    ],
)
def test_a_caller_may_call_it_ambiguous_earlier_but_never_have_a_rival_overlooked(
    ambiguity_ratio: float, status: AcceptanceStatus
) -> None:
    rival = 0.85 * CLEAR.score
    verdict = judge(
        CLEAR, runner_up_score=rival, supporters=30, runner_up_supporters=3, ambiguity_ratio=ambiguity_ratio
    )
    assert verdict.status is status


def test_a_caller_who_asks_for_a_clearer_answer_is_told_of_a_lesser_rival() -> None:
    rival = {"runner_up_score": 0.6 * CLEAR.score, "supporters": 30, "runner_up_supporters": 3}
    assert judge(CLEAR, **rival).status is AcceptanceStatus.ACCEPTED
    assert judge(CLEAR, **rival, ambiguity_ratio=0.5).status is AcceptanceStatus.AMBIGUOUS
