"""Stations, targets, registrations of scans and control in one adjustment."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.hybrid.station_frames import relative_to, smallest_trace
from algorithms.adjustment.hybrid.tied_stations import KnownPoints, adjust_tied_stations
from algorithms.errors import DegenerateGeometryError
from tests.scenes.tied_networks import TiedScene, motion_errors, tied_scene


def scene(seed: int = 3, **said: int) -> TiedScene:
    return tied_scene(np.random.default_rng(seed), **said)


def with_control_moved(known: TiedScene, point: int, shift_m: float) -> TiedScene:
    control = known.problem.control
    values = control.values.copy()
    values[point, 0] += shift_m
    return replace(known, problem=replace(known.problem, control=replace(control, values=values)))


def test_poses_are_known_to_their_standard_deviations_in_the_frame_of_the_control() -> None:
    known = scene()
    found = adjust_tied_stations(known.problem, known.poses)
    errors = motion_errors(found.poses, known.poses)
    assert errors @ np.linalg.solve(found.covariance, errors) < 60.0  # chi-square of 24, 0.01 %
    assert found.converged
    assert found.control.used.all()
    assert found.seen.used.all()
    assert found.scale is not None
    assert not found.scale.significant


def test_a_wrong_control_point_is_the_only_one_left_out() -> None:
    known = scene()
    found = adjust_tied_stations(with_control_moved(known, 2, 0.05).problem, known.poses)
    assert np.flatnonzero(~found.control.used).tolist() == [2]
    assert found.seen.used.all()
    np.testing.assert_allclose(found.control.residuals[2, 0], -0.05, atol=0.02)


def test_a_scale_of_the_control_is_told_and_no_control_point_is_blamed() -> None:
    known = scene()
    control = known.problem.control
    grown = replace(known.problem, control=replace(control, values=1.0004 * control.values))
    found = adjust_tied_stations(grown, known.poses)
    assert found.scale is not None
    assert found.scale.significant
    assert abs(found.scale.scale - 4e-4) < 4.0 * found.scale.std
    assert found.control.used.all()


def test_a_gross_error_beside_a_scale_is_found_all_the_same() -> None:
    known = with_control_moved(scene(control=7), 4, 0.08)
    control = known.problem.control
    grown = replace(known.problem, control=replace(control, values=1.0006 * control.values))
    found = adjust_tied_stations(grown, known.poses)
    assert np.flatnonzero(~found.control.used).tolist() == [4]
    assert found.scale is not None
    assert found.scale.significant


def test_a_wrong_target_is_left_out_by_the_other_stations() -> None:
    known = scene(scans=True)
    seen = known.problem.seen
    values = seen.values.copy()
    values[5] += [0.0, 0.04, 0.0]
    found = adjust_tied_stations(replace(known.problem, seen=replace(seen, values=values)), known.poses)
    assert seen.points[~found.seen.used].tolist() == [seen.points[5]]


def test_without_control_the_first_station_carries_the_frame() -> None:
    known = scene()
    free = replace(known.problem, control=KnownPoints.none())
    base, _ = relative_to(known.poses, np.zeros((24, 24)), 0)
    found = adjust_tied_stations(free, base)
    np.testing.assert_array_equal(found.covariance[:6], 0.0)
    errors = motion_errors(found.poses, base)[6:]
    assert errors @ np.linalg.solve(found.covariance[6:, 6:], errors) < 52.0  # chi-square of 18, 0.01 %


def test_scans_that_contradict_the_targets_are_told_by_their_test() -> None:
    known = scene(ties=8)
    scans = known.problem.scans[0]
    shifted = replace(scans, translations=scans.translations + np.array([0.0, 0.03, 0.0]))
    honest = adjust_tied_stations(known.problem, known.poses)
    wrong = adjust_tied_stations(replace(known.problem, scans=(shifted,)), known.poses)
    assert honest.scans[0].agrees
    assert not wrong.scans[0].agrees
    assert wrong.scans[0].p_value < 1e-6
    errors = motion_errors(wrong.poses, known.poses)
    assert errors @ np.linalg.solve(wrong.covariance, errors) < 60.0


def test_control_on_one_line_leaves_a_turn_free_and_is_refused() -> None:
    known = scene(stations=1, control=4, ties=0, scans=False)
    line = np.column_stack([np.linspace(-20.0, 20.0, 4), np.zeros(4), np.zeros(4)])
    seen = replace(known.problem.seen, values=line[known.problem.seen.points])
    problem = replace(known.problem, seen=seen, control=replace(known.problem.control, values=line))
    with pytest.raises(DegenerateGeometryError):
        adjust_tied_stations(problem, [RigidTransform.identity()])


def test_the_frame_of_a_station_and_that_of_the_smallest_trace_say_the_same_of_relative_poses() -> None:
    known = scene()
    found = adjust_tied_stations(known.problem, known.poses)
    told, covariance = relative_to(found.poses, found.covariance, 1)
    np.testing.assert_allclose(told[1].as_matrix(), np.eye(4), atol=1e-12)
    np.testing.assert_allclose(covariance[6:12], 0.0, atol=1e-15)
    free = smallest_trace(found.poses, found.covariance)
    assert np.trace(free) < np.trace(found.covariance)
    np.testing.assert_allclose(relative_to(found.poses, free, 1)[1], covariance, atol=1e-12)


def test_the_covariance_of_relative_poses_follows_differences() -> None:
    known = scene()
    rng = np.random.default_rng(0)
    covariance = np.eye(24)
    _, moved = relative_to(known.poses, covariance, 2)
    told, _ = relative_to(known.poses, covariance, 2)
    columns = []
    for k in range(24):
        step = np.zeros(24)
        step[k] = 1e-6
        poses = [
            RigidTransform.from_components(
                np.asarray(pose.translation) + step[6 * j + 3 : 6 * j + 6],
                Rotation.from_rotvec(step[6 * j : 6 * j + 3]) * pose.rotation,
            )
            for j, pose in enumerate(known.poses)
        ]
        columns.append(motion_errors(relative_to(poses, covariance, 2)[0], told) / 1e-6)
    jacobian = np.array(columns).T
    probe = rng.normal(size=24)
    np.testing.assert_allclose(moved @ probe, jacobian @ jacobian.T @ probe, atol=2e-3)
