"""The constants of the evidence are those of the frozen pairs, and what is said of them is what these show."""

from dataclasses import asdict

import numpy as np
import pytest

from algorithms.evidence.calibration import CALIBRATION, Calibration
from tests.calibration.fit import fitted, held_out
from tests.calibration.frozen import Frozen
from tests.calibration.pairs import Pairs
from tests.calibration.reliability import RISK, reliability


@pytest.mark.slow
def test_the_constants_in_force_are_those_that_the_frozen_pairs_give() -> None:
    calibration, pairs = Calibration.read(), Pairs(Frozen.read().arrays)
    assert calibration is not None
    assert calibration.pairs == len(pairs.starts)
    again = fitted(pairs, np.ones(len(pairs.starts), dtype=bool), calibration.weights)
    assert list(asdict(again).values()) == pytest.approx(list(asdict(calibration.weights).values()), abs=0.02)


@pytest.mark.benchmark
def test_the_page_on_their_reliability_is_what_the_frozen_pairs_show() -> None:
    calibration, pairs = Calibration.read(), Pairs(Frozen.read().arrays)
    assert calibration is not None
    probability, best, _ = held_out(pairs)
    right = pairs.frozen["right"][best]
    accepted = probability >= 1.0 - RISK
    assert (accepted.sum(), (accepted & ~right).sum()) == (calibration.accepted, calibration.wrong)
    assert CALIBRATION.with_name("RELIABILITY.md").read_text() == reliability(pairs, probability, right, calibration)
