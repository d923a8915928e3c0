"""What the rules accept is not accepted where the evidence says that it is rather not the right place."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from algorithms.evidence.place import OtherPlace, Place
from algorithms.progress import NoProgress
from algorithms.registration import DEFAULT_METHOD, verdict
from algorithms.registration.base import PairStatus, RegistrationProblem
from tests.calibration.drawn_pairs import DrawnPair, drawn_pairs


@pytest.fixture(scope="module")
def carriage() -> DrawnPair:
    """A railway carriage with things that were moved: turned round it shows as much, and stands 2.3 m off."""
    return next(drawn_pairs("things", 106))


@pytest.mark.slow
def test_a_carriage_that_fits_turned_round_is_not_accepted_the_wrong_way(carriage: DrawnPair) -> None:
    problem = RegistrationProblem(carriage.target, carriage.source)
    result = DEFAULT_METHOD().register(problem, progress=NoProgress())
    assert result.place is not None
    assert result.place.probability < verdict.LEAST_PROBABILITY
    assert not result.status.in_place
    assert "right place is probable to" in " ".join(result.reasons)


@pytest.fixture(scope="module")
def found() -> tuple[RegistrationProblem, Place]:
    """Two scans whose place is beyond doubt, and what is said of it."""
    pair = next(drawn_pairs("coarse", 0))
    problem = RegistrationProblem(pair.target, pair.source)
    result = DEFAULT_METHOD().register(problem, progress=NoProgress())
    assert result.status is PairStatus.ACCEPTED
    assert result.place is not None
    return problem, result.place


@pytest.mark.slow
@pytest.mark.parametrize(("other", "status"), [(0.6, PairStatus.AMBIGUOUS), (0.1, PairStatus.DOUBTFUL)])
def test_where_another_place_is_more_probable_than_none_it_is_ambiguous(
    found: tuple[RegistrationProblem, Place], other: float, status: PairStatus, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, place = found
    others = (OtherPlace(RigidTransform.from_translation(np.ones(3)), other, 0.0),)
    said = replace(place, probability=0.1, others=others, none=0.9 - other)
    monkeypatch.setattr(verdict, "place_of", lambda *_: said)
    result = DEFAULT_METHOD().register(problem, progress=NoProgress())
    assert result.status is status
    assert f"another one that was found to {other:.0%}" in result.reasons[-1]
