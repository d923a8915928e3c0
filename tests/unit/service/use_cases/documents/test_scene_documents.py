"""What a viewer shows: where stations lie at each step, possible poses of a pair, how features fit."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from schemas.results.registration_result import Coarse, Pair, Station
from service.use_cases.documents.pose_documents import matrix_rows
from service.use_cases.documents.scene_documents import feature_fits, scene_pair, scene_stages, scene_station
from tests.unit.service.use_cases.documents.test_pair_documents import MIXED, adjusted
from tests.unit.service.use_cases.steps.test_feature_store import some_features
from tests.unit.service.use_cases.steps.test_registration_report import motion, pair, two_lines

FOUND, OTHER = motion(1.1, 11.0), motion(7.0, 60.0)


def searched(status: str = "accepted") -> Pair:
    coarse = Coarse(
        target_from_source=matrix_rows(FOUND),
        support=9,
        score=0.8,
        runner_up_support=8,
        runner_up_score=0.7,
        runner_up_target_from_source=matrix_rows(OTHER),
        hypotheses_tested=100,
    )
    return pair("A", "B", motion(1.0, 10.0), status).model_copy(update={"coarse": coarse})


def stations(*names: str) -> list[Station]:
    return [Station(name=name, status="unregistered", world_from_scan=None) for name in names]


def test_an_ambiguous_pair_has_the_answer_and_what_else_could_be() -> None:
    shown = scene_pair(searched("ambiguous"))
    assert [pose.name for pose in shown.poses] == ["answer", "search", "runner-up"]
    assert [pose.score for pose in shown.poses] == [None, 0.8, 0.7]
    assert np.array(shown.poses[2].target_from_source) == pytest.approx(OTHER.as_matrix())


def test_a_pair_without_any_pose_is_shown_with_its_reasons() -> None:
    shown = scene_pair(pair("A", "B", FOUND, "rejected").model_copy(update={"target_from_source": None}))
    assert (shown.poses, shown.reasons) == ([], ["a reason"])


def test_poses_of_pairs_are_chained_from_the_first_station_whichever_is_the_target() -> None:
    pairs = [pair("C", "B", motion(2.0, 0.0)), pair("A", "B", motion(1.0, 10.0))]
    by_name = {stage.name: stage.poses for stage in scene_stages(stations("A", "B", "C"), pairs)}
    assert list(by_name) == ["files", "search", "pairs", "result"]
    assert set(by_name["files"]) == {"A", "B", "C"}
    assert set(by_name["search"]) == {"A"}  # nothing was searched
    expected = motion(1.0, 10.0) * motion(2.0, 0.0).inv()
    assert np.array(by_name["pairs"]["C"]) == pytest.approx(expected.as_matrix())
    assert by_name["result"] == {}


def test_the_search_is_shown_also_where_its_pose_was_refused_and_the_adjustment_only_where_it_was_not() -> None:
    by_name = {stage.name: stage.poses for stage in scene_stages(stations("A", "B"), [searched("rejected")])}
    assert np.array(by_name["search"]["B"]) == pytest.approx(FOUND.as_matrix())
    assert set(by_name["pairs"]) == {"A"}


def test_better_pairs_come_first_where_several_ways_lead_to_a_station() -> None:
    pairs = [pair("A", "C", motion(5.0, 0.0), "doubtful"), pair("A", "B", FOUND), pair("B", "C", OTHER)]
    found = {stage.name: stage.poses for stage in scene_stages(stations("A", "B", "C"), pairs)}["pairs"]
    assert np.array(found["C"]) == pytest.approx((FOUND * OTHER).as_matrix())


def test_a_pose_of_a_pair_is_the_identity_of_its_target() -> None:
    alone = scene_stages(stations("A"), [])
    assert all(np.array(stage.poses["A"]) == pytest.approx(np.eye(4)) for stage in alone if stage.name != "result")
    assert RigidTransform.from_matrix(np.array(alone[0].poses["A"])).translation == pytest.approx(np.zeros(3))


def test_a_line_of_two_pairs_has_its_worst_state_and_its_largest_test_value() -> None:
    good, moved = adjusted(MIXED), adjusted(MIXED, moved=3)
    again = moved.model_copy(update={"target": "B", "source": "C"})
    fits = feature_fits([good, again])
    removed = next(entry for entry in moved.correspondences if entry.state == "removed")
    assert fits[removed.target_line].state == "removed"
    for entry in good.correspondences:
        assert entry.test is not None
        ratio = fits[entry.target_line].ratio
        assert ratio is not None
        assert ratio >= entry.test.statistic / entry.test.critical
    assert feature_fits([good.model_copy(update={"status": "rejected"})]) == {}


def test_features_are_in_the_coordinates_of_the_file_under_their_names_in_the_result() -> None:
    features = replace(some_features(), lines=two_lines())
    shown = scene_station("S 1", features, {})
    assert [line.id for line in shown.lines] == [f"S 1/L{k + 1}" for k in range(len(features.lines))]
    starts = features.lines.end_points[0] + features.origin_m
    assert np.array([line.start_m for line in shown.lines]) == pytest.approx(starts)
    assert all((line.state, line.ratio) == ("alone", None) for line in shown.lines)
    low, high = np.array(shown.bounds_m)
    assert (low <= features.surface.points + features.origin_m).all()
    assert (high >= features.surface.points + features.origin_m).all()
