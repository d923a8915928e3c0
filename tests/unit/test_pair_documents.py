"""What a pair's document says, and does not say."""

import numpy as np
import pytest

from algorithms.features.scan_features import ScanFeatures
from algorithms.quality.acceptance import Verification, judge
from algorithms.registration.base import PairResult, PairStatus
from schemas.registration_result import Pair
from service.use_cases.pair_documents import pair_document
from tests.unit.test_feature_store import some_features


def document(**verified: object) -> Pair:
    figures = {
        "overlap_decimetre": 0.5,
        "overlap_half_metre": 0.6,
        "rms_m": 0.004,
        "support_share": 0.5,
        "violation_share": 0.01,
        "score": 0.5,
        "free_space_known": True,
    }
    verification = Verification(**{**figures, **verified})
    result = PairResult(PairStatus.DOUBTFUL, ("a reason",), None, None, verification, ("translation along x",), "add")
    features: ScanFeatures = some_features()
    return pair_document(result, features, target="A", source="B", timings_s={})


def test_free_space_that_nobody_could_test_is_null_not_zero() -> None:
    overlap = document(free_space_known=False, violation_share=0.0).overlap
    assert overlap is not None
    assert overlap.free_space_violations is None


def test_the_fit_of_nothing_is_null_not_zero() -> None:
    overlap = document(overlap_decimetre=0.0, rms_m=0.0).overlap
    assert overlap is not None
    assert overlap.rms_m is None


def test_known_figures_are_given() -> None:
    overlap = document().overlap
    assert overlap is not None
    assert (overlap.rms_m, overlap.free_space_violations) == pytest.approx((0.004, 0.01))
    assert np.isfinite(overlap.rms_m or np.nan)


def test_what_is_free_is_named_without_a_standard_deviation() -> None:
    (weak,) = document().weak_directions
    assert (weak.text, weak.std_m, weak.advice) == ("translation along x", None, "add")


def test_reasons_claim_nothing_about_free_space_that_nobody_could_test() -> None:
    verification = Verification(0.5, 0.6, 0.004, 0.6, 0.0, 0.6, free_space_known=False)
    reasons = judge(verification, runner_up_score=0.0, supporters=50).reasons
    assert "is not known" in reasons[0]
    assert "0.0%" not in reasons[0]
