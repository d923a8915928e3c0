"""What was ordered beside what was reached: kept only where figures say so and accepted registrations carry them."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.geometry.poses import PoseEstimate
from schemas.results.network import Network, NetworkLink
from schemas.results.registration_result import Station
from schemas.results.tolerance_check import StationPrecision
from service.use_cases.documents.pose_documents import fixed_pose_document
from service.use_cases.documents.tolerance_documents import station_precision, tolerance_check

ASKED = {"std_m": 0.003, "std_gon": 0.01}


def station(name: str, status: str = "registered") -> Station:
    return Station(
        name=name, status=status, world_from_scan=None if status == "unregistered" else fixed_pose_document(name)
    )


def precision(name: str, std_m: float | None, std_gon: float | None = 0.001, within: bool | None = True) -> Any:
    return StationPrecision(station=name, std_m=std_m, middle_std_m=std_m, std_gon=std_gon, within=within)


def network(*states: str) -> Network:
    return Network(
        links=[NetworkLink(target="A", source=f"S{k}", state=state) for k, state in enumerate(states)],
        loops=[],
        loop_variance_factor=1.0,
        loop_covariance_factor=1.0,
        covariance_factor=1.0,
        feature_share=1.0,
        adjustment=None,
        remarks=[],
    )


STATIONS = [station("A", "fixed"), station("B"), station("C")]


@pytest.mark.parametrize(
    ("precisions", "stations", "joined", "verdict"),
    [
        ([precision("B", 0.001), precision("C", 0.002)], STATIONS, network("used", "uncontrolled"), "met"),
        ([precision("B", 0.001), precision("C", 0.004, within=False)], STATIONS, None, "not-met"),
        (
            [precision("B", 0.001), precision("C", None, None, None)],
            [*STATIONS[:2], station("C", "unregistered")],
            None,
            "not-determined",
        ),
        (
            [precision("B", 0.004, within=False), precision("C", None, None, None)],
            [*STATIONS[:2], station("C", "unregistered")],
            None,
            "not-met",
        ),
        ([precision("B", None, None, None), precision("C", 0.001)], STATIONS, None, "not-determined"),
        ([precision("B", 0.001), precision("C", 0.001)], STATIONS, network("used", "confirmed"), "not-confirmed"),
    ],
)
def test_a_tolerance_is_kept_only_where_figures_and_verdicts_carry_it(
    precisions: list[StationPrecision], stations: list[Station], joined: Network | None, verdict: str
) -> None:
    check = tolerance_check(ASKED, precisions, stations, [], joined)
    assert check.verdict == verdict
    assert (check.reasons == []) == (verdict == "met")


def test_without_an_order_nothing_is_judged_and_what_was_reached_is_said() -> None:
    check = tolerance_check(None, [precision("B", 0.001, within=None)], STATIONS[:2], [], None)
    assert (check.verdict, check.std_m, check.reached_std_m) == ("none", None, 0.001)


def test_the_largest_of_all_stations_is_not_known_while_one_is_missing() -> None:
    check = tolerance_check(ASKED, [precision("B", 0.001), precision("C", None, None, None)], STATIONS, [], None)
    assert check.reached_std_m is None


def test_the_precision_of_a_shift_alone_is_the_same_everywhere() -> None:
    pose = RigidTransform.from_components([5.0, 1.0, 0.0], Rotation.from_euler("z", 0.4))
    estimate = PoseEstimate(pose, np.diag([0.0, 0.0, 0.0, 1e-6, 4e-6, 4e-6]))
    surface = np.random.default_rng(1).uniform(-9.0, 9.0, (300, 3))
    found = station_precision("B", estimate, surface, np.array([100.0, 0.0, 0.0]), {"std_m": 0.003})
    assert found.std_m == pytest.approx(0.003, rel=1e-9)
    assert found.middle_std_m == pytest.approx(0.003, rel=1e-9)
    assert found.std_gon == 0.0


def test_a_turn_counts_by_what_it_does_to_the_surface() -> None:
    """A rotation of 1e-4 rad about z moves points of a circle with radius 20 m by 2 mm."""
    estimate = PoseEstimate(RigidTransform.identity(), np.diag([0.0, 0.0, 1e-8, 0.0, 0.0, 0.0]))
    turns = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    circle = np.column_stack([20.0 * np.cos(turns), 20.0 * np.sin(turns), np.zeros(400)])
    found = station_precision("B", estimate, circle, np.zeros(3), {"std_m": 0.0019})
    assert found.std_m == pytest.approx(0.002, rel=1e-6)
    assert found.middle_std_m == pytest.approx(0.0, abs=1e-8)
    assert found.std_gon == pytest.approx(1e-4 * 200.0 / np.pi)
    assert found.within is False


def test_a_pose_with_a_free_motion_has_no_precision() -> None:
    estimate = PoseEstimate(RigidTransform.identity(), np.zeros((6, 6)), np.eye(6)[:, 3:4])
    assert station_precision("B", estimate, np.ones((3, 3)), np.zeros(3), ASKED).std_m is None
    assert station_precision("B", None, np.ones((3, 3)), np.zeros(3), ASKED).within is None


def test_figures_are_not_confirmed_where_targets_contradict_the_scans() -> None:
    doubted = station("B").model_copy(update={"reason": "targets and control contradict what the scans say"})
    check = tolerance_check(ASKED, [precision("B", 0.001)], [station("A", "fixed"), doubted], [], None)
    assert check.verdict == "not-confirmed"
    assert [(reason.code, reason.name) for reason in check.reasons] == [("contradicted", "B")]
