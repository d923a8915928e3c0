"""Set-ups at random in buildings that hardly differ from themselves elsewhere. Run with -m benchmark -s for figures.

`TIELINE_REGULAR` sets how many buildings are scanned (one of each kind unless given), from three stations each,
`TIELINE_REGULAR_SEED` which (0), and `TIELINE_REGULAR_KINDS` of what kinds, by commas (all).
"""

import os
from collections import Counter
from itertools import combinations, product

import numpy as np
import pytest

from algorithms.progress import NoProgress
from algorithms.quality.overlap import verify_pose
from algorithms.registration import DEFAULT_METHOD
from algorithms.registration.base import PairStatus, RegistrationProblem
from tests.scenes.buildings.drawn_stations import ALL_BUILDINGS, WHOLE_SCENES, drawn_stations

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(2 * 3600)]
KINDS = os.environ.get("TIELINE_REGULAR_KINDS", ",".join([*ALL_BUILDINGS, *WHOLE_SCENES])).split(",")
COUNT, SEED = (int(os.environ.get(key, default)) for key, default in (
    ("TIELINE_REGULAR", len(KINDS)), ("TIELINE_REGULAR_SEED", 0)
))  # fmt: skip
WRONG_RAD, WRONG_M = np.radians(0.3), 0.05
"""A pose farther from the truth than this is another one."""
CLASSES = ((0.3, "30 % of the surface in common"), (0.1, "10 to 30 %"), (0.0, "less"))


def scans_of(kind, seed):
    """Give features and true pose of each of three scans of a building."""
    stations = drawn_stations(kind, np.random.default_rng([SEED, seed]))
    return [(each.features, each.world_from_reduced) for each in stations]


def pairs_of(kind, seed):
    """Give features and true pose of each pair of scans of a building."""
    for (target, world_from_target), (source, world_from_source) in combinations(scans_of(kind, seed), 2):
        yield target, source, world_from_target.inv() * world_from_source


def registered(target, source):
    return DEFAULT_METHOD().register(RegistrationProblem(target, source), progress=NoProgress())


def test_no_pair_is_accepted_wrong():
    table, wrong = Counter(), []
    for k in range(COUNT):
        kind = KINDS[k % len(KINDS)]
        for target, source, truth in pairs_of(kind, k):
            result = registered(target, source)
            right = False
            if result.final is not None:
                pose, centre = result.final.reduced.target_from_source, source.surface.points.mean(axis=0)
                turn = (pose.rotation * truth.rotation.inv()).magnitude()
                right = turn < WRONG_RAD and np.linalg.norm(pose.apply(centre) - truth.apply(centre)) < WRONG_M
            common = verify_pose(target, source, truth).support_share
            class_ = next(label for least, label in CLASSES if common >= least)
            table[kind, class_, result.status.value, "right" if right else "wrong or none"] += 1
            if result.status.in_place and not right:
                wrong.append(f"{kind} {k}, {common:.3f} of the surface in common")
    for key, count in sorted(table.items()):
        print(f"{count:4d}  {', '.join(key)}")
    assert not wrong


def test_no_pair_of_stations_in_two_buildings_of_one_kind_is_accepted():
    table, accepted = Counter(), []
    drawn = [kind for kind in KINDS if kind in ALL_BUILDINGS]
    for k in range(COUNT if drawn else 0):
        kind = drawn[k % len(drawn)]
        here, there = ([features for features, _ in scans_of(kind, seed)] for seed in (2 * k, 2 * k + 1))
        for target, source in product(here[:2], there[:2]):
            status = registered(target, source).status
            table[kind, status.value] += 1
            if status is PairStatus.ACCEPTED:
                accepted.append(f"{kind} {k}")
    for key, count in sorted(table.items()):
        print(f"{count:4d}  two of {', '.join(key)}")
    assert not accepted
