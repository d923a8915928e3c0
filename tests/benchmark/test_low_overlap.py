"""All pairs of stations of simulated buildings, by how much they overlap. Run with -m benchmark -s to see the figures.

`TIELINE_OVERLAP_SEED` sets the noise and the motions (5 unless given), `TIELINE_OVERLAP_SCENES` the scenes, by commas,
`TIELINE_OVERLAP_ROWS` how finely they are scanned: 750 rows, the default, are steps of 0.2 degrees and 1.3
million points a station; with 300 less is accepted.
"""

import os
from collections import Counter
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.progress import NoProgress
from algorithms.registration import DEFAULT_METHOD
from algorithms.registration.base import PairStatus, RegistrationProblem
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import simulate_stations
from algorithms.simulation.scenes import SCENES

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(2 * 3600)]
SEED = int(os.environ.get("TIELINE_OVERLAP_SEED", "5"))
CHOSEN = os.environ.get("TIELINE_OVERLAP_SCENES", "office,house,pipe_hall,street_square").split(",")
MOST_STATIONS = {"street_square": 6}
ROWS = int(os.environ.get("TIELINE_OVERLAP_ROWS", "750"))
SCANNER = VirtualScanner(rows=ROWS, columns=ROWS * 12 // 5)
CELL_M, NEAR_M = 0.1, 0.5
"""The overlap is the smaller share of occupied cells of one scan that have a cell of the other one near."""
TOLERANCE_RAD, TOLERANCE_M = np.radians(0.02 * 0.9), 0.003
"""What is asked of pairs that overlap by more than 30 %: 0.02 gon and 3 mm."""
WRONG_RAD, WRONG_M = np.radians(0.3), 0.05
"""A pose farther from the truth than this is another one."""
CLASSES = ((0.3, "from 30 %"), (0.16, "16 to 30 %"), (0.05, "5 to 16 %"), (0.0, "below 5 %"))


def stations_of(name):
    """Scan a scene, move each scan at random, and give features, poses, and occupied cells in the world."""
    scene, rng = SCENES[name](), np.random.default_rng(SEED)
    places = scene.stations[: MOST_STATIONS.get(name, 11)]
    for station, scan in zip(places, simulate_stations(scene, places, SCANNER, rng), strict=True):
        motion = RigidTransform.from_components(rng.uniform(-30.0, 30.0, 3), Rotation.random(random_state=rng))
        sensor = np.zeros(3) if scan.sensor_m is None else scan.sensor_m
        points = np.ascontiguousarray(motion.apply(scan.points))
        moved = replace(scan, points=points, sensor_m=motion.apply(sensor), grid=None)
        features = extract_features(moved, FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0))
        world = station.apply(scan.points)
        cells = world[np.unique(np.floor(world / CELL_M).astype(int), axis=0, return_index=True)[1]]
        yield features, station * motion.inv() * RigidTransform.from_translation(features.origin_m), cells


def overlap(first, second):
    shares = [
        np.isfinite(cKDTree(a).query(b, distance_upper_bound=NEAR_M)[0]).mean()
        for a, b in ((first, second), (second, first))
    ]
    return min(shares)


@pytest.mark.parametrize("name", CHOSEN)
def test_no_pair_is_accepted_wrong_and_all_that_overlap_well_are_accepted(name):
    stations = list(stations_of(name))
    table, wrong, missed, coarse = Counter(), [], [], []
    for i, j in combinations(range(len(stations)), 2):
        (target, world_from_target, ours), (source, world_from_source, theirs) = stations[i], stations[j]
        result = DEFAULT_METHOD().register(RegistrationProblem(target, source), progress=NoProgress())
        share = overlap(ours, theirs)
        class_ = next(label for least, label in CLASSES if share >= least)
        right = within = False
        if result.final is not None:
            pose, truth = result.final.reduced.target_from_source, world_from_target.inv() * world_from_source
            centre = source.surface.points.mean(axis=0)
            turn = float((pose.rotation * truth.rotation.inv()).magnitude())
            shift = float(np.linalg.norm(pose.apply(centre) - truth.apply(centre)))
            right = turn < WRONG_RAD and shift < WRONG_M
            within = turn <= TOLERANCE_RAD and shift <= TOLERANCE_M
        table[class_, result.status.value, "right" if right else "wrong or none"] += 1
        accepted = result.status is PairStatus.ACCEPTED
        label = f"{name} {i}-{j}, overlap {share:.2f}: {result.status.value}"
        if accepted and not right:
            wrong.append(label)
        if share >= CLASSES[0][0] and not accepted:
            missed.append(label)
        if share >= CLASSES[0][0] and accepted and not within:
            coarse.append(f"{label}, {np.degrees(turn) / 0.9:.4f} gon, {shift * 1e3:.1f} mm")
    for key, count in sorted(table.items()):
        print(f"{count:4d}  {name}, overlap {key[0]}: {key[1]}, {key[2]}")
    assert not wrong
    assert not missed
    assert not coarse
