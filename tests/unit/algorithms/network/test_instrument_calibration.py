"""Is the scanner in adjustment, did the tripod stand still: told from what several stations see."""

from dataclasses import replace

import numpy as np
import pytest

from algorithms.network.instrument_calibration import (
    InstrumentCalibration,
    calibrate_instruments,
    widened_by_tolerances,
)
from algorithms.network.instrument_normals import columns_of, instrument_normals
from algorithms.network.instrument_responses import ALL_ERRORS, target_responses, without_instrument_errors
from algorithms.network.joint_adjustment import adjust_jointly
from algorithms.network.tied_network import RegisteredGroup, same_targets
from algorithms.scans.instrument_errors import DriftError, InstrumentError
from tests.scenes.buildings.instrument_networks import (
    SWEEP,
    InstrumentNetwork,
    TrueErrors,
    instrument_network,
    recorded,
)
from tests.scenes.buildings.instrument_tolerances import MGON, sought_in
from tests.scenes.lines.line_scenes import KEEP_ALL, pose_error

FINE_M = 1e-4
STATIONS = 4


def network_of(errors: TrueErrors, seed: int = 1, patch_std_m: float = FINE_M, *, upper: bool = True):
    return instrument_network(np.random.default_rng(seed), errors, STATIONS, patch_std_m=patch_std_m, upper=upper)


def calibrated(network: InstrumentNetwork, **options) -> InstrumentCalibration:
    sought = options.get("sought") or sought_in(STATIONS, **options)
    return calibrate_instruments(network.features, network.tracks, network.stations, network.start, sought)


def found_in(result: InstrumentCalibration, error, station: int = 0):
    return next(f for f in result.errors if f.sought.error is error and station in f.sought.stations)


TRUE = TrueErrors(vertical_index_rad=10.0 * MGON, range_offset_m=0.002)
SHARED = {InstrumentError.VERTICAL_INDEX: 10.0 * MGON, InstrumentError.RANGE_OFFSET: 0.002}


@pytest.fixture(scope="module")
def out_of_adjustment() -> tuple[InstrumentNetwork, InstrumentCalibration]:
    network = network_of(TRUE)
    return network, calibrated(network)


@pytest.mark.slow
def test_an_index_error_and_a_range_offset_are_found_and_nothing_else(out_of_adjustment) -> None:
    _, result = out_of_adjustment
    assert {found.sought.error for found in result.errors if found.significant} == {
        InstrumentError.VERTICAL_INDEX,
        InstrumentError.RANGE_OFFSET,
    }
    index, offset = (
        found_in(result, error) for error in (InstrumentError.VERTICAL_INDEX, InstrumentError.RANGE_OFFSET)
    )
    assert abs(index.value - 10.0 * MGON) < 3.0 * index.std < 3.0 * MGON
    assert abs(offset.value - 0.002) < 3.0 * offset.std < 0.0003


@pytest.mark.slow
def test_poses_are_right_once_the_errors_are_taken_off_and_wrong_before(out_of_adjustment) -> None:
    network, result = out_of_adjustment
    for k in range(1, STATIONS):
        error = pose_error(result.joint.pose(k), network.start[k])
        assert error @ np.linalg.solve(result.joint.covariance(k), error) < 22.5  # 99.9 %, 6 degrees of freedom
    worst = max(np.abs(pose_error(result.without.pose(k), network.start[k])[3:]).max() for k in range(1, STATIONS))
    right = max(np.abs(pose_error(result.joint.pose(k), network.start[k])[3:]).max() for k in range(1, STATIONS))
    assert right < 0.3 * worst


def test_an_instrument_in_adjustment_is_left_alone() -> None:
    result = calibrated(network_of(TrueErrors()))
    assert result.estimated == ()
    for k in range(1, STATIONS):
        np.testing.assert_array_equal(result.joint.pose(k).as_matrix(), result.without.pose(k).as_matrix())


def test_what_is_wanted_is_estimated_even_where_it_is_not_significant() -> None:
    network = network_of(TrueErrors())
    wanted = sought_in(STATIONS)
    wanted[0] = replace(wanted[0], wanted=True)
    result = calibrated(network, sought=wanted)
    (found,) = result.estimated
    assert found.sought.error is InstrumentError.VERTICAL_INDEX
    assert abs(found.value) < 3.0 * found.std
    # the poses are known no better for it
    assert np.linalg.eigvalsh(result.joint.covariance(2) - result.without.covariance(2)).min() > -1e-15


