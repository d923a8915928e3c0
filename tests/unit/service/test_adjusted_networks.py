"""Networks of many kinds through the process `adjust`, without the web: what comes out is what made them."""

import copy
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from algorithms.adjustment.hybrid.closed_forms import similarity
from algorithms.progress import NoProgress
from schemas.requests.adjust_inputs import AdjustInputs
from schemas.results.adjust_result import AdjustDocument
from service.processes.adjust.adjusting import adjusted_document
from tests.scenes.hybrid_networks import CAMERA, GON, STDS, hybrid_network

WITHOUT, TRUTH = hybrid_network(3, approximate=False)
GIVEN, _ = hybrid_network(3)


def adjusted(network: dict[str, Any], **options: Any) -> AdjustDocument:
    inputs = AdjustInputs.model_validate({"network": network} | options)
    return adjusted_document(inputs.model_dump(mode="json"), "job", NoProgress())[0]


def largest_miss(document: AdjustDocument, truth: dict[str, np.ndarray]) -> float:
    points = {p.id: np.array(p.xyz_m) for p in document.points if p.id in truth}
    ours, theirs = np.array(list(points.values())), np.array([truth[name] for name in points])
    _, rotation, shift = similarity(ours, theirs)
    return float(np.abs(ours @ rotation.T + shift - theirs).max())


def test_control_far_away_costs_no_digits() -> None:
    network, origin = copy.deepcopy(WITHOUT), np.array([500_000.0, 5_800_000.0, 100.0])
    network["observations"]["control"] = [
        {"point": k, "xyz": (TRUTH[k] + origin).tolist(), "std": 0.002} for k in ("1", "2", "3", "4", "5")
    ]
    document = adjusted(network, datum={"type": "control"})
    assert document.rank_defect == 0
    assert largest_miss(document, TRUTH) < 0.002
    assert np.abs(np.array(document.points[0].xyz_m) - TRUTH[document.points[0].id] - origin).max() < 0.01


def test_photos_alone_leave_the_scale_free() -> None:
    network, _ = hybrid_network(4, scanners=0, photos=6, approximate=False)
    document = adjusted(network, gross_errors="none")
    assert document.rank_defect == 7
    assert "scale" in document.datum.free_motions
    assert document.global_test.passed


def test_an_inclinometer_leaves_four_motions_free() -> None:
    network = copy.deepcopy(GIVEN)
    network["observations"]["tilts"] = [
        {"station": "S1", "omega": 0.0, "sigma_omega": 0.01, "phi": 0.0, "sigma_phi": 0.01}
    ]
    assert adjusted(network).datum.free_motions == [
        "translation along X", "translation along Y", "translation along Z", "rotation about Z"
    ]  # fmt: skip


def test_a_camera_with_a_wrong_principal_distance_is_calibrated() -> None:
    network = copy.deepcopy(WITHOUT)
    network["camera"] = {"id": "C", "principal_distance_px": 2900.0, "unknown": ["c", "x0", "y0"], "std": {"A1": 1e-9}}
    document = adjusted(network)
    found = {p.parameter: p for p in document.parameters}
    assert abs(found["c"].value - CAMERA["principal_distance_px"]) < 4.0 * (found["c"].std or 0.0)
    assert not found["x0"].significant
    assert largest_miss(document, TRUTH) < 0.002


@pytest.mark.parametrize("approximate_m", [1497.4, 1_497_402.0, -1.0e6])
def test_one_approximate_value_in_another_unit_changes_no_angle(approximate_m: float) -> None:
    """Of directions alone they give the scale as well: with a wrong one that is wrong too, and the shape is not."""
    places = {"A": (1000.0, 1000.0), "B": (1432.5, 1588.8), "C": (1497.4, 1000.0), "D": (1439.8, 640.3)}
    approximate = {name: [*place, 0.0] for name, place in places.items()}
    approximate["C"][0] = approximate_m
    polar = [
        {"station": f"S{at}", "point": to, "horizontal": _direction(places, at, to), "sigma_horizontal": 0.001}
        for at in places for to in places if to != at
    ]  # fmt: skip
    network = {
        "format": "hybrid-network/1", "units": {"length": "m", "angle": "gon", "image": "px"},
        "stations": [{"id": f"S{at}", "type": "scanner", "point": at, "levelled": True} for at in places],
        "points_approx": approximate, "observations": {"polar": polar},
    }  # fmt: skip
    document = adjusted(network)
    found = {point.id: point.xyz_m[:2] for point in document.points}
    for at in places:
        seen = [_direction(found, at, to) - _direction(places, at, to) for to in places if to != at]
        assert np.abs(np.remainder(np.array(seen) - seen[0] + 200.0, 400.0) - 200.0).max() < 1e-3
    wrong = approximate_m != places["C"][0]
    assert any("from its approximate value" in remark for remark in document.remarks) == wrong


