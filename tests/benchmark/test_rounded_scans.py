"""Standard deviations hold where coordinates are rounded: 40 simulated pairs, steps of 1 to 50 mm."""

import numpy as np
import pytest

from algorithms.registration.base import PairStatus
from tests.scenes.buildings.rounded_pairs import STEPS_M, rounded_pair

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(7200)]

PAIRS = 40
SEED = 20261125


@pytest.fixture(scope="module")
def pairs():
    found = []
    for number in range(PAIRS):
        found.append(rounded_pair(number, SEED))
        print(f"{number:3d} {found[-1].in_words()}", flush=True)
    for title, group in (
        *((f"{1e3 * step:.0f} mm", [pair for pair in found if pair.step_m == step]) for step in STEPS_M),
        ("parallel", [pair for pair in found if pair.parallel]),
        ("turned", [pair for pair in found if not pair.parallel]),
        ("all", found),
    ):
        nees = np.array([pair.nees for pair in group if np.isfinite(pair.error).all()])
        figures = f"mean {nees.mean():.2f} median {np.median(nees):.2f} max {nees.max():.1f}"
        print(f"{title:10s} {len(nees)} poses, NEES {figures}")
    return found


def test_every_accepted_pose_is_as_good_as_it_says(pairs):
    assert max(pair.nees for pair in pairs if pair.status is PairStatus.ACCEPTED) < 30.0


def test_the_mean_normalised_error_is_no_larger_than_of_honest_standard_deviations(pairs):
    # no lower bound: variances of lines and planes count four times (`UNEVEN_WALLS`), and these walls are even
    assert 0.0 < np.mean([pair.nees for pair in pairs if np.isfinite(pair.error).all()]) < 8.0


def test_most_pairs_of_fine_steps_are_accepted(pairs):
    fine = [pair for pair in pairs if pair.step_m <= 0.01]
    assert np.mean([pair.status is PairStatus.ACCEPTED for pair in fine]) > 0.8


def test_the_reasons_name_the_step_where_it_dominates(pairs):
    coarse = [pair for pair in pairs if pair.parallel and pair.step_m >= 0.02]
    assert all(any("coordinates are rounded to" in reason for reason in pair.reasons) for pair in coarse)