@pytest.mark.slow
def test_a_scale_that_all_set_ups_share_cannot_be_told_without_a_known_length() -> None:
    found = found_in(calibrated(network_of(TrueErrors(range_scale=5e-5))), InstrumentError.RANGE_SCALE)
    assert not found.determined
    assert not found.significant
    assert np.isinf(found.std)


@pytest.mark.slow
def test_noise_makes_no_scale_of_the_whole_network_significant() -> None:
    """In this network it did, by 18 standard deviations, and moved all stations by decimetres."""
    network = instrument_network(np.random.default_rng(46), TRUE, 6, patch_std_m=0.0005, targets=12)
    result = calibrated(network, sought=sought_in(6))
    assert not found_in(result, InstrumentError.RANGE_SCALE).significant
    for k in network.stations[1:]:
        error = pose_error(result.joint.pose(k), network.start[k])
        assert error @ np.linalg.solve(result.joint.covariance(k), error) < 40.0


@pytest.mark.slow
def test_a_trunnion_error_is_not_known_where_nothing_stands_high_or_low() -> None:
    low, high = (
        found_in(calibrated(network_of(TrueErrors(), upper=upper)), InstrumentError.TRUNNION) for upper in (False, True)
    )
    assert low.std > 1.5 * high.std


@pytest.mark.slow
def test_a_tripod_that_turns_during_its_scan_is_found_and_named() -> None:
    drifts = ((0.0, 0.0, 0.0), (0.0, 0.0, 8.0 * MGON), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    result = calibrated(network_of(TrueErrors(drifts_rad=drifts), patch_std_m=5e-5), drifts=True)
    found = found_in(result, DriftError.HEADING, 1)
    assert found.significant
    assert abs(found.value - 8.0 * MGON) < 3.5 * found.std
    assert [f for f in result.errors if f.significant] == [found]


@pytest.mark.slow
def test_a_tripod_that_settles_is_told_from_one_that_turns_steadily() -> None:
    drifts = ((0.0,) * 6, (0.0, 0.0, 0.0, 0.0, 0.0, 12.0 * MGON), (0.0,) * 6, (0.0,) * 6)
    result = calibrated(network_of(TrueErrors(drifts_rad=drifts), patch_std_m=5e-5), drifts=True, order=2)
    found = found_in(result, DriftError.HEADING_BEND, 1)
    assert found.significant
    assert abs(found.value - 12.0 * MGON) < 3.5 * found.std
    assert [f for f in result.errors if f.significant] == [found]


@pytest.mark.slow
def test_stations_of_another_instrument_have_their_own_errors() -> None:
    network, good = network_of(TRUE), network_of(TrueErrors())
    features = {k: (network if k < 2 else good).features[k] for k in range(STATIONS)}
    sought = [replace(each, stations=stations) for stations in ((0, 1), (2, 3)) for each in sought_in(STATIONS)]
    result = calibrated(replace(network, features=features), sought=sought)
    assert {f.sought.stations for f in result.errors if f.significant} == {(0, 1)}


def test_stations_whose_instrument_stood_nobody_knows_where_are_named() -> None:
    network = network_of(TrueErrors())
    features = {**network.features, 2: replace(network.features[2], plane_responses=None)}
    assert calibrated(replace(network, features=features)).unknown_stations == (2,)


def with_targets(errors: TrueErrors, count: int = 12, **options) -> InstrumentNetwork:
    return instrument_network(np.random.default_rng(5), errors, STATIONS, targets=count, **options)


@pytest.mark.slow
def test_targets_alone_tell_of_the_instrument() -> None:
    network = with_targets(TRUE, planes=False)
    result = calibrated(network)
    assert {f.sought.error for f in result.errors if f.significant} == set(SHARED)
    for error, truth in SHARED.items():
        found = found_in(result, error)
        assert abs(found.value - truth) < 3.0 * found.std
    assert result.of_surfaces is None


@pytest.mark.slow
def test_targets_beside_planes_make_the_errors_better_known() -> None:
    network = with_targets(TRUE, patch_std_m=0.0005)
    both = calibrated(network)
    planes = calibrated(replace(network, tracks=replace(network.tracks, points=())))
    for error, truth in SHARED.items():
        found = found_in(both, error)
        assert found.std < 0.9 * found_in(planes, error).std
        assert abs(found.value - truth) < 3.0 * found.std
    # poses for whoever adjusts the targets later do not rest on them
    assert both.of_surfaces is not None
    for k in range(1, STATIONS):
        for pose, covariance in ((j.pose(k), j.covariance(k)) for j in (both.joint, both.of_surfaces)):
            error = pose_error(pose, network.start[k])
            assert error @ np.linalg.solve(covariance, error) < 22.5  # 99.9 %, 6 degrees of freedom
        gained = both.of_surfaces.covariance(k) - both.joint.covariance(k)
        assert np.trace(gained[3:, 3:]) > 0.0


def test_noise_tells_nothing_of_a_scale_that_all_stations_share() -> None:
    network = with_targets(TrueErrors(), planes=False)
    joint = adjust_jointly(network.features, network.tracks, network.stations, network.start, KEEP_ALL)
    columns = columns_of(network.stations, [(str(InstrumentError.RANGE_SCALE), network.stations)])
    normals = instrument_normals(network.features, joint, columns, 1)
    assert normals.information[0, 0] < 1e-12 * normals.alone[0]


def test_targets_answer_to_errors_as_recorded_points_do() -> None:
    places = np.array([[4.0, 3.0, 2.0], [-6.0, 1.0, -1.2], [0.5, -9.0, 0.3]])
    errors = TrueErrors(1e-6, 2e-6, 3e-6, 4e-6, 5e-6, ((1e-6, -2e-6, 3e-6, 2e-6, 1e-6, -1e-6),))
    values = np.array([1e-6, 2e-6, 3e-6, 4e-6, 5e-6, 1e-6, -2e-6, 3e-6, 2e-6, 1e-6, -1e-6])
    sensor = np.array([100.0, -50.0, 2.0])
    moved = recorded(places, errors, errors.drifts_rad[0]) - places
    np.testing.assert_allclose(target_responses(places + sensor, sensor, SWEEP) @ values, moved, atol=1e-9)


def test_targets_of_a_scanner_out_of_adjustment_are_the_same_within_the_tolerances() -> None:
    network = with_targets(TrueErrors(range_offset_m=0.008), count=20)
    sought = sought_in(STATIONS)
    poses = {k: network.start[k] for k in range(1, STATIONS)}
    group = RegisteredGroup(0, poses, np.zeros((6 * len(poses), 6 * len(poses))))
    stated = {k: each.targets for k, each in network.features.items()}
    truth = set(network.tracks.points)
    assert set(same_targets(widened_by_tolerances(network.features, sought), group)) == truth
    assert set(same_targets(stated, group)) != truth


@pytest.mark.slow
def test_contradictions_answer_to_errors_as_their_derivatives_say() -> None:
    network = with_targets(TrueErrors(), patch_std_m=0.001)
    stations = list(network.stations)
    joint = adjust_jointly(network.features, network.tracks, stations, network.start, KEEP_ALL)
    shared = [(str(each.error), each.stations) for each in sought_in(STATIONS, drifts=True, order=2)]
    columns = columns_of(stations, shared)
    normals = instrument_normals(network.features, joint, columns, len(shared))
    scales = np.sqrt(normals.alone)
    for number, (name, members) in enumerate(shared):
        step = 1e-6
        values = np.zeros(len(ALL_ERRORS))
        values[[str(error) for error in ALL_ERRORS].index(name)] = step
        features = {
            k: without_instrument_errors(each, values) if k in members else each for k, each in network.features.items()
        }
        moved = adjust_jointly(features, network.tracks, stations, network.start, KEEP_ALL)
        # what is left of the gradient, and the poses, follow linearly
        fewer = normals.gradient - instrument_normals(features, moved, columns, len(shared)).gradient
        np.testing.assert_allclose(
            fewer / scales, normals.information[:, number] * step / scales, atol=2e-3 * step * scales[number]
        )
        for k in range(1, STATIONS):
            turn = normals.by_error[6 * (k - 1) : 6 * k, number] * step
            np.testing.assert_allclose(pose_error(joint.pose(k), moved.pose(k)), turn, rtol=2e-3, atol=2e-9)
