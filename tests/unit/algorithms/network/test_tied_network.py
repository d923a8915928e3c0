"""Stations laid on each other and on control by targets, with names and without."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.hybrid.station_frames import relative_to
from algorithms.errors import TooFewCorrespondencesError
from algorithms.geometry.point_sets import PointSet
from algorithms.network.tied_network import KnownTargets, RegisteredGroup, TiedNetwork, tied_network
from algorithms.targets.common_points import TargetSet
from tests.scenes.tied_networks import motion_errors

STD_M = 0.001
RNG = np.random.default_rng(11)
PLACES = np.column_stack([RNG.uniform(-20.0, 20.0, (9, 2)), RNG.uniform(0.0, 5.0, 9)])
POSES = tuple(
    RigidTransform.from_components([*place, 1.6], Rotation.from_euler("z", turn))
    for place, turn in zip(((0.0, 0.0), (8.0, 3.0), (-6.0, 9.0)), (0.3, 2.1, -1.2), strict=True)
)
SEEN = {0: [0, 1, 2, 3, 4, 5], 1: [2, 3, 4, 5, 6, 7], 2: [4, 5, 6, 7, 8, 0]}


def targets(*, named: bool, seed: int = 1) -> dict[int, TargetSet]:
    rng = np.random.default_rng(seed)
    found = {}
    for station, numbers in SEEN.items():
        places = POSES[station].inv().apply(PLACES[numbers]) + STD_M * rng.normal(size=(len(numbers), 3))
        names = tuple(f"P{k}" if named else None for k in numbers)
        found[station] = TargetSet(names, PointSet.with_std(places, STD_M))
    return found


def control(*checks: int) -> KnownTargets:
    numbers = [0, 2, 4, 6, 8]
    known = TargetSet(tuple(f"P{k}" for k in numbers), PointSet.with_std(PLACES[numbers], STD_M))
    return KnownTargets(known, np.isin(numbers, checks))


def registered(*stations: int, std: float = 0.002) -> RegisteredGroup:
    told, _ = relative_to([POSES[k] for k in stations], np.zeros((6 * len(stations), 6 * len(stations))), 0)
    size = 6 * (len(stations) - 1)
    covariance = np.diag(np.tile(np.array([1e-4, 1e-4, 1e-4, std, std, std]) ** 2, len(stations) - 1))
    assert covariance.shape == (size, size)
    return RegisteredGroup(stations[0], dict(zip(stations[1:], told[1:], strict=True)), covariance)


def statistic(found: TiedNetwork, truth: tuple[RigidTransform, ...]) -> float:
    errors = motion_errors(found.adjustment.poses, tuple(truth[station] for station in found.stations))
    return float(errors @ np.linalg.lstsq(found.adjustment.covariance, errors, rcond=1e-12)[0])


@pytest.mark.parametrize("named", [True, False], ids=["names", "distances"])
def test_stations_come_into_the_frame_of_the_control(named: bool) -> None:
    found = tied_network(targets(named=named), [], control(8))
    assert sorted(found.stations) == [0, 1, 2]
    assert found.in_control_frame
    assert statistic(found, POSES) < 43.0  # chi-square of 18, 0.1 %
    assert sorted(found.control) == [0, 1, 2, 3, 4]
    assert sorted(found.control_observations) == [0, 1, 2, 3]


def test_all_measurements_of_a_place_are_one_point() -> None:
    found = tied_network(targets(named=False), [], control())
    members: dict[int, set[int]] = {}
    for (station, target), point in found.points.items():
        members.setdefault(point, set()).add(SEEN[station][target])
    assert all(len(places) == 1 for places in members.values())
    assert len(members) == 9 - 1  # one place is seen once and is no control


def test_scans_carry_a_station_that_shares_no_target() -> None:
    told = targets(named=True)
    del told[2]
    found = tied_network(told, [registered(0, 1, 2)], control())
    assert sorted(found.stations) == [0, 1, 2]
    assert statistic(found, POSES) < 43.0
    assert found.adjustment.scans[0].agrees


def test_stations_are_named_of_which_scans_contradict_the_targets() -> None:
    honest = registered(0, 2)
    wrong = replace(honest, poses={2: RigidTransform.from_translation([0.0, 0.1, 0.0]) * honest.poses[2]})
    found = tied_network(targets(named=True), [wrong], control())
    assert [(test.agrees, own) for test, own in zip(found.adjustment.scans, found.scanned, strict=True)] == [
        (False, (0, 2))
    ]
    assert statistic(found, POSES) < 43.0


def test_a_group_without_targets_enough_stays_without_a_place() -> None:
    told = targets(named=True)
    told[2] = told[2].selected(np.array([0, 1]))
    found = tied_network(told, [], control())
    assert sorted(found.stations) == [0, 1]


def test_without_control_the_first_station_carries_the_frame() -> None:
    found = tied_network(targets(named=False), [], None)
    told, _ = relative_to(POSES, np.zeros((18, 18)), 0)
    assert not found.in_control_frame
    assert found.stations[0] == 0
    assert statistic(found, told) < 35.0  # chi-square of 12, 0.1 %


def test_check_points_alone_do_not_hold_the_frame_but_are_found() -> None:
    found = tied_network(targets(named=True), [], control(0, 2, 4, 6, 8))
    assert not found.in_control_frame
    assert sorted(found.control) == [0, 1, 2, 3, 4]


def test_control_that_nobody_sees_is_refused_with_the_number_found() -> None:
    far = control()
    strange = TargetSet(tuple(f"Q{k}" for k in range(5)), PointSet.with_std(3.0 * PLACES[:5], STD_M))
    with pytest.raises(TooFewCorrespondencesError, match="control points among the targets"):
        tied_network(targets(named=True), [], replace(far, targets=strange))
