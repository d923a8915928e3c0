"""Surface as witness between poses: what fits in one of them and cannot be where the other has it."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.geometry.rotations import rotation_matrix
from algorithms.matching.surface_evidence import SurfaceEvidence, SurfaceWitness
from algorithms.scans.pose_scores import FINAL_POINTS, strict_limits
from algorithms.scans.surface_index import SurfaceIndex, evidence_of, seen_through, surface_index
from algorithms.scans.surface_matches import fitting
from tests.scenes.buildings.indexed_rooms import index, walls

LENGTH_M, WIDTH_M, HEIGHT_M = 7.0, 4.5, 2.6
NOISE_M = 0.002
HERE = RigidTransform.identity()
CENTRE = RigidTransform.from_translation([0.5 * LENGTH_M, 0.5 * WIDTH_M, 0.0])
HALF_TURN = CENTRE * RigidTransform.from_rotation(Rotation.from_euler("z", np.pi)) * CENTRE.inv()
SHELL = (
    ((0, 0, 0), (LENGTH_M, 0, 0), (0, WIDTH_M, 0)),
    ((0, 0, HEIGHT_M), (0, WIDTH_M, 0), (LENGTH_M, 0, 0)),
    ((0, 0, 0), (0, WIDTH_M, 0), (0, 0, HEIGHT_M)),
    ((LENGTH_M, 0, 0), (0, 0, HEIGHT_M), (0, WIDTH_M, 0)),
    ((0, 0, 0), (0, 0, HEIGHT_M), (LENGTH_M, 0, 0)),
    ((0, WIDTH_M, 0), (LENGTH_M, 0, 0), (0, 0, HEIGHT_M)),
)
CUPBOARD = (
    ((1.0, 0.8, 0), (0, 0, 1.8), (0.9, 0, 0)),
    ((1.0, 1.3, 0), (0.9, 0, 0), (0, 0, 1.8)),
    ((1.0, 0.8, 0), (0, 0.5, 0), (0, 0, 1.8)),
    ((1.9, 0.8, 0), (0, 0, 1.8), (0, 0.5, 0)),
)
PLATE = (((1.0, 0.8, 1.2), (0, 0, 0.2), (0.2, 0, 0)),)
PANEL = (((2.0, 0.12, 0.4), (0, 0, 1.8), (2.5, 0, 0)),)
"""A board 12 cm before a wall: too near to it to be told from it by free space."""

NICHE = ((2.0, 4.5), (0.4, 2.2))
"""Where along the wall and how high a niche of 12 cm opens, and, after half a turn, one in the wall across."""


def scan(*pieces, sensor=(3.0, 2.5, 1.5)) -> SurfaceIndex:
    return index(*walls(*SHELL, *(face for piece in pieces for face in piece)), sensor)


def panelled(sensor) -> SurfaceIndex:
    """A room with the board, in which the wall behind it is not seen."""
    points, normals = walls(*SHELL, *PANEL)
    x, y, z = points.T
    behind = (y < 0.06) & (x > 1.95) & (x < 4.5) & (z > 0.35) & (z < 2.2)
    points, normals = points[~behind], normals[~behind]
    faces_the_room = (normals[:, 1] < -0.5) & (np.abs(points[:, 1] - 0.12) < 1e-9)
    normals[faces_the_room] *= -1.0
    return surface_index(points, normals, 0.1, np.array(sensor, float))


def with_niches(seen_at, sensor) -> SurfaceIndex:
    """A room with equal niches in two walls, of which the instrument saw the back of one alone."""
    points, normals = walls(*SHELL)
    (x0, x1), (z0, z1) = NICHE
    kept = np.ones(len(points), dtype=bool)
    for pose in (HERE, HALF_TURN):
        x, y, z = pose.apply(points).T
        kept &= ~((y < 0.05) & (x > x0) & (x < x1) & (z > z0) & (z < z1))
    back, facing = walls(((x0, -0.12, z0), (0, 0, z1 - z0), (x1 - x0, 0, 0)))
    facing = facing * np.sign(facing[0, 1])
    back, facing = seen_at.apply(back), seen_at.rotation.apply(facing)
    return surface_index(
        np.vstack([points[kept], back]), np.vstack([normals[kept], facing]), 0.1, np.array(sensor, float)
    )


def refutation(
    target: SurfaceIndex, source: SurfaceIndex, pose: RigidTransform, other: RigidTransform
) -> SurfaceEvidence | None:
    return SurfaceWitness(target, source, NOISE_M).refutation(pose, other)


def test_a_cupboard_refutes_the_half_turn_and_never_the_right_pose() -> None:
    target, source = scan(CUPBOARD), scan(CUPBOARD, sensor=(5.0, 3.0, 1.4))
    found = refutation(target, source, HERE, HALF_TURN)
    assert found is not None
    assert found.here_m2 > 1.0
    assert found.there_m2 < 0.05 * found.here_m2
    assert refutation(target, source, HALF_TURN, HERE) is None


def test_in_a_room_that_is_itself_after_half_a_turn_nothing_refutes_anything() -> None:
    target, source = scan(), scan(sensor=(5.0, 3.0, 1.4))
    assert refutation(target, source, HERE, HALF_TURN) is None
    assert refutation(target, source, HALF_TURN, HERE) is None


def test_a_thing_as_small_as_a_plate_decides_nothing() -> None:
    target, source = scan(PLATE), scan(PLATE, sensor=(5.0, 3.0, 1.4))
    assert refutation(target, source, HERE, HALF_TURN) is None


def test_what_was_there_only_once_refutes_nothing() -> None:
    target, source = scan(), scan(CUPBOARD, sensor=(5.0, 3.0, 1.4))
    assert refutation(target, source, HERE, HALF_TURN) is None
    assert refutation(target, source, HALF_TURN, HERE) is None


def test_what_moved_by_half_a_turn_leaves_it_open_which_pose_is_right() -> None:
    """One cupboard speaks for the one pose and one for the other: no vote is taken."""
    moved = [tuple(HALF_TURN.apply(corner) if k == 0 else HALF_TURN.rotation.apply(corner) for k, corner in
             enumerate(face)) for face in CUPBOARD]  # fmt: skip
    shifted = [(np.add(face[0], [3.6, 2.0, 0.0]), *face[1:]) for face in CUPBOARD]
    target, source = scan(CUPBOARD, shifted), scan(moved, shifted, sensor=(3.0, 1.0, 1.4))
    assert refutation(target, source, HERE, HALF_TURN) is None
    assert refutation(target, source, HALF_TURN, HERE) is None


def test_a_panel_too_near_to_a_wall_to_stand_in_free_space_refutes_as_well() -> None:
    target, source = panelled((3.0, 2.5, 1.5)), panelled((5.0, 3.0, 1.4))
    found = refutation(target, source, HERE, HALF_TURN)
    assert found is not None
    assert found.here_m2 > 3.0
    assert refutation(target, source, HALF_TURN, HERE) is None


def test_what_only_one_instrument_saw_in_a_niche_refutes_nothing() -> None:
    """Each saw one of two equal niches: turned, they fit, and where they are nothing lies on them."""
    target, source = with_niches(HERE, (3.0, 2.5, 1.5)), with_niches(HALF_TURN, (3.6, 1.8, 1.4))
    back = np.abs(target.points[:, 1] + 0.12) < 1e-9
    limits = strict_limits(NOISE_M, 0.1)
    assert fitting(HALF_TURN, target.points[back], target.normals[back], source, limits).sum() > 300
    assert refutation(target, source, HALF_TURN, HERE) is None
    assert refutation(target, source, HERE, HALF_TURN) is None


def test_a_panel_refutes_nothing_where_an_instrument_is_unknown() -> None:
    target, source = panelled((3.0, 2.5, 1.5)), panelled((5.0, 3.0, 1.4))
    blind = surface_index(source.points, source.normals, 0.1, None)
    assert refutation(target, source, HERE, HALF_TURN) is not None
    assert refutation(target, blind, HERE, HALF_TURN) is None


def test_the_answer_does_not_depend_on_which_scan_is_the_target() -> None:
    first, second = scan(CUPBOARD), scan(CUPBOARD, sensor=(5.0, 3.0, 1.4))
    one, other = refutation(first, second, HERE, HALF_TURN), refutation(second, first, HERE, HALF_TURN.inv())
    assert one is not None
    assert other is not None
    assert one.here_m2 == pytest.approx(other.here_m2, rel=1e-12)


def test_points_in_free_space_are_those_that_count_in_the_score_of_a_pose() -> None:
    target, source = scan(CUPBOARD), scan(CUPBOARD, sensor=(5.0, 3.0, 1.4))
    limits = strict_limits(NOISE_M, 0.1)
    points, normals = source.points[:FINAL_POINTS], source.normals[:FINAL_POINTS]
    for pose in (HALF_TURN, RigidTransform.from_translation([0.4, -0.3, 0.1]) * HALF_TURN):
        free = seen_through(pose, points, normals, target, limits) & ~fitting(pose, points, normals, target, limits)
        shares = evidence_of(
            rotation_matrix(pose)[None],
            np.asarray(pose.translation)[None],
            source,
            target,
            points=FINAL_POINTS,
            limits=limits,
        )
        weights = source.weights[:FINAL_POINTS]
        assert weights[free].sum() / weights.sum() == pytest.approx(shares.violation[0], rel=1e-9)
        assert free.any()


def test_where_the_instrument_is_unknown_nothing_was_looked_through() -> None:
    points, normals = walls(*SHELL)
    blind = surface_index(points, normals, 0.1, None)
    inside = np.full((3, 3), 2.0)
    assert not seen_through(HERE, inside, normals[:3], blind, strict_limits(NOISE_M, 0.1)).any()
