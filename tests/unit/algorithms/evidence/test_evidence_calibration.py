"""The constants of the evidence are those of the frozen pairs, and what is said of them is what these show."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from algorithms.evidence.calibration import CALIBRATION, Calibration
from tests.calibration.fit import held_out, loss
from tests.calibration.frozen import Frozen
from tests.calibration.pairs import Pairs
from tests.calibration.reliability import RISK, reliability


def test_no_other_constants_explain_the_frozen_pairs_better_than_those_in_force() -> None:
    calibration, pairs = Calibration.read(), Pairs(Frozen.read().arrays)
    assert calibration is not None
    assert calibration.pairs == len(pairs.starts)
    every, weights = np.ones(len(pairs.starts), dtype=bool), calibration.weights
    in_force = loss(pairs, weights, every)
    for name, value in asdict(weights).items():
        for factor in (0.95, 1.05):
            assert loss(pairs, replace(weights, **{name: factor * value}), every) > in_force or name == "elsewhere"


@pytest.mark.benchmark
def test_the_page_on_their_reliability_is_what_the_frozen_pairs_show() -> None:
    calibration, pairs = Calibration.read(), Pairs(Frozen.read().arrays)
    assert calibration is not None
    probability, best, _ = held_out(pairs)
    right = pairs.frozen["right"][best]
    accepted = probability >= 1.0 - RISK
    assert (accepted.sum(), (accepted & ~right).sum()) == (calibration.accepted, calibration.wrong)
    assert CALIBRATION.with_name("RELIABILITY.md").read_text() == reliability(pairs, probability, right, calibration)
