"""What a pair's document says, and does not say."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.line_adjustment import adjust_lines
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.line_motion import moved_lines
from algorithms.geometry.lines import Lines, lines_from_arrays
from algorithms.geometry.poses import PoseEstimate
from algorithms.quality.acceptance import Verification, judge
from algorithms.quality.unexplained import UnexplainedPiece
from algorithms.registration.base import FineRegistration, PairResult, PairStatus
from schemas.results.registration_result import Pair
from service.use_cases.documents.pair_documents import pair_document
from service.use_cases.documents.pose_documents import pose_document
from tests.scenes.buildings.plane_rooms import observed_rooms, plane_rooms
from tests.unit.service.use_cases.steps.test_feature_store import some_features

STD = 1e-3
POSE = RigidTransform.from_components([2.0, -1.0, 0.5], Rotation.from_rotvec([0.3, -0.8, 1.2]))
MIXED = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [0, 1, 1], [1, 0, 1]] * 2
PARAMETERS = ("omega_gon", "phi_gon", "kappa_gon", "tx_m", "ty_m", "tz_m")


def document(**verified: object) -> Pair:
    figures = {
        "overlap_decimetre": 0.5,
        "overlap_half_metre": 0.6,
        "rms_m": 0.004,
        "support_share": 0.5,
        "violation_share": 0.01,
        "score": 0.5,
        "free_space_known": True,
        "controlled_m2": 5.0,
    }
    verification = Verification(**{**figures, **verified})
    result = PairResult(PairStatus.DOUBTFUL, ("a reason",), None, None, verification, ("translation along x",), "add")
    features: ScanFeatures = some_features()
    return pair_document(result, features, target="A", source="B", timings_s={})


def noisy(lines: Lines, rng: np.random.Generator) -> Lines:
    drawn = rng.normal(size=(len(lines), 4)) * STD
    return lines_from_arrays(
        lines.anchors + np.einsum("nij,nj->ni", lines.bases, drawn[:, 2:]),
        lines.directions + np.einsum("nij,nj->ni", lines.bases, drawn[:, :2]),
        lines.covariances,
        lines.extents,
    )


def adjusted(directions: list[list[float]], moved: int | None = None, seed: int = 1) -> Pair:
    """Register lines of which one was moved by 5 cm; the target's coordinates are far from its reduced origin."""
    rng = np.random.default_rng(seed)
    n = len(directions)
    lines = lines_from_arrays(
        rng.uniform(-3, 3, size=(n, 3)),
        np.array(directions, dtype=np.float64),
        np.tile(STD**2 * np.eye(4), (n, 1, 1)),
        np.tile([-1.0, 1.0], (n, 1)),
    )
    target, source = noisy(moved_lines(lines, POSE), rng), noisy(lines, rng)
    if moved is not None:
        target.anchors[moved] += 0.05 * target.bases[moved, :, 0]
    pairs = np.repeat(np.arange(n, dtype=np.int64)[:, None], 2, axis=1)
    adjustment = adjust_lines(target, source, pairs, POSE)
    features = replace(some_features(), lines=target)
    fine = FineRegistration(
        pairs,
        np.empty((0, 2), dtype=np.int64),
        adjustment,
        adjustment.pose_a_posteriori.moved_to_origins(features.origin_m, np.zeros(3)),
        adjustment.centroid_m + features.origin_m,
    )
    result = PairResult(PairStatus.ACCEPTED, (), None, fine, None)
    return pair_document(result, features, target="A", source="B", timings_s={})


@cache
def room_with_a_moved_plane() -> tuple[Pair, str, set[str]]:
    """Register rooms in which a plane with two edges moved by 5 cm; give also the plane's name and its edges'."""
    rng = np.random.default_rng(4)
    rooms = plane_rooms(rng)
    dependents = np.array([(rooms.edges == k).any(axis=1).sum() for k in range(len(rooms.normals))])
    plane = int(np.flatnonzero(rooms.matched & (dependents == 2))[0])
    seen = observed_rooms(rooms, rng, source_rooms=rooms.with_plane_moved(plane, 0.05))
    assert seen.planes is not None
    adjustment = adjust_lines(seen.target, seen.source, seen.correspondences, seen.start, planes=seen.planes)
    features = replace(some_features(), lines=seen.target, planes=seen.planes.target, origin_m=np.zeros(3))
    fine = FineRegistration(
        seen.correspondences, seen.planes.pairs, adjustment, adjustment.pose_a_posteriori, adjustment.centroid_m
    )
    pair = pair_document(
        PairResult(PairStatus.ACCEPTED, (), None, fine, None), features, target="A", source="B", timings_s={}
    )
    number = int(seen.planes.pairs[int(rooms.matched[:plane].sum()), 0])
    edges = np.flatnonzero((rooms.edges == plane).any(axis=1))
    return pair, f"A/P{number + 1}", {f"A/L{int(edge) + 1}" for edge in edges}


