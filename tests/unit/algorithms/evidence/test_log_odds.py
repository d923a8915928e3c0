"""Laws of the evidence: terms add up, and more for a pose never lowers its odds, nor more against it raises them."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from algorithms.evidence.log_odds import MOST_AHEAD, Counts, Weights, log_odds, of_impossible
from algorithms.evidence.pose_evidence import PoseEvidence
from algorithms.evidence.posterior import posterior

WEIGHTS = Weights(0.6, 0.4, 1.5, 0.75, 0.3, 0.5, 0.7, 4.5, -6.9)
PLAIN = PoseEvidence(np.array([3.0, 8.0]), np.array([1.0]), np.array([0.0]), 20.0)
OTHER = PoseEvidence(np.array([6.0]), np.array([4.0, 9.0]), np.array([2.0, 0.0]), 14.0)
NOTHING = np.zeros(0)


def total(*poses: PoseEvidence) -> np.ndarray:
    return log_odds(Counts.of(poses), WEIGHTS).total


@pytest.mark.parametrize(
    ("change", "sign"),
    [
        # twice as much surface of the same kind determines six parameters twice as well
        ({"fitting": np.array([6.0, 16.0]), "control": 20.0 + 6.0 * np.log(12.0 / 6.5)}, 1),
        ({"through": np.array([2.0])}, -1),
        ({"through": np.array([1.0, 1.0]), "beside": np.zeros(2)}, -1),
        ({"beside": np.array([1.0])}, -1),
        ({"control": 21.0}, 1),
    ],
)
def test_what_speaks_for_a_pose_raises_its_odds_and_what_speaks_against_it_lowers_them(change: dict, sign: int) -> None:
    before, after = (total(each, OTHER)[0] for each in (PLAIN, replace(PLAIN, **change)))
    assert np.sign(after - before) == sign


@given(st.floats(0.0, 1e3), st.floats(0.0, 1e3))
def test_of_surface_in_free_space_the_first_says_more_than_what_follows(before: float, more: float) -> None:
    clean, some, twice = (
        total(replace(PLAIN, through=np.array([size])), OTHER)[0] for size in (before, before + more, before + 2 * more)
    )
    assert clean - some >= some - twice - 1e-9


def test_a_pose_that_is_ahead_of_others_has_higher_odds_than_one_beside_its_like() -> None:
    ahead, beside = (log_odds(Counts.of([PLAIN, other]), WEIGHTS) for other in (OTHER, PLAIN))
    assert ahead.ahead[0] > 0.0 == beside.ahead[0]
    assert ahead.ahead[1] < 0.0


@pytest.mark.parametrize("others", [[], [replace(OTHER, control=0.0, through=np.full(9, 1e9), beside=np.zeros(9))]])
def test_no_pose_is_farther_ahead_than_one_that_stands_alone(others: list[PoseEvidence]) -> None:
    assert log_odds(Counts.of([PLAIN, *others]), WEIGHTS).ahead[0] == WEIGHTS.ahead * MOST_AHEAD


def test_pairs_side_by_side_are_weighed_as_each_alone() -> None:
    pairs = [[PLAIN, OTHER], [OTHER], [OTHER, PLAIN, replace(PLAIN, control=25.0)]]
    alone = [Counts.of(pair) for pair in pairs]
    names = ("fits", "through", "beside", "fitting", "against", "control")
    numbers = np.repeat(np.arange(3), [len(pair) for pair in pairs])
    joined = Counts(*(np.concatenate([getattr(each, name) for each in alone]) for name in names), numbers)
    expected = np.concatenate([log_odds(each, WEIGHTS).total for each in alone])
    np.testing.assert_allclose(log_odds(joined, WEIGHTS).total, expected, atol=1e-12)


def test_what_is_usual_for_a_pair_is_that_of_its_middle_pose() -> None:
    parts = log_odds(Counts.of([PLAIN, OTHER, replace(PLAIN, through=np.array([300.0]))]), WEIGHTS)
    np.testing.assert_allclose(parts.usual, -WEIGHTS.usual * np.median(parts.free_space + parts.beside), atol=1e-12)


@given(st.lists(st.floats(0.0, 50.0), min_size=1, max_size=6))
def test_each_piece_against_a_pose_takes_off_what_the_pose_has_more_without_it(sizes: list[float]) -> None:
    through, beside = np.array(sizes), np.array(sizes)[::-1] / 2.0
    pose = replace(PLAIN, through=through, beside=beside)
    said = of_impossible(through, beside, pose, WEIGHTS)
    for k in range(len(sizes)):
        rest = replace(pose, through=np.delete(through, k), beside=np.delete(beside, k))
        with_it, without = (log_odds(Counts.of([each]), WEIGHTS) for each in (pose, rest))
        own = [each.free_space[0] + each.beside[0] + each.pieces[0] for each in (with_it, without)]
        assert said[k] == pytest.approx(own[0] - own[1], abs=1e-9)


@given(st.lists(st.floats(-800.0, 800.0), min_size=1, max_size=8))
def test_probabilities_sum_to_one_and_the_likeliest_is_the_best(values: list[float]) -> None:
    found = posterior(np.array(values), WEIGHTS.elsewhere)
    assert found.poses.sum() + found.none + found.elsewhere == pytest.approx(1.0)
    assert found.poses[found.best] == found.poses.max()


@given(st.floats(0.0, 40.0), st.floats(0.0, 10.0))
def test_more_for_the_best_pose_never_makes_it_less_probable(lead: float, more: float) -> None:
    before, after = (posterior(np.array([5.0 + each, 5.0]), -6.9).poses[0] for each in (lead, lead + more))
    assert after >= before - 1e-12


def test_no_lead_makes_a_pose_more_probable_than_that_no_like_place_exists() -> None:
    found = posterior(np.array([500.0]), WEIGHTS.elsewhere)
    assert found.poses[0] == pytest.approx(1.0 / (1.0 + np.exp(WEIGHTS.elsewhere)))


def test_a_pose_that_chance_makes_is_no_pose() -> None:
    assert posterior(np.array([-4.0, -5.0]), WEIGHTS.elsewhere).none > 0.9


def test_a_pose_that_no_piece_speaks_for_or_against_is_weighed_too() -> None:
    empty = replace(PLAIN, fitting=NOTHING, through=NOTHING, beside=NOTHING, control=0.0)
    found = log_odds(Counts.of([empty]), WEIGHTS)
    assert found.pieces[0] == found.determined[0] == 0.0
    assert np.isfinite(found.total[0])
