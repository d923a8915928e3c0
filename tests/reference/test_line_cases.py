"""The eleven line registration problems with known pose, covariance, tests and removals (MATH 8)."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.line_adjustment import AdjustmentOptions, LineAdjustment, adjust_lines
from algorithms.geometry.angles import GON_PER_RAD
from algorithms.geometry.line_motion import lines_about, motion_from_matched_lines
from algorithms.geometry.lines import Lines, lines_from_arrays

VECTORS = Path(__file__).parents[2].parent / "shared" / "data" / "vectors" / "line_cases.json"
NAMES = (
    "rooms24",
    "generic8",
    "industrial3",
    "two_skew",
    "facade24",
    "bridge16",
    "rooms24_mismatch",
    "rooms24_shift60mm",
    "far_target_utm",
    "large_rotation",
)
TOO_FEW_TO_LOSE_ONE = ("industrial3", "two_skew")
POSE = 1e-9  # rad and m, the vectors' own promise; they are given with 15 digits
RELATIVE = 1e-6  # of standard deviations and test values
FAR = 5e-9  # m: 5600 km with 15 digits leave one nanometre


def case(name: str) -> dict[str, Any]:
    if not VECTORS.exists():
        pytest.skip(f"test vectors not found: {VECTORS}")
    return next(c for c in json.loads(VECTORS.read_text()) if c["name"] == name)


def lines_of(rows: list[dict[str, Any]]) -> Lines:
    covariances = np.zeros((len(rows), 4, 4))
    covariances[:, [0, 1], [0, 1]] = np.array([row["sigma_tilt"] for row in rows])[:, None] ** 2
    covariances[:, [2, 3], [2, 3]] = np.array([row["sigma_offset"] for row in rows])[:, None] ** 2
    anchors = np.array([row["c"] for row in rows], dtype=np.float64)
    directions = np.array([row["d"] for row in rows], dtype=np.float64)
    return lines_from_arrays(anchors, directions, covariances, np.zeros((len(rows), 2)))


def adjusted(data: dict[str, Any], *, remove: bool) -> LineAdjustment:
    target, source = lines_of(data["scan2"]), lines_of(data["scan1"])
    pairs = np.array(data["correspondences"], dtype=np.int64)[:, ::-1].copy()  # given as scan 1, scan 2
    if len(pairs) > 2 and data["name"] != "parallel5":
        start = start_of(target[pairs[:, 0]], source[pairs[:, 1]])
    else:  # two lines leave a half turn open, parallel lines the shift: only the truth can say which is meant
        start = RigidTransform.from_components(data["true"]["t"], Rotation.from_matrix(data["true"]["R"]))
    options = AdjustmentOptions(max_removed_share=0.5 if remove else 0.0)
    return adjust_lines(target, source, pairs, start, options=options)


def start_of(target: Lines, source: Lines) -> RigidTransform:
    origin = target.anchors.mean(axis=0)
    reduced = motion_from_matched_lines(lines_about(target, origin), source)
    return RigidTransform.from_components(np.asarray(reduced.translation) + origin, reduced.rotation)


@pytest.mark.parametrize("name", NAMES)
def test_pose_agrees(name):
    data = case(name)
    pose = adjusted(data, remove=False).pose
    np.testing.assert_allclose(pose.rotation.as_matrix(), data["expected"]["R"], atol=POSE)
    np.testing.assert_allclose(pose.translation_m, data["expected"]["t"], atol=FAR if "utm" in name else POSE)


@pytest.mark.parametrize("name", NAMES)
def test_angles_and_standard_deviations_agree(name):
    data = case(name)
    pose, expected = adjusted(data, remove=False).pose, data["expected"]
    np.testing.assert_allclose(pose.omega_phi_kappa_rad * GON_PER_RAD, expected["opk_gon"], atol=POSE * GON_PER_RAD)
    np.testing.assert_allclose(
        np.array(pose.omega_phi_kappa_std_rad) * GON_PER_RAD, expected["sigma_opk_gon"], rtol=RELATIVE
    )
    np.testing.assert_allclose(pose.translation_std_m, expected["sigma_t_m"], rtol=RELATIVE)


@pytest.mark.parametrize("name", NAMES)
def test_covariance_agrees(name):
    data = case(name)
    expected = np.array(data["expected"]["cov_w_t"])
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(adjusted(data, remove=False).pose.covariance / scale, expected / scale, atol=RELATIVE)


@pytest.mark.parametrize("name", NAMES)
def test_omega_redundancy_and_global_test_agree(name):
    data = case(name)
    result, expected = adjusted(data, remove=False), data["expected"]
    assert result.omega == pytest.approx(expected["vPv"], rel=RELATIVE)
    assert result.redundancy == expected["redundancy"]
    assert result.sigma0 == pytest.approx(expected["sigma0"], rel=RELATIVE)
    assert result.global_test.lower == pytest.approx(expected["global_test"]["lower"], rel=RELATIVE)
    assert result.global_test.upper == pytest.approx(expected["global_test"]["upper"], rel=RELATIVE)
    assert (result.global_test.verdict == "accepted") == expected["global_test"]["accepted"]


@pytest.mark.parametrize("name", NAMES)
def test_statistic_of_each_line_agrees(name):
    data = case(name)
    result, expected = adjusted(data, remove=False), data["expected"]
    # With two lines half of every line's residual covariance is zero; the vectors inverted it as it stood.
    np.testing.assert_allclose(
        result.lines.statistics, expected["line_T"], rtol=1e-5 if name == "two_skew" else 2 * RELATIVE
    )
    assert result.t_critical == pytest.approx(expected["line_T_critical"]["alpha_0_001"], abs=1e-3)


@pytest.mark.parametrize("name", NAMES)
def test_lines_that_exceed_the_limit_before_any_removal_agree(name):
    data = case(name)
    report = adjusted(data, remove=False).lines
    assert np.flatnonzero(report.statistics > report.critical).tolist() == data["expected"]["outlier_lines"]


def test_limit_of_the_b_method_agrees():
    data = case("rooms24")
    expected = data["expected"]["line_T_critical"]["B_method"]
    np.testing.assert_allclose(adjusted(data, remove=False).lines.critical_b_method, expected, atol=1e-3)  # as printed


def test_rotation_beyond_the_first_quadrants_comes_back_with_its_own_angles():
    data = case("large_rotation")
    angles = adjusted(data, remove=False).pose.omega_phi_kappa_rad * GON_PER_RAD
    # omega or kappa beyond 100 gon: an arc tangent of a quotient would give another rotation
    assert np.abs(angles[[0, 2]]).max() > 100.0
    np.testing.assert_allclose(angles, data["expected"]["opk_gon"], atol=POSE * GON_PER_RAD)


@pytest.mark.parametrize("name", [name for name in NAMES if name not in TOO_FEW_TO_LOSE_ONE])
def test_wrong_lines_are_removed_in_order_and_the_rest_adjusted(name):
    data = case(name)
    expected = data["expected"]["after_iterative_line_test"]
    result = adjusted(data, remove=True)
    assert [removal.correspondence for removal in result.removals] == expected["removed_in_order"]
    np.testing.assert_allclose(result.pose.rotation.as_matrix(), expected["R"], atol=POSE)
    np.testing.assert_allclose(result.pose.translation_m, expected["t"], atol=FAR if "utm" in name else POSE)
    assert result.omega == pytest.approx(expected["vPv"], rel=RELATIVE)
    assert result.redundancy == expected["redundancy"]
    assert result.sigma0 == pytest.approx(expected["sigma0"], rel=RELATIVE)


@pytest.mark.parametrize("name", [*NAMES, "parallel5"])
def test_geometry_ratio_agrees(name):
    data = case(name)
    # The vectors evaluate it at the start; here it is a yardstick whose limits are powers of ten.
    assert adjusted(data, remove=False).ghost_ratio == pytest.approx(data["geometry"]["ratio"], rel=0.02)


def test_parallel_lines_give_the_estimable_part_and_name_the_free_shift():
    data = case("parallel5")
    result, expected = adjusted(data, remove=False), data["expected"]
    direction = np.array(expected["null_direction"])
    assert result.rank == expected["rank"]
    assert abs(result.pose.null_space[3:, 0] @ direction) == pytest.approx(1.0, abs=1e-8)
    assert len(result.free_directions) == 1
    assert result.free_directions[0].startswith("translation along")
    np.testing.assert_allclose(result.pose.rotation.as_matrix(), expected["R"], atol=POSE)
    across = result.pose.translation_m - direction * (direction @ result.pose.translation_m)
    np.testing.assert_allclose(across, expected["t_perpendicular"], atol=POSE)
    np.testing.assert_allclose(result.pose.rotation_std_rad, expected["sigma_w_rad"], rtol=RELATIVE)
    assert result.omega == pytest.approx(expected["vPv"], rel=RELATIVE)
    assert result.redundancy == expected["redundancy"]
