"""Neither far coordinates nor a tilted instrument change an adjustment: pose, covariance, tests, removals."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.line_adjustment import LineAdjustment
from algorithms.adjustment.observations.plane_plane import PlanePlane
from algorithms.adjustment.options import AdjustmentOptions
from algorithms.geometry.line_motion import moved_lines
from algorithms.geometry.planes import Planes
from algorithms.geometry.poses import PoseEstimate
from tests.scenes.lines.line_scenes import ObservedPair
from tests.scenes.lines.planted_errors import PLANTED_ERRORS

FAR_M = np.array([4e5, -3e5, 200.0])
"""500 km, where neighbouring doubles are 6e-11 m apart."""
UPSET = RigidTransform.from_rotation(Rotation.from_euler("x", 90, degrees=True))
RELATIVE = 1e-5
"""Of test values: coordinates rounded to 6e-11 m against standard deviations of 0.1 mm."""
ERRORS = ("wrong correspondence among lines", "door opened 5 cm")
"""Free lines, and planes with their edges: with something to remove."""
MOTIONS = {
    "far target": (RigidTransform.from_translation(FAR_M), RigidTransform.identity()),
    "far source": (RigidTransform.identity(), RigidTransform.from_translation(-FAR_M)),
    "far scans": (RigidTransform.from_translation(FAR_M), RigidTransform.from_translation(FAR_M[::-1])),
    "tilted target": (UPSET, RigidTransform.identity()),
    "tilted source": (RigidTransform.identity(), UPSET),
    "far and tilted": (RigidTransform.from_translation(FAR_M) * UPSET, UPSET),
}
"""How the frames of target and source are moved."""


def moved_planes(planes: Planes, motion: RigidTransform) -> Planes:
    rotation = motion.rotation.as_matrix()
    return replace(
        planes,
        normals=planes.normals @ rotation.T,
        centroids=motion.apply(planes.centroids),
        bases=rotation @ planes.bases,
    )


def moved_pair(pair: ObservedPair, target: RigidTransform, source: RigidTransform) -> ObservedPair:
    """Give the pair in moved frames; the start as exactly as far coordinates allow."""
    planes = pair.planes
    if planes is not None:
        planes = PlanePlane(moved_planes(planes.target, target), moved_planes(planes.source, source), planes.pairs)
    return replace(
        pair,
        target=moved_lines(pair.target, target),
        source=moved_lines(pair.source, source),
        pose=target * pair.pose * source.inv(),
        start=target * pair.start * source.inv(),
        planes=planes,
    )


def drawn(error: str) -> ObservedPair:
    return PLANTED_ERRORS[error](np.random.default_rng(77)).pair


@cache
def adjusted(error: str, motion: str | None) -> LineAdjustment:
    """Adjust as drawn, or in moved frames."""
    pair = drawn(error) if motion is None else moved_pair(drawn(error), *MOTIONS[motion])
    return pair.adjusted(AdjustmentOptions())


every_case = pytest.mark.parametrize(("error", "motion"), [(error, motion) for error in ERRORS for motion in MOTIONS])


@every_case
def test_the_pose_moves_with_the_frames(error: str, motion: str) -> None:
    plain, moved = adjusted(error, None), adjusted(error, motion)
    target, source = MOTIONS[motion]
    back = target.inv() * moved.pose.target_from_source * source
    turn = (back.rotation * plain.pose.rotation.inv()).magnitude()
    assert turn < 1e-10  # rounding of coordinates over the size of the scene
    # where the features lie; far away the rounding of the rotation is multiplied by 500 km
    anchors = drawn(error).source.anchors
    at_lines = moved.pose.target_from_source.apply(source.apply(anchors))
    expected = target.apply(plain.pose.target_from_source.apply(anchors))
    np.testing.assert_allclose(at_lines, expected, atol=2e-9 if "far" not in motion else 5e-9)


@every_case
def test_the_covariance_at_the_features_turns_with_the_target(error: str, motion: str) -> None:
    plain, moved = adjusted(error, None), adjusted(error, motion)
    target = MOTIONS[motion][0]
    covariances = []
    for result, turn in ((plain, target.rotation), (moved, Rotation.identity())):
        # about the centroid of the lines: far from it standard deviations of t are lever arms
        there = PoseEstimate(RigidTransform.from_rotation(turn), np.zeros((6, 6))).after(result.pose)
        centroid = turn.apply(result.centroid_m)
        covariances.append((there.covariance[:3, :3], there.position_std_m(centroid)))
    scale = np.sqrt(np.outer(np.diag(covariances[0][0]), np.diag(covariances[0][0])))
    np.testing.assert_allclose(covariances[1][0] / scale, covariances[0][0] / scale, atol=RELATIVE)
    np.testing.assert_allclose(moved.centroid_std_m, covariances[0][1], rtol=RELATIVE)


@every_case
def test_the_same_correspondences_are_removed_in_the_same_order(error: str, motion: str) -> None:
    plain, moved = adjusted(error, None), adjusted(error, motion)
    histories = [[(r.step, r.change, r.kind, r.correspondence) for r in result.removals] for result in (plain, moved)]
    assert histories[0]
    assert histories[1] == histories[0]


@every_case
def test_test_values_stay(error: str, motion: str) -> None:
    plain, moved = adjusted(error, None), adjusted(error, motion)
    assert moved.omega == pytest.approx(plain.omega, rel=RELATIVE)
    assert moved.redundancy == plain.redundancy
    np.testing.assert_allclose(moved.lines.statistics, plain.lines.statistics, rtol=RELATIVE, atol=RELATIVE)
    np.testing.assert_allclose(moved.planes.statistics, plain.planes.statistics, rtol=RELATIVE, atol=RELATIVE)
    np.testing.assert_allclose(moved.lines.w, plain.lines.w, atol=RELATIVE)
    np.testing.assert_allclose(moved.lines.redundancy, plain.lines.redundancy, atol=RELATIVE)
