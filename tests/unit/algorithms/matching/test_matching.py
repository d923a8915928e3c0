"""Poses found without a first guess on small simulated scans."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.errors import DegenerateGeometryError
from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.features.scan_features import ScanFeatures
from algorithms.matching import coarse_registration
from algorithms.matching.coarse_registration import CoarseRegistration, MatchingOptions, convinces, match_features
from algorithms.matching.correspondences import corresponding_lines, corresponding_planes, mutual_best
from algorithms.matching.hypotheses import RankedPoses
from algorithms.progress import NoProgress
from algorithms.scans.pose_scores import PoseScores
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import simulate_stations
from algorithms.simulation.scenes import SCENES

SCANNER = VirtualScanner(rows=200, columns=480, mixed_pixels=False)
OPTIONS = MatchingOptions()


@cache
def scene_features(name: str) -> tuple[list[ScanFeatures], list[RigidTransform]]:
    """Features of the first two stations, each scan moved by a random motion, and world_from_scan of the moved ones."""
    scene = SCENES[name]()
    scans = list(simulate_stations(scene, scene.stations[:2], SCANNER, np.random.default_rng(0)))
    features, poses = [], []
    for k, scan in enumerate(scans):
        rng = np.random.default_rng(40 + k)
        motion = RigidTransform.from_components(rng.uniform(-30.0, 30.0, 3), Rotation.random(random_state=70 + k))
        moved = replace(
            scan,
            points=np.ascontiguousarray(motion.apply(scan.points)),
            sensor_m=motion.apply(np.zeros(3) if scan.sensor_m is None else scan.sensor_m),
            grid=None,
        )
        features.append(extract_features(moved, FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0)))
        poses.append(scene.stations[k] * motion.inv())
    return features, poses


@cache
def hall() -> CoarseRegistration:
    features, _ = scene_features("pipe_hall")
    return match_features(features[0], features[1], OPTIONS)


def _errors(pose: RigidTransform, truth: RigidTransform, centre: np.ndarray) -> tuple[float, float]:
    turn = np.degrees((pose.rotation.inv() * truth.rotation).magnitude())
    return float(turn), float(np.linalg.norm(pose.apply(centre) - truth.apply(centre)))


def test_two_moved_scans_of_a_pipe_hall_find_each_other() -> None:
    features, poses = scene_features("pipe_hall")
    turn, shift = _errors(hall().target_from_source, poses[0].inv() * poses[1], features[1].surface.points.mean(axis=0))
    # Good enough to find correspondences: the fine adjustment needs 1 degree and 0.1 m.
    assert turn < 0.2
    assert shift < 0.03


def test_a_clear_answer_is_not_called_ambiguous() -> None:
    assert not hall().ambiguous


def test_the_runner_up_is_a_clearly_different_pose_with_a_lower_score() -> None:
    features, _ = scene_features("pipe_hall")
    answer = hall()
    assert answer.runner_up is not None
    turn, shift = _errors(answer.runner_up, answer.target_from_source, features[1].surface.points.mean(axis=0))
    assert turn > 4.5 or shift > 0.3
    assert answer.runner_up_score < answer.score


def test_hardly_anything_speaks_against_the_right_pose() -> None:
    answer = hall()
    against = answer.violation_share / (answer.violation_share + answer.support_share)
    assert against < 0.005


def test_the_same_scans_give_the_same_answer() -> None:
    features, _ = scene_features("pipe_hall")
    again = match_features(features[0], features[1], OPTIONS)
    np.testing.assert_array_equal(again.target_from_source.as_matrix(), hall().target_from_source.as_matrix())


def test_swapping_source_and_target_inverts_the_pose() -> None:
    features, _ = scene_features("pipe_hall")
    swapped = match_features(features[1], features[0], OPTIONS).inverted()
    # one direction is searched, so only the rounding of the inverse is left
    np.testing.assert_allclose(swapped.target_from_source.as_matrix(), hall().target_from_source.as_matrix(), atol=1e-9)
    assert swapped.runner_up is not None
    assert hall().runner_up is not None
    np.testing.assert_allclose(swapped.runner_up.as_matrix(), hall().runner_up.as_matrix(), atol=1e-9)


def test_swapping_source_and_target_changes_neither_scores_nor_words() -> None:
    features, _ = scene_features("pipe_hall")
    swapped, answer = match_features(features[1], features[0], OPTIONS), hall()
    for name in ("score", "support", "runner_up_score", "runner_up_support", "ambiguous", "reasons", "remarks"):
        assert getattr(swapped, name) == getattr(answer, name), name


def test_parallel_pipes_only_are_refused_with_rank_five() -> None:
    features, _ = scene_features("parallel_pipes")
    with pytest.raises(DegenerateGeometryError) as refusal:
        match_features(features[0], features[1], OPTIONS)
    assert refusal.value.rank == 5
    assert "translation along" in refusal.value.free_directions[0]


def test_a_single_plane_is_refused_with_rank_three() -> None:
    features, _ = scene_features("single_plane")
    with pytest.raises(DegenerateGeometryError) as refusal:
        match_features(features[0], features[1], OPTIONS)
    assert refusal.value.rank == 3


def test_corresponding_lines_lie_on_each_other() -> None:
    features, _ = scene_features("pipe_hall")
    pose = hall().target_from_source
    pairs = corresponding_lines(features[0], features[1], pose, max_angle_rad=0.03, max_distance_m=0.1)
    ours, theirs = features[0].lines, features[1].lines
    turned = pose.rotation.apply(theirs.directions[pairs[:, 1]])
    angles = np.linalg.norm(np.cross(turned, ours.directions[pairs[:, 0]]), axis=1)
    assert len(pairs) >= 4
    assert angles.max() < 0.03


def ranked(score: float, rival_score: float, *, rival_is_near: bool = False, violation: float = 0.0) -> RankedPoses:
    """Give the right pose of the pipe hall and a rival with made-up scores."""
    pose = hall().target_from_source
    away = RigidTransform.from_translation([0.01 if rival_is_near else 7.0, 0.0, 0.0])
    scores = np.array([score, rival_score])
    return RankedPoses((pose, away * pose), PoseScores(scores, np.array([violation, 0.0]), scores, scores), 2)


@pytest.mark.parametrize(
    ("score", "rival_score", "many", "enough"),
    [
        (0.5, 0.45, 10**6, True),  # a high score
        (0.3, 0.08, 5, True),  # many features in common, and a rival far behind
        (0.3, 0.08, 10**6, False),  # not so many features
        (0.3, 0.10, 5, False),  # a rival nearer behind
        (0.05, 0.0, 5, False),  # a score that no one believes
    ],
)
def test_a_high_score_or_many_features_and_no_rival_save_the_search_of_all_shifts(
    score: float, rival_score: float, many: int, enough: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    features, _ = scene_features("pipe_hall")
    poses = ranked(score, rival_score)
    monkeypatch.setattr(coarse_registration, "MANY_FEATURES", many)
    assert convinces(features[0], features[1], poses) == enough


@pytest.mark.slow
@pytest.mark.parametrize(("violation", "searched"), [(0.005, False), (0.02, True)])
def test_beside_a_high_score_all_shifts_of_a_repetition_are_searched_only_where_something_speaks_against_it(
    violation: float, searched: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A hall of equal bays was laid on itself fourteen metres off: the right pose was proposed by nothing."""
    features, _ = scene_features("pipe_hall")
    only = []

    def all_shifts(found: RankedPoses, *_: object, repetitions_only: bool = False) -> RankedPoses:
        only.append(repetitions_only)
        return found

    poses = ranked(0.5, 0.1, violation=violation)  # before anything is replaced: the hall itself is matched for it
    monkeypatch.setattr(coarse_registration, "rank_hypotheses", lambda *_, **__: poses)
    monkeypatch.setattr(coarse_registration, "with_all_shifts", all_shifts)
    match_features(features[0], features[1], OPTIONS)
    assert (True in only) == searched


