"""Which estimator gives the pose: lines and planes, surfaces, both, or nothing, and what the result says of it."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.errors import DegenerateGeometryError
from algorithms.features.scan_features import ScanFeatures, SurfaceSample
from algorithms.geometry.lines import bases_of
from algorithms.geometry.planes import Planes
from algorithms.matching.coarse_registration import CoarseRegistration
from algorithms.progress import NoProgress
from algorithms.quality.acceptance import AcceptanceStatus, Verdict
from algorithms.registration import auto_registration, line_registration
from algorithms.registration.auto import AutoMethod
from algorithms.registration.base import PairResult, PairStatus, RegistrationProblem
from algorithms.registration.final_verdict import doubts_of_slivers, status_of_final
from algorithms.registration.lines import LinesMethod
from algorithms.registration.pair_verdict import allowed_m
from algorithms.registration.planes import PlanesMethod
from algorithms.registration.precision import precision_of
from schemas.results.registration_result import Pair
from service.use_cases.documents.pair_documents import pair_document
from service.use_cases.steps.link_store import link_of
from tests.unit.service.use_cases.steps.test_feature_store import some_features

VOXEL_M = 0.15
ROOM_M = np.array([6.0, 4.5, 3.0])
NOISE_M = 0.002
POSE = RigidTransform.from_components([2.0, -1.0, 0.5], Rotation.from_rotvec([0.3, -0.8, 1.2]))
WALLS = "xyzXYZ"


def wall(name: str, raster: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give points and normal of one wall of a box seen from inside; x is at the low end, X at the high end.

    P is a piece of wall across the middle, seen from the low end.
    """
    if name == "P":
        points, normal = wall("X", raster)
        return points[points[:, 1] < 2.0] - [0.5 * ROOM_M[0], 0.0, 0.0], normal
    axis = "xyz".index(name.lower())
    others = [k for k in range(3) if k != axis]
    u, v = (grid.ravel() for grid in np.meshgrid(*(np.arange(raster[k] * VOXEL_M, ROOM_M[k], VOXEL_M) for k in others)))
    points = np.zeros((len(u), 3))
    points[:, others] = np.column_stack([u, v])
    points[:, axis] = ROOM_M[axis] if name.isupper() else 0.0
    normal = np.zeros(3)
    normal[axis] = -1.0 if name.isupper() else 1.0
    return points, normal


def scan(
    pose: RigidTransform, seed: int, *, walls: str = WALLS, planes: str = WALLS, plane_std: float = 3e-4
) -> ScanFeatures:
    """See walls of a room; some of them are planes too."""
    rng = np.random.default_rng(seed)
    points, normals, labels, found = [], [], [], []
    for name in walls:
        own, normal = wall(name, rng.uniform(0.0, 1.0, 3))
        points.append(own + normal * rng.normal(size=(len(own), 1)) * NOISE_M)
        normals.append(np.tile(normal, (len(own), 1)))
        labels.append(np.full(len(own), len(found) if name in planes else -1, dtype=np.int32))
        if name in planes:
            found.append((normal, own.mean(axis=0) + normal * rng.normal() * plane_std))
    back = pose.inv()
    surface = SurfaceSample(
        back.apply(np.concatenate(points)),
        back.rotation.apply(np.concatenate(normals)),
        np.concatenate(labels),
        VOXEL_M,
    )
    return replace(
        some_features(),
        planes=fitted(found, back, plane_std, rng),
        surface=surface,
        origin_m=np.array([100.0, 200.0, 300.0]) * seed,
        noise_std_m=NOISE_M,
    )