def _direction(places: Any, at: str, to: str) -> float:
    dx, dy = np.subtract(places[to], places[at])
    return float(np.arctan2(dy, dx) * GON)


@pytest.mark.parametrize("state", ["constant", "observed", "unknown"])
@pytest.mark.parametrize("approximate", [True, False])
def test_photos_on_scanners_share_their_poses_and_tell_the_mount(state: str, approximate: bool) -> None:
    network, truth = hybrid_network(5, photos=0, scanners=4, approximate=approximate)
    turn, arm = Rotation.from_euler("ZYZ", [0.3, 1.5, 1.6]), np.array([0.1, 0.05, 0.2])
    mount: dict[str, Any] = {"id": "M", "state": state}
    if state != "unknown":
        angles = dict(zip(("alpha", "zeta", "kappa"), turn.as_euler("ZYZ") * GON, strict=True))
        mount["approx"] = dict(zip("XYZ", arm.tolist(), strict=True)) | angles
    if state == "observed":
        mount |= {"rotation_std": 0.05, "translation_std_m": 0.002}
    network["mounts"] = [mount]
    rng = np.random.default_rng(1)
    for k in range(4):
        base = Rotation.from_euler("XYZ", [0.02, -0.03, 1.9] if k else [0.0, 0.0, 0.0])
        place = np.array([2.5 * np.cos(2.0 * k), 2.5 * np.sin(2.0 * k), 0.4]) if k else np.zeros(3)
        network["stations"].append({"id": f"F{k}", "type": "photo", "carrier": f"S{k + 1}", "mount": "M"})
        for name, point in truth.items():
            x, y, z = (base * turn).inv().apply(point - place - base.apply(arm))
            if z < -0.3 and max(abs(x / z), abs(y / z)) < 1.0:
                image = -3000.0 * np.array([x, y]) / z + STDS["image"] * rng.normal(size=2)
                network["observations"]["image"].append({
                    "photo": f"F{k}", "point": name, "x": image[0], "y": image[1], "sigma_x": 0.3, "sigma_y": 0.3
                })  # fmt: skip
    document = adjusted(network)
    assert document.status == "adjusted"
    assert largest_miss(document, truth) < 0.002
    assert [s.carried_by for s in document.stations[4:]] == ["S1", "S2", "S3", "S4"]
    found = {p.parameter: p for p in document.parameters}
    for coordinate, value in zip("XYZ", arm, strict=True):
        if state != "constant":
            assert abs(found[coordinate].value - value) < 4.0 * (found[coordinate].std or 0.0)


def test_a_point_seen_by_one_ray_is_named_and_has_no_standard_deviation() -> None:
    network = copy.deepcopy(WITHOUT)
    network["observations"]["image"].append({
        "photo": "P1", "point": "lone", "x": 10.0, "y": 5.0, "sigma_x": 0.3, "sigma_y": 0.3
    })  # fmt: skip
    document = adjusted(network)
    assert document.status == "partly-determined"
    assert [each.unknown.split(".")[0] for each in document.fictitious] == ["lone"]
    assert [p.id for p in document.points if p.std_m is None] == ["lone"]
    assert all(s.std_xyz_m is not None for s in document.stations)


def test_distances_alone_determine_the_form() -> None:
    rng = np.random.default_rng(8)
    pairs = [(a, b) for a in TRUTH for b in TRUTH if int(a) < int(b)]
    network = {
        "format": "hybrid-network/1",
        "points_approx": {name: (point + 0.05).tolist() for name, point in TRUTH.items()},
        "observations": {
            "distances": [
                {"from": a, "to": b, "distance": float(np.linalg.norm(TRUTH[a] - TRUTH[b]) + 0.001 * rng.normal()),
                 "sigma": 0.001}
                for a, b in pairs
            ]
        },
    }  # fmt: skip
    document = adjusted(network)
    assert (document.rank_defect, document.redundancy) == (6, len(pairs) - len(document.removals) - 3 * 20 + 6)
    assert largest_miss(document, TRUTH) < 0.004


