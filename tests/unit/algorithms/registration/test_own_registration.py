"""The dissertation's voting and iterative closest lines, on pipes without a scanner."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.alshawa import adjust_alshawa
from algorithms.adjustment.plucker_adjustment import adjust_plucker
from algorithms.errors import TooFewCorrespondencesError
from algorithms.features.scan_features import ScanFeatures, SurfaceSample
from algorithms.geometry.cylinders import Cylinders
from algorithms.geometry.line_motion import moved_lines
from algorithms.geometry.line_pairs_geometry import LinePairs, line_pairs_of
from algorithms.geometry.lines import Lines, LineSource, lines_from_arrays
from algorithms.registration.base import RegistrationProblem
from algorithms.registration.compat_matching import (
    CASES,
    DISTINCT_CASES,
    PairRelation,
    correspondence_matrix,
    described_pairs,
    match_by_pairs,
    motions_of_cases,
)
from algorithms.registration.icl import IclMethod, IclStart
from algorithms.registration.icl_registration import closest_lines, start_of
from algorithms.registration.lines_compat import PairVotingOptions
from algorithms.registration.own_procedures import estimated
from tests.scenes.lines.feature_scenes import NO_PLANES
from tests.scenes.lines.line_scenes import LineScene, ObservedPair, axis_lines, generic_lines, observed_pair, pose_error

OPTIONS = PairVotingOptions()


def features(lines: Lines, origin_m: np.ndarray | None = None) -> ScanFeatures:
    """Take lines for the axes of pipes of one radius."""
    n = len(lines)
    axes = replace(
        lines,
        sources=np.full(n, int(LineSource.CYLINDER_AXIS), dtype=np.int32),
        parents=np.stack([np.arange(n), np.full(n, -1)], axis=1),
    )
    each = np.full(n, 0.1)
    pipes = Cylinders(axes, each, 0.01 * each, np.ones(n, dtype=bool), 30.0 * each, 0.01 * each, np.full(n, 500))
    surface = SurfaceSample(np.empty((0, 3)), np.empty((0, 3)), np.empty(0, dtype=np.int32), 0.1)
    origin = np.zeros(3) if origin_m is None else origin_m
    return ScanFeatures(axes, NO_PLANES, pipes, surface, None, origin, None, 0, 0.001)


def problem_of(pair: ObservedPair) -> RegistrationProblem:
    return RegistrationProblem(features(pair.target), features(pair.source))


def lines_through(points: list[list[float]], directions: list[list[float]]) -> Lines:
    n = len(points)
    extents = np.tile([-1.0, 1.0], (n, 1))
    return lines_from_arrays(np.array(points, float), np.array(directions, float), np.zeros((n, 4, 4)), extents)


def skew_pair() -> tuple[LinePairs, LinePairs, RigidTransform]:
    """A pair of lines that meet at 60 degrees in 1 m distance, in two frames."""
    source = lines_through([[2.0, 1.0, 0.0], [3.0, -1.0, 1.0]], [[1.0, 0.0, 0.0], [0.5, np.sqrt(0.75), 0.0]])
    motion = RigidTransform.from_components([1.0, -2.0, 3.0], Rotation.from_rotvec([0.3, -0.4, 1.1]))
    both = np.array([[0, 1]])
    return line_pairs_of(moved_lines(source, motion), both), line_pairs_of(source, both), motion


def test_the_sixteen_cases_are_listed_in_the_dissertations_order() -> None:
    assert CASES.shape == (16, 4)
    np.testing.assert_array_equal(CASES[:4, :2], [[0, 0], [0, 1], [1, 0], [1, 1]])
    np.testing.assert_array_equal(CASES[::4, 2:], [[1, 1], [-1, -1], [-1, 1], [1, -1]])


def test_only_eight_of_the_sixteen_cases_are_distinct() -> None:
    target, source, _ = skew_pair()
    rotations, translations = motions_of_cases(target, source)
    motions = np.concatenate([rotations[0].reshape(16, 9), translations[0]], axis=1).round(9)
    # the proper ones coincide; those that lay the second line beside its partner need not
    lead_first = motions_of_cases(target, source, DISTINCT_CASES)
    assert lead_first[0].shape[1] == 8
    proper = [k for k in range(16) if _lays_pair_on_pair(target, source, rotations[0, k], translations[0, k])]
    assert len(proper) == 8
    assert len(np.unique(motions[proper], axis=0)) == 4


def test_the_true_motion_is_among_the_cases() -> None:
    target, source, motion = skew_pair()
    rotations, translations = motions_of_cases(target, source)
    off = np.abs(rotations[0] - motion.rotation.as_matrix()).max(axis=(1, 2)) + np.abs(
        translations[0] - np.asarray(motion.translation)
    ).max(axis=1)
    assert off.min() < 1e-12


def test_pairs_are_told_apart_by_how_they_lie_to_each_other() -> None:
    lines = lines_through(
        [[0, 0, 0], [0, 0, 1], [0, 0, 0], [5, 0, 0.001], [0, 0, 0.5]],
        [[1, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, 1, 1]],
    )
    pairs = described_pairs(lines, OPTIONS)
    found = {(int(i), int(j)): PairRelation(int(r)) for (i, j), r in zip(pairs.numbers, pairs.relations, strict=True)}
    assert found[0, 1] is PairRelation.PARALLEL
    assert found[0, 2] is PairRelation.INTERSECTING
    assert found[0, 3] is PairRelation.IDENTICAL
    assert found[1, 2] is PairRelation.SKEW
    assert pairs.distances_m[[k for k, key in enumerate(found) if key == (0, 1)]] == pytest.approx(1.0)


def test_the_weight_says_how_many_metres_a_radian_counts() -> None:
    pairs = [
        described_pairs(lines_through([[0, 0, 0], [0, 0, height]], [[1, 0, 0], [np.cos(a), np.sin(a), 0]]), OPTIONS)
        for height, a in ((1.0, 1.0), (1.3, 1.1))
    ]
    assert correspondence_matrix(pairs[0], pairs[1], 0.0)[0, 0] == pytest.approx(0.3)
    assert correspondence_matrix(pairs[0], pairs[1], 5.0)[0, 0] == pytest.approx(0.8)


def test_pairs_of_generic_lines_vote_for_the_true_motion_and_name_the_lines() -> None:
    rng = np.random.default_rng(3)
    pair = observed_pair(generic_lines(rng, 12), rng, noise_m=0.001)
    match = match_by_pairs(pair.target, pair.source, OPTIONS)
    error = pose_error(match.target_from_source, pair.pose)
    assert np.linalg.norm(error[:3]) < 0.02
    assert np.linalg.norm(error[3:]) < 0.1
    true = {tuple(row) for row in pair.correspondences.tolist()}
    assert {tuple(row) for row in match.lines.tolist()} <= true
    assert len(match.lines) >= 10


def test_parallel_lines_vote_for_nothing() -> None:
    lines = lines_through([[0, 0, 0], [0, 1, 0], [0, 3, 2]], [[1, 0, 0]] * 3)
    with pytest.raises(TooFewCorrespondencesError, match="pairs of lines that look alike"):
        match_by_pairs(lines, lines, OPTIONS)


def test_closest_lines_settle_on_the_true_correspondences_from_a_rough_start() -> None:
    rng = np.random.default_rng(5)
    pair = observed_pair(generic_lines(rng, 15), rng, noise_m=0.002)
    off = RigidTransform.from_components([0.1, -0.1, 0.05], Rotation.from_rotvec([0.02, -0.03, 0.02]))
    method = IclMethod(max_angle_rad=0.2, max_distance_m=0.6)
    proposal = closest_lines(problem_of(pair), off * pair.pose, method)
    assert proposal.settled
    true = {tuple(row) for row in pair.correspondences.tolist()}
    assert {tuple(row) for row in proposal.lines.tolist()} <= true
    assert len(proposal.lines) >= 8
    assert np.linalg.norm(pose_error(proposal.start, pair.pose)[3:]) < 0.02


def test_closest_lines_that_may_not_go_on_are_called_unsettled() -> None:
    rng = np.random.default_rng(5)
    pair = observed_pair(generic_lines(rng, 15), rng, noise_m=0.002)
    assert not closest_lines(problem_of(pair), pair.pose, IclMethod(max_iterations=1)).settled


def test_the_identity_start_lays_the_files_coordinates_on_each_other() -> None:
    rng = np.random.default_rng(6)
    pair = observed_pair(axis_lines(rng), rng)
    origins = np.array([500_000.0, 5_300_000.0, 400.0]), np.array([500_010.0, 5_300_000.0, 402.0])
    problem = RegistrationProblem(features(pair.target, origins[0]), features(pair.source, origins[1]))
    start = start_of(problem, IclStart.IDENTITY, pair.pose)
    np.testing.assert_allclose(start.translation, origins[1] - origins[0], atol=1e-9)
    np.testing.assert_array_equal(start.rotation.as_matrix(), np.eye(3))


@pytest.mark.parametrize("estimate", [adjust_plucker, adjust_alshawa], ids=["lichtenstein", "alshawa"])
def test_far_reduced_coordinates_change_no_estimate(estimate: object) -> None:
    # without a known instrument the middle of the lines is the origin in which the estimator works
    rng = np.random.default_rng(7)
    pair = observed_pair(generic_lines(rng, 8), rng)
    away = RigidTransform.from_translation([3_000.0, -1_000.0, 200.0])
    near = estimated(problem_of(pair), estimate, pair.correspondences, pair.start)
    moved = RegistrationProblem(features(moved_lines(pair.target, away)), features(pair.source))
    far = estimated(moved, estimate, pair.correspondences, away * pair.start)
    back = away.inv() * far.pose.target_from_source
    np.testing.assert_allclose(pose_error(back, near.pose.target_from_source), 0.0, atol=1e-8)


def _lays_pair_on_pair(target: LinePairs, source: LinePairs, rotation: np.ndarray, translation: np.ndarray) -> bool:
    """Tell whether both lines come to lie on lines of the target."""

    def on(anchor: np.ndarray, direction: np.ndarray) -> bool:
        moved, turned = rotation @ anchor + translation, rotation @ direction
        gaps = [
            np.linalg.norm(np.cross(moved - a, d)) + np.linalg.norm(np.cross(turned, d))
            for a, d in (
                (target.anchors_a[0], target.directions_a[0]),
                (target.anchors_b[0], target.directions_b[0]),
            )
        ]
        return min(gaps) < 1e-9

    return on(source.anchors_a[0], source.directions_a[0]) and on(source.anchors_b[0], source.directions_b[0])


def test_a_scene_of_one_corner_is_no_scene_for_voting() -> None:
    scene = LineScene(np.zeros((3, 3)), np.eye(3))
    pair = observed_pair(scene, np.random.default_rng(8), noise_m=1e-4)
    match = match_by_pairs(pair.target, pair.source, OPTIONS)
    # three concurrent perpendicular lines fit in 24 ways: some motion wins, and the lines lie on each other in it
    assert len(match.lines) == 3