def fitted(
    found: list[tuple[np.ndarray, np.ndarray]], back: RigidTransform, std: float, rng: np.random.Generator
) -> Planes:
    n = len(found)
    normals = np.array([normal for normal, _ in found]).reshape(-1, 3)
    centroids = np.array([centroid for _, centroid in found]).reshape(-1, 3)
    normals, centroids = back.rotation.apply(normals), back.apply(centroids)
    bases = bases_of(normals)
    tilts = rng.normal(size=(n, 2)) * 0.3 * std
    normals = normals + np.einsum("nij,nj->ni", bases, tilts)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    square = np.array([[-1.4, -1.4], [1.4, -1.4], [1.4, 1.4], [-1.4, 1.4]])
    return Planes(
        normals,
        centroids,
        bases_of(normals),
        np.tile(np.diag([0.09 * std**2, 0.09 * std**2, std**2]), (n, 1, 1)),
        np.full(n, NOISE_M),
        np.full(n, 1000),
        np.full(n, 7.8),
        np.tile(square, (n, 1)),
        4 * np.arange(n + 1),
    )


@pytest.fixture(autouse=True)
def search_that_finds_the_pose(monkeypatch: pytest.MonkeyPatch) -> None:
    start = RigidTransform.from_components(
        np.asarray(POSE.translation) + 0.01, Rotation.from_rotvec([0.002, -0.002, 0.001]) * POSE.rotation
    )
    found = CoarseRegistration(start, 12, 0.8, 0.8, 0.0, 0.9, None, 0.0, 0, 100, True, False, ())
    monkeypatch.setattr(auto_registration, "searched", lambda *_: found)


def registered(target: ScanFeatures, source: ScanFeatures) -> PairResult:
    return auto_registration.register_automatically(RegistrationProblem(target, source), AutoMethod(), NoProgress())


def pair(**both: Any) -> PairResult:
    return registered(scan(RigidTransform.identity(), 1, **both), scan(POSE, 2, **both))


def error_m(result: PairResult) -> float:
    assert result.final is not None
    estimate = result.final.reduced.target_from_source
    centre = POSE.inv().apply(0.5 * ROOM_M)
    return float(np.linalg.norm(estimate.apply(centre) - POSE.apply(centre)))


def estimator(result: PairResult) -> str:
    assert result.final is not None
    return result.final.estimator


def document(result: PairResult) -> Pair:
    return pair_document(result, scan(RigidTransform.identity(), 1), target="A", source="B", timings_s={})


def test_features_and_surfaces_together_give_the_pose() -> None:
    result = pair(planes="xyXY", plane_std=3e-5)
    assert estimator(result) == "lines+planes+surfaces"
    assert error_m(result) < 0.001


def test_planes_that_are_known_much_better_give_the_pose_alone() -> None:
    result = pair(plane_std=3e-6)
    assert estimator(result) == "lines+planes"
    assert error_m(result) < 0.0001


@pytest.mark.slow
def test_errors_of_joined_poses_are_as_large_as_their_covariances_say() -> None:
    rooms, nees = 12, []
    for seed in range(rooms):
        target = scan(RigidTransform.identity(), 2 * seed, planes="xyXY", plane_std=2e-4)
        result = registered(target, scan(POSE, 2 * seed + 1, planes="xyXY", plane_std=2e-4))
        assert result.final is not None
        estimate = result.final.reduced
        turn = (estimate.rotation * POSE.rotation.inv()).as_rotvec()
        error = np.concatenate([turn, estimate.translation_m - np.asarray(POSE.translation)])
        nees.append(float(error @ np.linalg.solve(estimate.covariance, error)))
    # what rests on the same data is never counted twice, so the mean may only be lower than six
    assert 1.5 < np.mean(nees) < stats.chi2.ppf(0.995, 6 * rooms) / rooms


def test_the_shares_of_the_parts_add_up_to_one() -> None:
    final = pair().final
    assert final is not None
    assert sum(part.share for part in final.parts) == pytest.approx(1.0, abs=1e-6)


def test_planes_that_are_hardly_known_leave_the_pose_to_the_surfaces() -> None:
    result = pair(plane_std=0.05)
    assert estimator(result) == "surfaces"
    assert error_m(result) < 0.001


def test_without_lines_and_planes_the_surfaces_give_the_pose_and_the_result_says_why() -> None:
    result = pair(planes="")
    assert estimator(result) == "surfaces"
    assert error_m(result) < 0.001
    assert result.fine is None
    assert "found 0 corresponding lines and planes" in document(result).reasons[0]


