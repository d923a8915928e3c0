"""Which other poses the likeness of a building to itself makes possible."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.matching.self_likeness import Contradiction, is_possible_alternative, keeps_directions, self_likeness
from algorithms.scans.surface_index import SurfaceIndex, surface_index
from tests.scenes.lines.feature_scenes import rectangle

LENGTH_M, WIDTH_M, HEIGHT_M = 24.0, 3.0, 2.6
HERE = RigidTransform.identity()
HALF_TURN = RigidTransform.from_rotation(Rotation.from_rotvec([0.0, 0.0, np.pi]))
CLEAN, SPOTTED = 0.0, 0.004


def _corridor(seed: int, place_m: float) -> SurfaceIndex:
    """A smooth corridor with closed ends, seen from its axis: turned by half a circle it is itself again."""
    rng = np.random.default_rng(seed)
    a, b, c = 0.5 * LENGTH_M, 0.5 * WIDTH_M, HEIGHT_M
    long, wide, high = np.diag([LENGTH_M, WIDTH_M, HEIGHT_M])
    faces = [
        ((-a, -b, 0.0), long, wide, (0.0, 0.0, 1.0)),
        ((-a, -b, c), long, wide, (0.0, 0.0, -1.0)),
        ((-a, -b, 0.0), long, high, (0.0, 1.0, 0.0)),
        ((-a, b, 0.0), long, high, (0.0, -1.0, 0.0)),
        ((-a, -b, 0.0), wide, high, (1.0, 0.0, 0.0)),
        ((a, -b, 0.0), wide, high, (-1.0, 0.0, 0.0)),
    ]
    counts = [int(30 * np.linalg.norm(np.cross(first, second))) for _, first, second, _ in faces]
    points = [rectangle(rng, *face[:3], count) for face, count in zip(faces, counts, strict=True)]
    normals = np.repeat([face[3] for face in faces], counts, axis=0)
    return surface_index(np.concatenate(points), normals, 0.18, np.array([place_m, 0.0, 1.5]))


@pytest.fixture(scope="module")
def scans() -> tuple[SurfaceIndex, SurfaceIndex]:
    return _corridor(1, -2.0), _corridor(2, 3.0)


def _possible(
    scans: tuple[SurfaceIndex, SurfaceIndex],
    other: RigidTransform,
    support: float,
    *,
    against_best: float = SPOTTED,
    of_best: float = 0.75,
    against: float = CLEAN,
) -> bool:
    """Ask for a clean alternative of such support beside a pose with which, unless said, three quarters of all fit."""
    return is_possible_alternative(
        HERE,
        other,
        best=Contradiction(of_best, against_best),
        alternative=Contradiction(support, against),
        target=scans[0],
        source=scans[1],
        noise_m=0.0,
    )


def test_a_symmetric_corridor_lies_on_itself_after_half_a_turn(scans):
    like = self_likeness(scans[0], HALF_TURN, 0.0)
    assert like.support > 0.5
    assert like.share < 0.01


def test_half_a_turn_of_a_symmetric_corridor_is_possible(scans):
    assert _possible(scans, HALF_TURN, 0.5)


def test_half_a_turn_stays_possible_beside_a_spotless_pose_where_little_is_common(scans):
    assert _possible(scans, HALF_TURN, 0.12, against_best=CLEAN)


def test_a_clean_turn_is_possible_beside_a_spotless_pose_although_neither_scan_is_like_itself(scans):
    quarter = RigidTransform.from_rotation(Rotation.from_rotvec([0.0, 0.0, 0.5 * np.pi]))
    assert _possible(scans, quarter, 0.12, against_best=CLEAN)


@pytest.mark.parametrize(
    ("of_best", "support", "possible"), [(0.75, 0.12, False), (0.75, 0.06, False), (0.2, 0.06, True)]
)
def test_a_turn_to_where_no_surface_faces_is_no_symmetry_and_possible_only_beside_what_fits_little(
    scans, of_best, support, possible
):
    askew = RigidTransform.from_rotation(Rotation.from_rotvec([0.0, 0.0, np.radians(165.0)]))
    assert _possible(scans, askew, support, against_best=CLEAN, of_best=of_best) == possible


@pytest.mark.parametrize("degrees", [0.0, 3.0, 90.0, 180.0])
def test_right_angles_keep_the_directions_of_a_corridor_in_any_frame(degrees):
    frame = Rotation.from_rotvec([0.3, -0.8, 1.2])
    corridor = _corridor(1, 0.0)
    tilted = surface_index(frame.apply(corridor.points), frame.apply(corridor.normals), 0.18, np.zeros(3))
    turn = (frame * Rotation.from_rotvec([0.0, 0.0, np.radians(degrees)]) * frame.inv()).as_matrix()
    assert keeps_directions(tilted, turn[None]).all()


@pytest.mark.parametrize("degrees", [10.0, 45.0, 75.0, 170.0])
def test_other_turns_do_not_keep_them(degrees):
    turn = Rotation.from_rotvec([0.0, 0.0, np.radians(degrees)]).as_matrix()
    assert not keeps_directions(_corridor(1, 0.0), turn[None]).any()


@pytest.mark.parametrize(("turn", "possible"), [(np.pi, True), (0.5 * np.pi, False)])
def test_hardly_anything_in_common_is_enough_only_for_a_turn_that_lays_both_scans_on_themselves(scans, turn, possible):
    motion = RigidTransform.from_rotation(Rotation.from_rotvec([0.0, 0.0, turn]))
    assert _possible(scans, motion, 0.05, against_best=CLEAN) == possible


def test_beside_a_spotless_pose_no_shift_is_possible_where_little_is_common(scans):
    assert not _possible(scans, RigidTransform.from_translation([12.0, 0.0, 0.0]), 0.12, against_best=CLEAN)


@pytest.mark.parametrize(("support", "possible"), [(0.7, True), (0.45, False)])
def test_a_small_shift_is_possible_only_where_it_fits_nearly_as_much(scans, support, possible):
    # Half the corridor's surface is farther than some 4 m from the instruments: 0.15 of that is 0.6 m.
    assert _possible(scans, RigidTransform.from_translation([0.4, 0.0, 0.0]), support) == possible


@pytest.mark.parametrize(("against", "possible"), [(0.07, True), (0.12, False)])
def test_what_fits_much_better_may_be_contradicted_no_more_for_that(scans, against, possible):
    assert _possible(scans, HALF_TURN, 0.6, of_best=0.2, against=against) == possible


def test_what_hardly_fits_at_all_is_no_alternative(scans):
    assert not _possible(scans, HALF_TURN, 0.015)


@pytest.mark.parametrize(("support", "possible"), [(0.12, True), (0.09, False)])
def test_what_nothing_speaks_against_is_possible_beside_what_something_does_although_no_scan_is_like_itself(
    scans, support, possible
):
    elsewhere = RigidTransform.from_components([9.0, 0.0, 1.0], Rotation.from_rotvec([0.0, 0.4, 0.0]))
    assert self_likeness(scans[0], elsewhere, 0.0).share > 0.05
    assert _possible(scans, elsewhere, support) == possible


@pytest.mark.parametrize(("support", "against_best", "possible"),
                         [(0.03, 0.028, True), (0.03, 0.012, False), (0.015, 0.028, False)])  # fmt: skip
def test_hardly_anything_in_common_is_possible_beside_what_much_speaks_against(scans, support, against_best, possible):
    storey = RigidTransform.from_translation([0.0, 12.0, 3.0])
    assert _possible(scans, storey, support, against_best=against_best) == possible


def test_beside_what_nothing_speaks_against_it_is_none(scans):
    elsewhere = RigidTransform.from_components([9.0, 0.0, 1.0], Rotation.from_rotvec([0.0, 0.0, 0.3]))
    assert not _possible(scans, elsewhere, 0.12, against_best=CLEAN)