def test_zero_observations_of_a_pose_are_a_datum() -> None:
    network = copy.deepcopy(GIVEN)
    network["observations"]["unknowns"] = [
        {"unknown": f"S1.{name}", "value": 0.0, "sigma": 0.001} for name in ("X", "Y", "Z", "omega", "phi", "kappa")
    ]
    document = adjusted(network)
    assert document.rank_defect == 0
    np.testing.assert_allclose(document.stations[0].xyz_m, 0.0, atol=1e-9)
    np.testing.assert_allclose(document.stations[0].std_xyz_m, 0.001, rtol=1e-6)
    free = adjusted(GIVEN)
    np.testing.assert_allclose(document.sigma0, free.sigma0, rtol=1e-9)


def test_wrong_distances_of_a_whole_scan_are_left_out() -> None:
    network = copy.deepcopy(WITHOUT)
    for each in network["observations"]["polar"]:
        if each["station"] == "S2":
            each["distance"] *= 1.01
    document = adjusted(network)
    wrong = [r for r in document.removals if r.station == "S2" and r.component == "distance"]
    assert len(wrong) >= 18
    assert len(document.removals) - len(wrong) <= 2
    assert document.global_test.passed


def test_standard_deviations_that_promise_too_much_are_doubtful_unless_taken_from_the_residuals() -> None:
    network = copy.deepcopy(GIVEN)
    for each in network["observations"]["polar"]:
        each |= {name: each[name] / 2.0 for name in each if name.startswith("sigma_") and each[name] is not None}
    document = adjusted(network, gross_errors="none")
    assert document.sigma0 is not None
    assert 1.2 < document.sigma0 < 5.0
    assert (document.status, len(document.doubts)) == ("doubtful", 1)
    assert "`covariance_scale`" in document.doubts[0]
    assert adjusted(network, gross_errors="none", covariance_scale="a-posteriori").status == "adjusted"


def test_a_levelled_station_above_a_known_point_is_oriented_by_one_direction() -> None:
    points = {"A": [0.0, 0.0, 0.0], "B": [10.0, 0.0, 1.0], "P": [5.0, 5.0, 0.1]}
    polar: list[dict[str, Any]] = [
        {"station": "S", "point": "B", "horizontal": 350.0, "sigma_horizontal": 0.001},
        {"station": "S", "point": "P", "horizontal": 0.0, "zenith": 99.1, "distance": 7.0718},
    ]
    polar[1] |= {f"sigma_{part}": 0.001 for part in ("horizontal", "zenith", "distance")}
    network = {
        "format": "hybrid-network/1",
        "stations": [{"id": "S", "point": "A", "levelled": True}],
        "observations": {"polar": polar, "control": [{"point": n, "xyz": points[n], "held": True} for n in "AB"]},
    }
    found = {p.id: p.xyz_m for p in adjusted(network, datum={"type": "control"}, gross_errors="none").points}
    np.testing.assert_allclose(found["P"], points["P"], atol=0.002)


INDEX_GON, OFFSET_M = 0.02, 0.004


def out_of_adjustment() -> dict[str, Any]:
    """Read the vertical circle and the distances of all stations wrong."""
    network = copy.deepcopy(GIVEN)
    for each in network["observations"]["polar"]:
        if each.get("zenith") is not None:
            each["zenith"] += INDEX_GON
        if each.get("distance") is not None:
            each["distance"] += OFFSET_M
    return network


def test_errors_of_scanners_are_found_and_change_nothing_unless_asked() -> None:
    network = out_of_adjustment()
    plain = adjusted(network, gross_errors="none")
    document = adjusted(network, gross_errors="none", scanner={"estimate": "auto"})
    assert document.scanners is not None
    found = {error.error: error for error in document.scanners.errors}
    assert {name for name, error in found.items() if error.significant} == {"zenith_index", "distance_offset"}
    assert abs(found["distance_offset"].value - OFFSET_M) < 4.0 * found["distance_offset"].std
    assert [p.xyz_m for p in document.points] == [p.xyz_m for p in plain.points]
    assert not document.scanners.applied


def test_errors_of_scanners_that_are_applied_make_the_points_right() -> None:
    network = out_of_adjustment()
    plain = adjusted(network, gross_errors="none")
    document = adjusted(network, gross_errors="none", scanner={"estimate": "auto", "apply": True})
    assert document.scanners is not None
    assert document.scanners.applied
    assert {p.parameter for p in document.parameters if p.std is not None} == {"zenith_index", "distance_offset"}
    assert largest_miss(document, TRUTH) < 0.5 * largest_miss(plain, TRUTH)


def test_scanners_in_adjustment_are_said_to_be_so() -> None:
    document = adjusted(GIVEN, scanner={"estimate": "auto"})
    assert document.scanners is not None
    assert not any(error.significant for error in document.scanners.errors)
    assert document.scanners.recommendation.startswith("nothing speaks against the scanners")
