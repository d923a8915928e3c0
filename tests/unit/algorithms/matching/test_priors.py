"""What is known of stations beforehand: what it excludes, and what it decides in a search."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.poses import PoseEstimate
from algorithms.matching.priors import PairPriors, StationPrior
from algorithms.matching.votes import Motions
from algorithms.progress import NoProgress
from algorithms.registration.base import PairResult, PairStatus, RegistrationProblem
from algorithms.registration.lines import LinesMethod
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import simulate_stations
from algorithms.simulation.symmetric_scenes import SYMMETRIC_SCENES
from service.ports import StepContext
from service.use_cases.steps.feature_store import save_features
from service.use_cases.steps.run_pair import register_pair
from tests.doubles.memory import MemoryBlobStore
from tests.unit.algorithms.matching.test_matching import scene_features

SCANNER = VirtualScanner(rows=300, columns=720)
TARGET = RigidTransform.from_components([3.0, -2.0, 1.0], Rotation.from_rotvec([0.02, 0.3, 0.8]))
SOURCE = RigidTransform.from_components([9.0, 4.0, 1.5], Rotation.from_rotvec([-0.1, 0.1, 2.0]))


def approximate(
    target: RigidTransform, source: RigidTransform, *, turn_rad: float = 0.05, shift_m: float = 0.3
) -> PairPriors:
    """Give approximate poses with the same standard deviations in every direction."""
    covariance = np.diag([turn_rad**2] * 3 + [shift_m**2] * 3)
    return PairPriors(
        StationPrior("North", None, PoseEstimate(target, covariance)),
        StationPrior("South", None, PoseEstimate(source, covariance)),
    )


def levelled(std_rad: float) -> PairPriors:
    return PairPriors(StationPrior("North", std_rad), StationPrior("South", std_rad))


def motions(*poses: RigidTransform) -> Motions:
    return Motions(
        np.array([pose.rotation.as_matrix() for pose in poses]),
        np.array([pose.translation for pose in poses]),
        np.ones(len(poses)),
    )


def as_estimate(pose: RigidTransform) -> PoseEstimate:
    return PoseEstimate(pose, np.diag([1e-5**2] * 3 + [1e-3**2] * 3))


@pytest.mark.slow
def test_poses_drawn_around_the_approximate_ones_are_not_contradicted() -> None:
    rng = np.random.default_rng(5)

    def drawn(pose: RigidTransform) -> RigidTransform:
        turn = Rotation.from_rotvec(rng.normal(0.0, 0.05, 3)) * pose.rotation
        return RigidTransform.from_components(np.asarray(pose.translation) + rng.normal(0.0, 0.3, 3), turn)

    priors = approximate(TARGET, SOURCE)
    pairs = tuple(drawn(TARGET).inv() * drawn(SOURCE) for _ in range(2000))
    # one in a hundred thousand would be, and polished poses are allowed somewhat more
    assert priors.agree_with(pairs).all()


@pytest.mark.parametrize("wrong", [[3.0, 0.0, 0.0], [0.0, 0.0, -3.0]])
def test_a_place_ten_standard_deviations_off_is_contradicted_by_name(wrong: list[float]) -> None:
    true = TARGET.inv() * RigidTransform.from_translation(wrong) * SOURCE
    (reason,) = approximate(TARGET, SOURCE, turn_rad=0.005).contradictions(as_estimate(true))
    assert "approximate poses of South and North" in reason
    assert "3.00 m" in reason


def test_a_half_turn_is_contradicted() -> None:
    turned = SOURCE * RigidTransform.from_rotation(Rotation.from_rotvec([0.0, 0.0, np.pi]))
    assert approximate(TARGET, SOURCE).contradictions(as_estimate(TARGET.inv() * turned))


def test_an_unknown_orientation_contradicts_no_place_at_the_same_distance() -> None:
    priors = approximate(TARGET, SOURCE, turn_rad=2.0)
    away = np.asarray(SOURCE.translation) - np.asarray(TARGET.translation)
    for rotation in Rotation.random(200, random_state=3):
        place = RigidTransform.from_components(rotation.apply(away), Rotation.random(random_state=4))
        assert priors.agree_with((place,)).all()


def test_where_the_world_lies_does_not_matter() -> None:
    moved = RigidTransform.from_components([5e5, 4e6, 300.0], Rotation.from_rotvec([0.0, 0.0, 1.0]))
    pose = TARGET.inv() * RigidTransform.from_translation([1.0, 1.0, 0.0]) * SOURCE
    here, there = approximate(TARGET, SOURCE), approximate(moved * TARGET, moved * SOURCE)
    assert here.agree_with((pose,)) == there.agree_with((pose,))


def test_one_known_station_says_nothing() -> None:
    both = approximate(TARGET, SOURCE)
    one = PairPriors(both.target, StationPrior("South"))
    assert one.contradictions(as_estimate(RigidTransform.from_translation([900.0, 0.0, 0.0]))) == ()


def test_the_approximate_pose_is_tried_itself() -> None:
    tried = approximate(TARGET, SOURCE).proposed(Motions.empty())
    np.testing.assert_allclose(tried.translations_m, [(TARGET.inv() * SOURCE).translation], atol=1e-12)


def test_levelled_stations_are_not_tried_tilted() -> None:
    about_z = RigidTransform.from_rotation(Rotation.from_rotvec([0.0, 0.0, 2.0]))
    tilted = RigidTransform.from_rotation(Rotation.from_rotvec([0.3, 0.0, 0.0]))
    upside_down = RigidTransform.from_rotation(Rotation.from_rotvec([np.pi, 0.0, 0.0]))
    kept = levelled(1e-4).proposed(motions(about_z, tilted, upside_down))
    np.testing.assert_array_equal(kept.rotations, motions(about_z).rotations)


def test_a_tilt_is_contradicted_by_name() -> None:
    tilted = RigidTransform.from_rotation(Rotation.from_rotvec([0.02, 0.0, 1.0]))
    (reason,) = levelled(1e-4).contradictions(as_estimate(tilted))
    assert "South and North are said to be levelled" in reason
    assert "1.22 gon" in reason


# in a search


@cache
def symmetric_room() -> tuple[list[ScanFeatures], list[RigidTransform]]:
    """Features of two moved scans of a room that looks the same after half a turn, and their poses."""
    rng = np.random.default_rng(3)
    scene = SYMMETRIC_SCENES["symmetric_room"](rng, 0)
    features, poses = [], []
    for k, scan in enumerate(simulate_stations(scene, scene.stations, SCANNER, rng)):
        motion = RigidTransform.from_components(rng.uniform(-30.0, 30.0, 3), Rotation.random(random_state=rng))
        moved = replace(
            scan,
            points=np.ascontiguousarray(motion.apply(scan.points)),
            sensor_m=motion.apply(np.zeros(3) if scan.sensor_m is None else scan.sensor_m),
            grid=None,
        )
        features.append(extract_features(moved, FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0)))
        poses.append(scene.stations[k] * motion.inv())
    return features, poses


def registered(features: list[ScanFeatures], priors: PairPriors | None) -> PairResult:
    problem = RegistrationProblem(features[0], features[1], priors)
    return LinesMethod().register(problem, progress=NoProgress())


def reduced(poses: list[RigidTransform], features: list[ScanFeatures]) -> list[RigidTransform]:
    return [
        pose * RigidTransform.from_translation(each.origin_m)
        for pose, each in zip(poses[:2], features[:2], strict=True)
    ]


def is_right(result: PairResult, poses: list[RigidTransform]) -> bool:
    assert result.fine is not None
    difference = result.fine.pose.target_from_source.inv() * (poses[0].inv() * poses[1])
    return bool(difference.rotation.magnitude() < 0.002 and np.linalg.norm(difference.translation) < 0.05)


@pytest.mark.slow
def test_approximate_poses_decide_what_a_symmetric_room_leaves_open() -> None:
    features, poses = symmetric_room()
    result = registered(features, approximate(*reduced(poses, features)))
    assert result.status is PairStatus.ACCEPTED
    assert is_right(result, poses)
    assert any("North and South were left out" in reason for reason in result.reasons)


@pytest.mark.slow
def test_approximate_poses_that_fit_no_possible_pose_decide_nothing() -> None:
    features, poses = symmetric_room()
    wrong = RigidTransform.from_translation([40.0, 0.0, 0.0])
    target, source = reduced(poses, features)
    assert registered(features, approximate(target, wrong * source)).status is PairStatus.AMBIGUOUS


def chosen(target: RigidTransform, source: RigidTransform, std_m: float = 0.1) -> PairPriors:
    """Give what a person says who picked points, or confirmed one of several poses."""
    fixed = PoseEstimate(RigidTransform.identity(), np.zeros((6, 6)))
    said = PoseEstimate(target.inv() * source, np.diag([0.02**2] * 3 + [std_m**2] * 3))
    north, south = StationPrior("North", None, fixed), StationPrior("South", None, said)
    return PairPriors(north, south, chosen_by="a person")


@pytest.mark.slow
def test_a_start_that_a_person_chose_decides_what_a_symmetric_room_leaves_open_and_is_told() -> None:
    features, poses = symmetric_room()
    result = registered(features, chosen(*reduced(poses, features)))
    assert (result.status, is_right(result, poses)) == (PairStatus.ACCEPTED, True)
    assert "a person chose where the search starts" in result.reasons


@pytest.mark.slow
def test_a_person_may_confirm_the_other_pose_of_an_ambiguous_pair() -> None:
    features, _poses = symmetric_room()
    open_ = registered(features, None)
    assert open_.status is PairStatus.AMBIGUOUS
    assert open_.coarse is not None
    assert open_.coarse.runner_up is not None
    confirmed = registered(features, chosen(RigidTransform.identity(), open_.coarse.runner_up))
    assert confirmed.fine is not None
    off = confirmed.fine.adjustment.pose.target_from_source.inv() * open_.coarse.runner_up
    assert np.linalg.norm(off.translation) < 0.1
    assert confirmed.status is PairStatus.ACCEPTED


@pytest.mark.slow
def test_a_start_that_the_scans_refute_is_followed_but_not_accepted_and_the_searchs_own_pose_is_its_rival() -> None:
    features, poses = scene_features("pipe_hall")
    target, source = reduced(poses, features)
    wrong = RigidTransform.from_translation([6.0, 2.0, 0.0])
    result = registered(features, chosen(target, wrong * source))
    assert not result.status.in_place
    assert result.status is not PairStatus.DOUBTFUL
    assert result.coarse is not None
    assert result.coarse.runner_up is not None
    rival = result.coarse.runner_up.inv() * (target.inv() * source)
    assert np.linalg.norm(rival.translation) < 0.1


@pytest.mark.slow
def test_a_rough_but_right_start_changes_no_clear_answer() -> None:
    features, poses = scene_features("pipe_hall")
    target, source = reduced(poses, features)
    rough = RigidTransform.from_components([0.15, -0.1, 0.1], Rotation.from_rotvec([0.01, 0.0, 0.03]))
    result = registered(features, chosen(target, source * rough, std_m=0.2))
    assert (result.status, is_right(result, poses)) == (PairStatus.ACCEPTED, True)


@pytest.mark.slow
def test_a_wrong_approximate_pose_neither_bends_the_answer_nor_goes_unsaid() -> None:
    features, poses = scene_features("pipe_hall")
    target, source = reduced(poses, features)
    wrong = RigidTransform.from_translation([6.0, 2.0, 0.0])
    result = registered(features, approximate(target, wrong * source, turn_rad=0.002))
    assert is_right(result, poses)
    assert not result.status.in_place
    assert any("South and North" in reason and "contradicts" in reason for reason in result.reasons)


@pytest.mark.slow
def test_right_approximate_poses_change_no_clear_answer() -> None:
    features, poses = scene_features("pipe_hall")
    result = registered(features, approximate(*reduced(poses, features)))
    assert (result.status, is_right(result, poses)) == (PairStatus.ACCEPTED, True)


@pytest.mark.slow
def test_scans_wrongly_said_to_be_levelled_are_not_accepted_wrongly() -> None:
    features, poses = scene_features("pipe_hall")  # turned at random
    result = registered(features, levelled(1e-4))
    assert not result.status.in_place or is_right(result, poses)


@pytest.mark.slow
def test_what_a_request_says_reaches_the_registration_of_a_pair() -> None:
    features, poses = symmetric_room()
    blobs = MemoryBlobStore()
    sides = []
    for name, each, pose in zip(("North", "South"), features, poses, strict=True):
        path = blobs.scratch() / "features.npz"
        save_features(path, each)
        blobs.put_file(f"features/{name}.npz", path)
        std = {"omega_gon": 2.0, "phi_gon": 2.0, "kappa_gon": 2.0, "tx_m": 0.3, "ty_m": 0.3, "tz_m": 0.3}
        known = {"approximate_pose": {"matrix": pose.as_matrix().tolist(), "std": std}}
        scan = {"sha256": name, "filename": f"{name}.e57", "index": 0}
        sides.append({"name": name, "features": f"features/{name}.npz", "known": known, "scan": scan})
    arguments = {"job_id": "j", "number": 0, "target": sides[0], "source": sides[1], "method": {"method": "lines"}}
    assert register_pair(StepContext(blobs, NoProgress()), arguments)["status"] == "accepted"
