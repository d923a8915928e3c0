"""Symmetric buildings: never wrong and accepted. Run with -m benchmark -s to see the figures.

`TIELINE_TRAPS` sets how many pairs of stations are tried (200 unless given; 1000 take about an hour and a half).
"""

import os
from collections import Counter

import pytest

from algorithms.simulation.symmetric_scenes import SYMMETRIC_SCENES
from tests.scenes.buildings.symmetric_pairs import ODDITIES, symmetric_pair

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(4 * 3600)]
COUNT = int(os.environ.get("TIELINE_TRAPS", "200"))


def test_no_wrong_pose_of_a_symmetric_building_is_accepted():
    names = list(SYMMETRIC_SCENES)
    pairs = [symmetric_pair(names[k % 4], 1000 + k // 16, ODDITIES[k // 4 % 4]) for k in range(COUNT)]
    table = Counter((p.scene, p.oddities, p.status.value, "right" if p.right else "wrong or none") for p in pairs)
    for key, count in sorted(table.items()):
        print(f"{count:4d}  {key[0]}, {key[1]} oddities: {key[2]}, {key[3]}")
    wrong = [p for p in pairs if p.wrong_and_accepted]
    for p in wrong:
        print(p)
    assert not wrong
