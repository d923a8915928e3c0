"""Surface in free space is named piece by piece."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.features.scan_features import ScanFeatures, SurfaceSample
from algorithms.geometry.lines import lines_from_arrays
from algorithms.quality.acceptance import AcceptanceStatus, judge
from algorithms.quality.overlap import verify_pose
from tests.scenes.buildings.indexed_rooms import walls
from tests.scenes.lines.feature_scenes import NO_CYLINDERS, NO_PLANES

ROOM = (
    ((0, 0, 0), (6, 0, 0), (0, 4, 0)),
    ((0, 0, 2.5), (0, 4, 0), (6, 0, 0)),
    ((0, 0, 0), (0, 4, 0), (0, 0, 2.5)),
    ((6, 0, 0), (0, 0, 2.5), (0, 4, 0)),
    ((0, 0, 0), (0, 0, 2.5), (6, 0, 0)),
    ((0, 4, 0), (6, 0, 0), (0, 0, 2.5)),
)
BOARD = ((1.0, 1.0, 0.2), (0, 0, 1.6), (1.2, 0, 0))
"""It faces the wall y = 4 m: 1.9 m2."""
CRATE = ((4.5, 1.2, 1.0), (0, 0, 0.6), (0.7, 0, 0))
"""It hangs in the air: near the floor less of it can be judged."""
POSE = RigidTransform.from_components([0.5, -1.0, 0.3], Rotation.from_euler("z", 0.7))


def hall(*pieces, sensor=(7.0, 6.0, 1.5)) -> ScanFeatures:
    """The room twice as long and wide."""
    return scan(*pieces, sensor=sensor, room=[np.array(wall) * (2.0, 2.0, 1.0) for wall in ROOM])


def field(*, sensor, blind_m, rng) -> ScanFeatures:
    """Rough ground, but for what is nearer than that to an instrument low above it."""
    places = np.stack(np.meshgrid(np.arange(-8.0, 8.0, 0.1), np.arange(-8.0, 8.0, 0.1)), axis=-1).reshape(-1, 2)
    places = places[np.linalg.norm(places - sensor[:2], axis=1) > blind_m]
    points = np.column_stack([places, rng.normal(0.0, 0.025, len(places))])
    return bare(points, np.broadcast_to([0.0, 0.0, 1.0], points.shape), np.array(sensor), noise_std_m=0.04)


def scan(*pieces, sensor=(3.0, 3.0, 1.5), origin=(0.0, 0.0, 0.0), moved=None, room=ROOM) -> ScanFeatures:
    points, normals = walls(*room, *pieces)
    place = np.array(sensor, float)
    if moved is not None:
        points, normals, place = moved.apply(points), moved.rotation.apply(normals), moved.apply(place)
    return bare(points, normals, place, origin=origin)


def bare(points, normals, place, *, origin=(0.0, 0.0, 0.0), noise_std_m=0.002) -> ScanFeatures:
    empty = np.empty((0, 3))
    return ScanFeatures(
        lines=lines_from_arrays(empty, empty, np.empty((0, 4, 4)), np.empty((0, 2)), sources=np.empty(0, np.int32)),
        planes=NO_PLANES,
        cylinders=NO_CYLINDERS,
        surface=SurfaceSample(points, normals, np.full(len(points), -1, np.int32), 0.1),
        seen=None,
        origin_m=np.array(origin, float),
        sensor_m=place,
        point_count=len(points),
        noise_std_m=noise_std_m,
    )


def test_what_only_one_scan_shows_is_named_with_its_place_and_size() -> None:
    target = scan()
    source = scan(BOARD, CRATE, sensor=(3.5, 3.2, 1.4), origin=(100.0, 200.0, 50.0), moved=POSE.inv())
    pieces = verify_pose(target, source, POSE).unexplained
    assert [piece.in_target for piece in pieces] == [False, False]
    board, crate = pieces
    centre = POSE.inv().apply(np.array([1.6, 1.0, 1.0])) + np.array([100.0, 200.0, 50.0])
    np.testing.assert_allclose(board.centre_m, centre, atol=0.1)
    assert board.area_m2 == pytest.approx(1.9, rel=0.1)
    assert board.range_m == pytest.approx(np.linalg.norm([1.6 - 3.0, 1.0 - 3.0, 1.0 - 1.5]), abs=0.2)
    assert crate.area_m2 == pytest.approx(0.42, rel=0.2)


def test_it_is_said_of_whichever_scan_shows_it() -> None:
    pieces = verify_pose(scan(BOARD), scan(sensor=(3.5, 3.2, 1.4)), RigidTransform.identity()).unexplained
    assert [piece.in_target for piece in pieces] == [True]


def test_two_scans_of_the_same_room_leave_nothing_unexplained() -> None:
    both = scan(BOARD, CRATE), scan(BOARD, CRATE, sensor=(3.5, 3.2, 1.4))
    assert verify_pose(*both, RigidTransform.identity()).unexplained == ()


def test_rough_ground_that_a_low_instrument_measures_only_farther_off_stands_in_nobody_s_way() -> None:
    rng = np.random.default_rng(3)
    target = field(sensor=(0.0, 0.0, 0.35), blind_m=3.0, rng=rng)
    source = field(sensor=(5.0, 0.0, 0.35), blind_m=3.0, rng=rng)
    assert verify_pose(target, source, RigidTransform.identity()).unexplained == ()


def test_where_the_other_instrument_is_unknown_nothing_is_said() -> None:
    blind = replace(scan(), sensor_m=None)
    assert verify_pose(blind, scan(BOARD), RigidTransform.identity()).unexplained == ()


@pytest.mark.parametrize(("piece", "words"), [(BOARD, True), (CRATE, False)])
def test_a_large_piece_is_worth_a_word_in_the_reasons(piece, words) -> None:
    verification = verify_pose(scan(), scan(piece, sensor=(3.5, 3.2, 1.4)), RigidTransform.identity())
    verdict = judge(verification, runner_up_score=0.0, supporters=20)
    assert any("in one piece, seen by the source" in reason for reason in verdict.reasons) == words


@pytest.mark.parametrize(("width_m", "status"), [(4.2, AcceptanceStatus.ACCEPTED), (5.6, AcceptanceStatus.DOUBTFUL)])
def test_what_is_larger_than_a_lorry_s_side_makes_the_pose_doubtful(width_m, status) -> None:
    target, source = hall(), hall(((2.0, 3.0, 0.2), (0, 0, 2.1), (width_m, 0, 0)), sensor=(7.5, 6.2, 1.4))
    verification = verify_pose(target, source, RigidTransform.identity())
    assert verification.unexplained[0].area_m2 == pytest.approx(2.1 * width_m, rel=0.1)
    assert judge(verification, runner_up_score=0.0, supporters=20).status is status