def test_an_adjustment_that_does_not_settle_leaves_the_pose_to_the_surfaces(monkeypatch: pytest.MonkeyPatch) -> None:
    adjusted = auto_registration.adjusted_features

    def unsettled(*arguments: Any) -> Any:
        fine = adjusted(*arguments)
        return replace(fine, adjustment=replace(fine.adjustment, converged=False))

    monkeypatch.setattr(auto_registration, "adjusted_features", unsettled)
    result = pair()
    assert estimator(result) == "surfaces"
    assert error_m(result) < 0.001
    assert "the adjustment does not settle" in document(result).reasons[0]


def run_away(*_: Any) -> Any:
    raise DegenerateGeometryError(5, ("a combination of unknowns",), advice="add observations")


def test_an_adjustment_that_runs_away_leaves_the_pose_to_the_surfaces(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(auto_registration, "adjusted_features", run_away)
    result = pair()
    assert estimator(result) == "surfaces"
    assert error_m(result) < 0.001
    assert any("only 5 of 6 parameters, free: a combination of unknowns" in r for r in document(result).reasons)


def test_an_adjustment_that_runs_away_makes_the_pair_degenerate_where_features_alone_are_asked(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    coarse = auto_registration.searched(None, None)  # type: ignore[arg-type]  # the fixture's, which asks for nothing
    monkeypatch.setattr(line_registration, "searched", lambda *_: coarse)
    monkeypatch.setattr(line_registration, "adjusted_features", run_away)
    both = (scan(RigidTransform.identity(), 1), scan(POSE, 2))
    result = line_registration.register_by_lines(RegistrationProblem(*both), LinesMethod(), NoProgress())
    assert result.status is PairStatus.DEGENERATE
    assert result.free_directions == ("a combination of unknowns",)
    assert result.advice == "add observations"
    assert document(result).target_from_source is None


@pytest.mark.slow
def test_features_alone_are_judged_and_told_as_where_no_surface_serves(monkeypatch: pytest.MonkeyPatch) -> None:
    coarse = auto_registration.searched(None, None)  # type: ignore[arg-type]  # the fixture's, which asks for nothing
    monkeypatch.setattr(line_registration, "searched", lambda *_: coarse)
    problem = RegistrationProblem(scan(RigidTransform.identity(), 1), scan(POSE, 2))
    monkeypatch.setattr(auto_registration, "_by_surfaces", lambda *_: None)
    usual = auto_registration.register_automatically(problem, AutoMethod(), NoProgress())
    lines = line_registration.register_by_lines(problem, LinesMethod(), NoProgress())
    planes = line_registration.register_by_planes(problem, PlanesMethod(), NoProgress())
    assert usual.final is not None
    for alone, told in ((lines, "lines+planes"), (planes, "planes")):
        assert alone.final is not None
        assert alone.status is usual.status
        assert alone.reasons[1:] == usual.reasons[1:]
        assert alone.final.estimator == told
        np.testing.assert_allclose(alone.final.reduced.covariance, usual.final.reduced.covariance, rtol=1e-6)


@pytest.mark.slow
def test_planes_alone_promise_no_more_than_with_the_surfaces(monkeypatch: pytest.MonkeyPatch) -> None:
    coarse = auto_registration.searched(None, None)  # type: ignore[arg-type]  # the fixture's, which asks for nothing
    monkeypatch.setattr(line_registration, "searched", lambda *_: coarse)
    problem = RegistrationProblem(scan(RigidTransform.identity(), 1), scan(POSE, 2))
    alone = line_registration.register_by_planes(problem, PlanesMethod(), NoProgress()).final
    joint = auto_registration.register_automatically(problem, AutoMethod(), NoProgress()).final
    assert alone is not None
    assert joint is not None
    assert (np.diag(joint.reduced.covariance) < 1.05 * np.diag(alone.reduced.covariance)).all()


def test_planes_that_contradict_the_surfaces_they_stand_for_are_not_believed() -> None:
    seen = {"walls": WALLS + "P", "planes": "xyzX"}
    source = scan(POSE, 2, **seen)
    result = registered(scan(RigidTransform.identity(), 1, **seen), replace(source, planes=shifted(source.planes)))
    assert estimator(result) == "surfaces"
    assert error_m(result) < 0.001
    assert "the very surfaces of the matched planes do not bear that out" in document(result).reasons[0]


def test_where_nothing_tells_whether_planes_or_surfaces_err_the_deviations_hold_both() -> None:
    seen = {"planes": "xyzX"}
    source = scan(POSE, 2, **seen)
    result = registered(
        scan(RigidTransform.identity(), 1, **seen), replace(source, planes=shifted(source.planes, 0.015))
    )
    assert "nothing tells which, so the standard deviations hold both" in document(result).reasons[0]
    assert result.final is not None
    std = result.final.reduced.position_std_m(0.5 * ROOM_M)[0]
    assert std is not None
    assert 0.5 * 0.015 / np.sqrt(2.0) < std < 0.015
    assert error_m(result) < 1.5 * std


@pytest.mark.parametrize(("plane_std", "status"), [(0.0003, "coarse"), (0.003, "accepted")])
def test_a_contradiction_far_beyond_chance_is_never_accepted(plane_std: float, status: str) -> None:
    seen = {"planes": "xyzX", "plane_std": plane_std}
    source = scan(POSE, 2, **seen)
    moved = replace(source, planes=shifted(source.planes, 0.012))
    result = registered(scan(RigidTransform.identity(), 1, **seen), moved)
    assert "contradict the surfaces" in document(result).reasons[0]
    assert result.status.value == status
    assert any("far beyond chance" in reason for reason in result.reasons) == (status == "coarse")


@pytest.mark.parametrize(("free", "ambiguous", "status"), [(1, False, "degenerate"), (0, True, "ambiguous")])
def test_doubts_stand_in_the_reasons_whatever_decides(free: int, ambiguous: bool, status: str) -> None:
    result = pair()
    assert result.final is not None
    assert result.coarse is not None
    reduced = replace(result.final.reduced, null_space=np.eye(6)[:, :free])
    judged, reasons = status_of_final(
        RegistrationProblem(scan(RigidTransform.identity(), 1), scan(POSE, 2)),
        replace(result.coarse, ambiguous=ambiguous),
        replace(result.final, reduced=reduced, free_directions=("a turn",) * free),
        Verdict(AcceptanceStatus.ACCEPTED, ()),
        fine=result.fine,
        doubts=("the scans differ by more than a motion",),
        precision=None if free else result.precision,
    )
    assert judged.value == status
    assert "the scans differ by more than a motion" in reasons


def test_a_pose_must_be_known_to_two_centimetres_or_to_half_the_distance_of_the_points() -> None:
    dense, sparse = (replace(some_features(), surface=scan(POSE, 1).surface, point_count=n) for n in (10**6, 1000))
    assert allowed_m(RegistrationProblem(dense, dense)) == 0.02
    assert allowed_m(RegistrationProblem(dense, sparse)) == 0.5 * sparse.spacing_m > 0.05


@pytest.mark.parametrize(
    ("target_reaches_far", "source_reaches_far", "status"),
    [(True, True, "coarse"), (True, False, "accepted"), (False, True, "accepted")],
)
def test_a_turn_that_moves_what_is_far_from_the_common_part_makes_a_pose_coarse(
    target_reaches_far: bool, source_reaches_far: bool, status: str
) -> None:
    target, source = scan(RigidTransform.identity(), 1), scan(POSE, 2)
    result = registered(target, source)
    assert result.status is PairStatus.ACCEPTED
    assert result.final is not None
    assert result.coarse is not None
    turns = np.diag([0.0005**2] * 3 + [0.0] * 3)  # 1.5 mm at the walls of the room, 30 mm at a distance of 60 m
    final = replace(result.final, reduced=replace(result.final.reduced, covariance=turns))
    problem = RegistrationProblem(
        reaching_far(target) if target_reaches_far else target, reaching_far(source) if source_reaches_far else source
    )
    known = precision_of(problem, final, hidden_m=0.0)
    judged, reasons = status_of_final(
        problem,
        result.coarse,
        final,
        Verdict(AcceptanceStatus.ACCEPTED, ()),
        fine=result.fine,
        doubts=(),
        precision=known,
    )
    assert judged.value == status
    assert ("mm (standard deviation, 20 mm would be allowed)" in reasons[-1]) == (status == "coarse")


def reaching_far(features: ScanFeatures) -> ScanFeatures:
    """Add as much surface again, 60 m away."""
    near = features.surface
    return replace(
        features,
        surface=SurfaceSample(
            np.vstack([near.points, near.points + 60.0 * np.eye(3)[0]]),
            np.vstack([near.normals, near.normals]),
            np.concatenate([near.plane_labels, np.full_like(near.plane_labels, -1)]),
            near.voxel_size_m,
        ),
    )


def shifted(planes: Planes, shift_m: float = 0.02) -> Planes:
    """Move the planes of a scan that look along the room, as wrong partners would."""
    axis = POSE.inv().rotation.apply(np.array([1.0, 0.0, 0.0]))
    along = np.abs(planes.normals @ axis) > 0.9
    return replace(planes, centroids=planes.centroids + shift_m * along[:, None] * axis)


@pytest.mark.parametrize(
    ("testimony", "support", "doubtful"), [(0.005, 0.15, True), (0.005, 0.25, False), (0.02, 0.15, False)]
)
def test_hardly_any_of_little_common_surface_controls_nothing(testimony: float, support: float, doubtful: bool) -> None:
    result = pair(planes="")
    assert result.final is not None
    assert result.final.surfaces is not None
    assert result.verification is not None
    final = replace(result.final, surfaces=replace(result.final.surfaces, least_testimony=testimony))
    doubts = doubts_of_slivers(final, replace(result.verification, support_share=support))
    assert bool(doubts) is doubtful


def test_a_freedom_that_planes_leave_open_comes_from_the_surfaces() -> None:
    result = pair(planes="yzYZ")
    assert result.fine is not None
    assert result.fine.adjustment.rank == 5
    assert result.final is not None
    assert result.final.reduced.null_space.shape == (6, 0)
    assert error_m(result) < 0.001


def test_what_nothing_determines_makes_the_pair_degenerate_and_is_named() -> None:
    result = pair(walls="yzYZ", planes="yzYZ")
    assert result.status is PairStatus.DEGENERATE
    assert "translation along (1.000" in document(result).rank_report.null_space[0].text  # type: ignore[union-attr]


def test_the_document_gives_the_pose_of_surfaces_though_no_feature_was_adjusted() -> None:
    shown = document(pair(planes=""))
    assert shown.target_from_source is not None
    assert shown.adjustment is None
    assert shown.estimator == "surfaces"
    assert shown.surfaces is not None
    assert shown.surfaces.converged
    assert shown.rank_report is not None
    assert len(shown.rank_report.determined) == 6


def test_the_pose_is_told_between_the_files_coordinates() -> None:
    result = pair(planes="")
    assert result.final is not None
    full, reduced = result.final.pose, result.final.reduced
    origins = np.array([100.0, 200.0, 300.0]) * np.array([[1.0], [2.0]])
    point = np.array([0.3, 0.2, 0.1])
    there = full.target_from_source.apply(point + origins[1]) - origins[0]
    np.testing.assert_allclose(there, reduced.target_from_source.apply(point), atol=1e-9)


def test_a_network_gets_the_joined_pose_not_that_of_the_features() -> None:
    result = pair(plane_std=3e-4)
    assert result.final is not None
    features = scan(RigidTransform.identity(), 1)
    link = link_of(result.fine, features, features, result.final)
    assert link.target_from_source is result.final.reduced
    assert len(link.planes) == 6


def test_surfaces_alone_give_a_network_no_features() -> None:
    result = pair(planes="")
    features = scan(RigidTransform.identity(), 1)
    link = link_of(result.fine, features, features, result.final)
    assert (len(link.lines), len(link.planes)) == (0, 0)
