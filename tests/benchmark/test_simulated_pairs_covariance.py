"""The covariance of poses is honest end to end: 200 simulated pairs of stations, none sharing a scan with another."""

import numpy as np
import pytest

from tests.scenes.buildings.simulated_pairs import band_of_mean, pair_error, table

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(7200)]

PAIRS = 200
SEED = 20261121


@pytest.fixture(scope="module")
def pairs():
    found = [pair_error(number, SEED) for number in range(PAIRS)]
    print("", *table(found), sep="\n")
    return found


@pytest.fixture(scope="module")
def accepted(pairs):
    return [pair for pair in pairs if pair.accepted]


def test_most_pairs_are_accepted(pairs, accepted):
    assert len(accepted) >= 0.9 * len(pairs)


def test_the_mean_normalised_error_lies_in_the_band_of_its_expectation(accepted):
    low, high = band_of_mean(len(accepted))
    assert low < np.mean([pair.nees for pair in accepted]) < high


def test_no_parameter_is_off_on_the_average(accepted):
    # six parameters at 0.1 % each, two-sided: chance fails once in 170 runs
    means = np.mean([pair.z for pair in accepted], axis=0) * len(accepted) ** 0.5
    assert np.abs(means).max() < 3.29


def test_every_parameter_scatters_as_its_standard_deviation_says(accepted):
    spread = np.std([pair.z for pair in accepted], axis=0)
    assert spread == pytest.approx(np.ones(6), abs=0.165)  # 3.3 sigma of a standard deviation from 200 values
