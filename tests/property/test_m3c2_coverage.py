"""Where nothing changed, the level of detection is exceeded as often as it promises; a change is found as it says."""

import numpy as np
import pytest
from scipy import stats

from algorithms.deviations.m3c2 import M3C2, m3c2
from algorithms.deviations.options import M3C2Options
from algorithms.deviations.orientation import Side
from tests.scenes.deviation_scenes import CloudPair, pair_without_change

pytestmark = pytest.mark.slow

OPTIONS = M3C2Options(cylinder_radius_m=0.15, max_distance_m=0.3, normal_radii_m=(0.3,))
PAIRS = 200


def compared(pair: CloudPair, seed: int) -> M3C2:
    cores = pair.first[:: len(pair.first) // 300]
    rng = np.random.default_rng(seed)
    return m3c2(pair.first, pair.second, cores, pair.poses, OPTIONS, stated=Side(point_m=np.zeros(3)), rng=rng)


@pytest.mark.parametrize("pose_share", [0.0, 1.0], ids=["exact poses", "poses with errors"])
def test_without_change_one_of_twenty_core_points_exceeds_it(pose_share: float) -> None:
    rates = []
    for seed in range(PAIRS):
        found = compared(pair_without_change(seed, points=1200, pose_share=pose_share), seed)
        rates.append(found.significant[found.measured].mean())
    assert np.mean(rates) == pytest.approx(0.05, abs=0.01)


def test_without_the_covariance_of_the_poses_it_would_be_exceeded_far_too_often() -> None:
    rates = []
    for seed in range(40):
        found = compared(pair_without_change(seed, points=1200), seed)
        alone = np.sqrt(found.std_m**2 - found.pose_std_m**2)
        rates.append(np.mean(np.abs(found.distances_m) > 1.96 * alone))
    assert np.mean(rates) > 0.1


def test_five_millimetres_are_found_as_often_as_the_level_of_detection_says() -> None:
    found_share, stated = [], []
    for seed in range(PAIRS):
        pair = pair_without_change(seed, points=1200)
        ceiling = pair.second[:, 2] > 2.0  # moves away from the instrument, against its normal
        pair.second[ceiling, 2] += 0.005
        found = compared(pair, seed)
        changed = found.measured & (found.normals[:, 2] < -0.9)
        found_share.append(found.significant[changed].mean())
        ratio = found.levels_of_detection_m[changed] / found.std_m[changed]
        stated.append(stats.norm.sf(ratio - 0.005 / found.std_m[changed]).mean())
    assert np.mean(found_share) == pytest.approx(np.mean(stated), abs=0.05)
    assert np.mean(found_share) > 0.5