def test_what_is_near_the_best_pose_is_no_rival(monkeypatch: pytest.MonkeyPatch) -> None:
    features, _ = scene_features("pipe_hall")
    poses = ranked(0.3, 0.29, rival_is_near=True)
    monkeypatch.setattr(coarse_registration, "MANY_FEATURES", 5)
    assert convinces(features[0], features[1], poses)


def test_a_rival_with_many_features_too_keeps_the_search(monkeypatch: pytest.MonkeyPatch) -> None:
    features, _ = scene_features("pipe_hall")
    monkeypatch.setattr(coarse_registration, "MANY_FEATURES", 5)
    monkeypatch.setattr(coarse_registration, "_supporters", lambda *_: 40)
    assert not convinces(features[0], features[1], ranked(0.3, 0.08))


def test_correspondences_are_one_to_one() -> None:
    features, _ = scene_features("pipe_hall")
    pose = hall().target_from_source
    for find in (corresponding_lines, corresponding_planes):
        pairs = find(features[0], features[1], pose, max_angle_rad=0.03, max_distance_m=0.1)
        assert len(np.unique(pairs[:, 0])) == len(np.unique(pairs[:, 1])) == len(pairs) > 0


def test_corresponding_planes_look_to_the_same_side() -> None:
    features, _ = scene_features("pipe_hall")
    pose = hall().target_from_source
    pairs = corresponding_planes(features[0], features[1], pose, max_angle_rad=0.03, max_distance_m=0.1)
    turned = pose.rotation.apply(features[1].planes.normals[pairs[:, 1]])
    assert np.einsum("ij,ij->i", turned, features[0].planes.normals[pairs[:, 0]]).min() > np.cos(0.03)


def test_only_mutual_best_pairs_count() -> None:
    cost = np.array([[1.0, 2.0, np.inf], [0.5, 3.0, np.inf], [np.inf, np.inf, np.inf]])
    np.testing.assert_array_equal(mutual_best(cost), [[1, 0]])
