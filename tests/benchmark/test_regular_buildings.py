"""Set-ups at random in buildings that hardly differ from themselves elsewhere. Run with -m benchmark -s for figures.

`TIELINE_REGULAR` sets how many buildings are scanned (one of each kind unless given), from three stations each,
`TIELINE_REGULAR_SEED` which (0), and `TIELINE_REGULAR_KINDS` of what kinds, by commas (all).
"""

import os
from collections import Counter
from dataclasses import replace
from itertools import combinations, product

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.progress import NoProgress
from algorithms.quality.overlap import verify_pose
from algorithms.registration import DEFAULT_METHOD
from algorithms.registration.base import PairStatus, RegistrationProblem
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import simulate_stations
from algorithms.simulation.scene import scene_from_parts
from algorithms.simulation.scenes import SCENES
from algorithms.simulation.stations import station_pose
from tests.scenes.buildings.floor_plans import FLOOR_PLANS
from tests.scenes.buildings.random_setups import places_about_stations
from tests.scenes.buildings.regular_buildings import BUILDINGS
from tests.scenes.buildings.repetitive_buildings import REPETITIVE_BUILDINGS
from tests.scenes.buildings.turned_buildings import TURNED_BUILDINGS

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(2 * 3600)]
ALL_BUILDINGS = BUILDINGS | REPETITIVE_BUILDINGS | TURNED_BUILDINGS | FLOOR_PLANS
WHOLE_SCENES = ("office", "house", "pipe_hall", "street_square")
"""Scenes of the simulator, which stand as they are: only the set-ups are drawn."""
KINDS = os.environ.get("TIELINE_REGULAR_KINDS", ",".join([*ALL_BUILDINGS, *WHOLE_SCENES])).split(",")
COUNT, SEED = (int(os.environ.get(key, default)) for key, default in (
    ("TIELINE_REGULAR", len(KINDS)), ("TIELINE_REGULAR_SEED", 0)
))  # fmt: skip
SCANNER = VirtualScanner(rows=400, columns=960)
WRONG_RAD, WRONG_M = np.radians(0.3), 0.05
"""A pose farther from the truth than this is another one."""
CLASSES = ((0.3, "30 % of the surface in common"), (0.1, "10 to 30 %"), (0.0, "less"))


def building_of(kind, rng):
    """Give a scene and a function that draws a place for an instrument in it."""
    if kind in WHOLE_SCENES:
        scene = SCENES[kind]()
        return scene, places_about_stations(scene, rng)
    parts, place = ALL_BUILDINGS[kind](rng)
    return scene_from_parts(kind, parts, []), place


def scans_of(kind, seed):
    """Scan a building from three places, move each scan at random, and give features and true poses."""
    rng = np.random.default_rng([SEED, seed])
    scene, place = building_of(kind, rng)
    stations, scans = [], []
    for _ in range(3):
        x, y, *floor = place()
        height = sum(floor) + rng.uniform(1.4, 1.9)
        stations.append(station_pose((x, y, height), rng.uniform(0, 2 * np.pi), *rng.normal(0, 0.01, 2)))
    for station, scan in zip(stations, simulate_stations(scene, stations, SCANNER, rng), strict=True):
        motion = RigidTransform.from_components(rng.uniform(-30.0, 30.0, 3), Rotation.random(random_state=rng))
        points, sensor = np.ascontiguousarray(motion.apply(scan.points)), motion.apply(np.zeros(3))
        moved = replace(scan, points=points, sensor_m=sensor, grid=None)
        features = extract_features(moved, FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0))
        scans.append((features, station * motion.inv() * RigidTransform.from_translation(features.origin_m)))
    return scans


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
            if result.status is PairStatus.ACCEPTED and not right:
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