def test_a_moved_plane_is_named_in_its_own_entry_and_in_those_of_its_edges() -> None:
    pair, plane, edges = room_with_a_moved_plane()
    by_plane = [outlier for outlier in pair.outliers if outlier.moved_plane is not None]
    assert {outlier.line.split(" – ")[0] for outlier in by_plane} == {plane, *edges}
    removed = [entry for entry in pair.plane_correspondences if entry.state == "removed"]
    assert [entry.target_plane for entry in removed] == [plane]
    assert abs(removed[0].offset_mm) == pytest.approx(50.0, abs=5.0)


def test_every_used_plane_has_all_its_figures() -> None:
    pair, _, _ = room_with_a_moved_plane()
    used = [entry for entry in pair.plane_correspondences if entry.state == "used"]
    assert used
    for entry in used:
        assert entry.test is not None
        assert (len(entry.residuals), len(entry.redundancy_numbers), len(entry.mdb)) == (3, 3, 3)
        assert entry.test.critical_b_method < entry.test.critical
        assert entry.external_effect is not None
        assert entry.removal is None


def test_free_space_that_nobody_could_test_is_null_not_zero() -> None:
    overlap = document(free_space_known=False, violation_share=0.0).overlap
    assert overlap is not None
    assert overlap.free_space_violations is None


def test_the_fit_of_nothing_is_null_not_zero() -> None:
    overlap = document(overlap_decimetre=0.0, rms_m=0.0).overlap
    assert overlap is not None
    assert overlap.rms_m is None


def test_known_figures_are_given() -> None:
    overlap = document().overlap
    assert overlap is not None
    assert (overlap.rms_m, overlap.free_space_violations) == pytest.approx((0.004, 0.01))
    assert np.isfinite(overlap.rms_m or np.nan)


def test_surface_in_free_space_is_named_by_station() -> None:
    piece = UnexplainedPiece(in_target=False, centre_m=np.array([1.0, 2.0, 3.0]), area_m2=1.5, range_m=9.0)
    overlap = document(unexplained=(piece,)).overlap
    assert overlap is not None
    (named,) = overlap.unexplained
    assert (named.station, named.centre_m, named.area_m2, named.range_m) == ("B", (1.0, 2.0, 3.0), 1.5, 9.0)


def test_what_is_free_is_named_without_a_standard_deviation() -> None:
    (weak,) = document().weak_directions
    assert (weak.text, weak.std_m, weak.advice) == ("translation along x", None, "add")


def test_what_is_free_before_any_pose_stands_in_the_rank_report() -> None:
    report = document().rank_report
    assert report is not None
    assert (report.rank, [motion.text for motion in report.null_space]) == (None, ["translation along x"])


def test_reasons_claim_nothing_about_free_space_that_nobody_could_test() -> None:
    verification = Verification(0.5, 0.6, 0.004, 0.6, 0.0, 0.6, free_space_known=False, controlled_m2=5.0)
    reasons = judge(verification, runner_up_score=0.0, supporters=50).reasons
    assert "is not known" in reasons[0]
    assert "0.0%" not in reasons[0]


def test_a_moved_line_is_named_with_step_reason_and_without_effect() -> None:
    pair = adjusted(MIXED, moved=4)
    entry = pair.correspondences[4]
    assert (entry.state, entry.target_line, entry.source_line) == ("removed", "A/L5", "B/L5")
    assert entry.removal is not None
    assert (entry.removal.step, entry.removal.why.startswith("moved between the scans")) == (1, True)
    assert entry.external_effect is None
    assert [(outlier.line, outlier.why) for outlier in pair.outliers] == [("A/L5 – B/L5", entry.removal.why)]


def test_a_removed_line_names_the_other_one_that_may_be_wrong_instead() -> None:
    # only the last two lines tell the height, and each only against the other
    pair = adjusted([[0, 0, 1]] * 8 + [[1, 0, 0]] * 2, moved=8)
    (removed,) = [entry for entry in pair.correspondences if entry.state == "removed"]
    assert removed.removal is not None
    (partner,) = removed.removal.inseparable_from
    assert {f"{removed.target_line} – {removed.source_line}", partner.correspondence} == {
        "A/L9 – B/L9",
        "A/L10 – B/L10",
    }
    assert partner.correlation > 0.9
    assert "cannot tell" in removed.removal.why


def test_the_offset_of_a_moved_line_is_told_with_sign_and_direction() -> None:
    entry = adjusted(MIXED, moved=4).correspondences[4]
    # the target line went 50 mm along E1, so the source line lies 50 mm back
    assert entry.offset_mm[0] == pytest.approx(-50.0, abs=5.0)
    assert abs(entry.offset_mm[1]) < 5.0
    assert entry.distance_m == pytest.approx(np.hypot(*entry.offset_mm) / 1e3)


