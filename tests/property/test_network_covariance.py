"""The joint adjustment of many stations is as good as it says (chi-square over simulated networks)."""

import numpy as np
import pytest
from scipy import stats

from algorithms.network.network_registration import register_network
from tests.scenes.buildings.station_networks import station_network
from tests.scenes.lines.line_scenes import pose_error

NETWORKS = 12
STATIONS = 6


@pytest.mark.slow
def test_errors_of_all_stations_together_and_of_each_are_as_large_as_their_covariance_says() -> None:
    rng = np.random.default_rng(1984)
    together, single, removed, used = [], [], 0, 0
    for _ in range(NETWORKS):
        network = station_network(rng, STATIONS)
        joint = register_network(network.features, network.links, network.names).joint
        assert joint is not None
        errors = [pose_error(joint.pose(k), network.true_pose(k)) for k in range(1, STATIONS)]
        stacked = np.concatenate(errors)
        together.append(stacked @ np.linalg.solve(joint.solution.cofactors, stacked))
        covariances = [joint.covariance(k) / joint.variance_factor for k in range(1, STATIONS)]
        single += [e @ np.linalg.solve(c, e) for e, c in zip(errors, covariances, strict=True)]
        removed += len(joint.removed)
        used += sum(len(track.members) for track in joint.tracks)
    freedom = 6 * (STATIONS - 1) * NETWORKS
    low, high = stats.chi2.ppf([0.0005, 0.9995], freedom) / freedom  # 99.9 %: the seed is fixed, the scenes are not
    assert low < np.sum(together) / freedom < high
    # stations of one network depend on each other: five of them count as about three
    spread = np.sqrt(12.0 / (len(single) * 3 / 5))
    assert abs(np.mean(single) - 6.0) < 3.3 * spread
    assert removed / used < 0.004  # the level is 0.1 % for each feature
