"""Laws of the evidence: terms add up, one piece says no more than a bound, more for a pose never lowers its odds."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from algorithms.evidence.log_odds import Counts, LogOdds, Weights, log_odds
from algorithms.evidence.pose_evidence import PoseEvidence
from algorithms.evidence.posterior import posterior
from algorithms.matching.line_evidence import LineEvidence

WEIGHTS = Weights(4.0, 2.0, 0.5, 1.0, 0.15, 1.5, 0.1, 0.2, 1.0, 0.05, 6.0, -3.0, 2.0, -6.9)
PLAIN = PoseEvidence(np.array([3.0, 8.0]), np.array([1.0]), np.array([0.0]), LineEvidence(5, 4), 9, 20.0)


def evidence(*values: float, impossible: tuple[float, ...] = ()) -> LogOdds:
    """Poses of given log-odds, of which so much speaks against each."""
    against = np.array(impossible) if impossible else np.zeros(len(values))
    nothing = np.zeros(len(values))
    return LogOdds(np.array(values) - against, against, nothing, nothing, nothing)


def total(*poses: PoseEvidence) -> np.ndarray:
    return log_odds(Counts.of(poses), WEIGHTS).total


@pytest.mark.parametrize(
    ("change", "sign"),
    [
        ({"fitting": np.array([3.0, 9.0])}, 1),
        ({"fitting": np.array([3.0, 8.0, 1.0])}, 1),
        ({"through": np.array([2.0])}, -1),
        ({"beside": np.array([1.0])}, -1),
        ({"lines": LineEvidence(6, 5)}, 1),
        ({"lines": LineEvidence(6, 4)}, -1),
        ({"common": 10}, 1),
        ({"control": 21.0}, 1),
    ],
)
def test_what_speaks_for_a_pose_raises_its_odds_and_what_speaks_against_it_lowers_them(change: dict, sign: int) -> None:
    before, after = total(PLAIN, replace(PLAIN, **change))
    assert np.sign(after - before) == sign


@given(st.floats(0.0, 1e4))
def test_one_piece_in_free_space_costs_no_more_than_the_odds_that_it_moved(size: float) -> None:
    nothing = replace(PLAIN, through=np.zeros(0), beside=np.zeros(0))
    without, having = total(nothing, replace(PLAIN, through=np.array([size])))
    assert -WEIGHTS.against - 1e-9 <= having - without <= 0.0


def test_five_pieces_in_free_space_cost_five_times_as_much_as_one() -> None:
    nothing = replace(PLAIN, through=np.zeros(0), beside=np.zeros(0))
    one, five = (replace(PLAIN, through=np.full(n, 6.0), beside=np.zeros(n)) for n in (1, 5))
    without, of_one, of_five = total(nothing, one, five)
    assert of_five - without == pytest.approx(5.0 * (of_one - without))


@given(st.lists(st.floats(-50.0, 50.0), min_size=1, max_size=8), st.data())
def test_probabilities_sum_to_one_and_the_likeliest_is_the_best(values: list[float], data: st.DataObject) -> None:
    likeness = np.array([data.draw(st.floats(0.0, 5.0)) for _ in values])
    found = posterior(evidence(*values), likeness, WEIGHTS)
    assert found.poses.sum() + found.none + found.elsewhere == pytest.approx(1.0)
    assert found.poses[found.best] == found.poses.max()


@given(st.floats(0.0, 40.0), st.floats(0.0, 10.0))
def test_more_for_the_best_pose_never_makes_it_less_probable(lead: float, more: float) -> None:
    likeness = np.zeros(2)
    before, after = (posterior(evidence(5.0 + each, 5.0), likeness, WEIGHTS).poses[0] for each in (lead, lead + more))
    assert after >= before - 1e-12


def test_in_a_building_that_looks_like_itself_no_lead_makes_a_pose_certain() -> None:
    alike, unlike = (posterior(evidence(80.0, 30.0), np.array([0.0, like]), WEIGHTS).poses[0] for like in (4.5, 0.0))
    assert alike < 0.7 < unlike


def test_a_pose_that_chance_makes_is_no_pose() -> None:
    assert posterior(evidence(-4.0, -5.0), np.zeros(2), WEIGHTS).none > 0.9


def test_of_a_repetition_that_stands_in_free_space_less_is_left() -> None:
    alike = np.array([0.0, 4.5])
    clean, stained = (
        posterior(evidence(80.0, 30.0, impossible=(0.0, against)), alike, WEIGHTS).poses[1] for against in (0.0, -5.0)
    )
    assert stained < 0.01 * clean


def test_a_pose_that_no_piece_speaks_for_or_against_has_the_odds_of_the_rest() -> None:
    nothing = np.zeros(0)
    found = log_odds(Counts.of([replace(PLAIN, fitting=nothing, through=nothing, beside=nothing)]), WEIGHTS)
    assert found.fits.tolist() == found.impossible.tolist() == [0.0]
    assert found.total[0] == found.lines[0] + found.features[0] - WEIGHTS.chosen