def test_every_used_line_has_all_its_figures() -> None:
    for entry in adjusted(MIXED).correspondences:
        assert entry.test is not None
        assert (entry.test.critical, entry.test.critical_b_method) == pytest.approx((18.467, 13.538), abs=1e-3)
        assert entry.redundancy == pytest.approx(sum(entry.redundancy_numbers))
        assert None not in (*entry.residual_std, *entry.normalised, *entry.mdb)
        assert entry.external_effect is not None
        assert entry.offset_covariance_mm2 is not None


def test_redundancy_adds_up_to_that_of_the_adjustment() -> None:
    pair = adjusted(MIXED, moved=4)
    assert pair.adjustment is not None
    assert sum(entry.redundancy for entry in pair.correspondences) == pytest.approx(pair.adjustment.redundancy)


def test_the_largest_effect_of_a_pair_is_that_of_its_worst_line() -> None:
    pair = adjusted(MIXED)
    assert pair.adjustment is not None
    assert pair.adjustment.largest_external_effects is not None
    for name in (*PARAMETERS, "centroid_shift_m", "global_effect"):
        worst = max(getattr(entry.external_effect, name) for entry in pair.correspondences)
        assert getattr(pair.adjustment.largest_external_effects, name) == worst


def test_places_are_in_the_full_coordinates_of_the_target() -> None:
    pair = adjusted(MIXED)
    origin = some_features().origin_m
    places = np.array([entry.at_m for entry in pair.correspondences])
    assert (np.abs(places - origin) < 10.0).all()


def test_strongly_correlated_parameters_are_named() -> None:
    # far from the features every shift of the origin is a matter of the turns
    estimate = PoseEstimate(POSE, np.diag([1e-8, 2e-8, 3e-8, 1e-6, 1e-6, 1e-6]))
    far = estimate.moved_to_origins(np.zeros(3), np.array([5e5, 0.0, 0.0]))
    named = pose_document(far, target="A", source="B", centroid_m=None).correlations
    assert named
    assert all(abs(entry.correlation) > 0.9 for entry in named)
    assert pose_document(estimate, target="A", source="B", centroid_m=None).correlations == []


def test_axes_of_the_ellipsoid_belong_to_the_covariance_beside_it() -> None:
    pose = adjusted(MIXED).target_from_source
    assert pose is not None
    assert pose.error_ellipsoid_at_centroid is not None
    assert pose.std_at_centroid_m is not None
    lever = np.array(pose.std_at_centroid_m.point_m) - np.array(pose.matrix)[:3, 3]
    jacobian = np.hstack([np.cross(np.eye(3), lever).T, np.eye(3)])  # dp = w x (p - t) + dt
    values = np.linalg.eigvalsh(jacobian @ np.array(pose.covariance) @ jacobian.T)
    np.testing.assert_allclose(pose.error_ellipsoid_at_centroid.semi_axes_m, np.sqrt(values[::-1]), rtol=1e-6)


def test_parameters_that_are_not_determined_are_null_with_the_reason() -> None:
    pair = adjusted([[0, 0, 1]] * 6)
    pose = pair.target_from_source
    assert pose is not None
    assert [getattr(pose, name) is None for name in PARAMETERS] == [False, False, False, True, True, True]
    assert pose.undetermined is not None
    assert "would fit as well" in pose.undetermined
    assert pose.std is not None
    assert (pose.std.tx_m, pose.covariance) == (None, None)
    assert pose.std.kappa_gon is not None


def test_the_rank_report_of_parallel_lines_tells_free_and_determined_motions() -> None:
    report = adjusted([[0, 0, 1]] * 6).rank_report
    assert report is not None
    assert (report.rank, len(report.determined), len(report.null_space)) == (5, 5, 1)
    assert report.null_space[0].text.startswith("translation along")
    assert "not parallel" in report.advice


def test_effects_on_what_is_not_determined_are_null() -> None:
    entry = adjusted([[0, 0, 1]] * 6).correspondences[0]
    assert entry.external_effect is not None
    assert (entry.external_effect.tx_m, entry.external_effect.kappa_gon is None) == (None, False)


def test_the_side_of_the_global_test_is_told_in_words() -> None:
    pair = adjusted(MIXED)
    assert pair.adjustment is not None
    assert pair.adjustment.global_test is not None
    assert (pair.adjustment.global_test.side, pair.adjustment.global_test.passed) == ("accepted", True)
    assert "noise explains" in pair.adjustment.global_test.meaning


def test_lines_are_counted_by_kind() -> None:
    accuracy = adjusted(MIXED, moved=4).accuracy
    assert accuracy is not None
    assert (accuracy.lines.plane_intersections, accuracy.lines.removed) == (11, 1)


def test_the_rotation_survives_json_to_a_millionth_of_a_millionth() -> None:
    pose = json.loads(adjusted(MIXED).model_dump_json(by_alias=True))["target_from_source"]
    rotation = np.array(pose["matrix"])[:3, :3]
    np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-12)


def test_nothing_in_the_document_is_not_a_number() -> None:
    text = adjusted([[0, 0, 1]] * 6, moved=2).model_dump_json(by_alias=True)
    assert "NaN" not in text
    assert "Infinity" not in text
