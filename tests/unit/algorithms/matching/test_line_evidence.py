"""Lines as witnesses between poses: a flat facade with vertical window edges, and what moves along it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from algorithms.features.scan_features import PhotoEdges, ScanFeatures, SurfaceSample
from algorithms.geometry.lines import Lines, LineSource, lines_from_arrays
from algorithms.matching.feature_fit import feature_pose_near
from algorithms.matching.line_evidence import LineEvidence, LineWitness, moved_across
from algorithms.matching.self_likeness import Contradiction, is_possible_alternative, self_likeness
from algorithms.matching.surface_fit import OPEN_STD_M, surface_pose_covariance
from algorithms.scans.surface_index import SurfaceIndex, surface_index
from tests.scenes.lines.feature_scenes import NO_CYLINDERS, NO_PLANES

VOXEL_M = 0.1
UNEVEN = np.array([0.4, 1.5, 2.1, 3.7, 4.3, 5.9, 6.4, 8.2, 8.9, 10.6, 11.3, 12.8, 13.1, 14.7, 15.2])
"""Places of vertical edges that no shift lays on each other."""
EVEN = np.arange(0.5, 16.0, 1.0)
IDENTITY = RigidTransform.identity()


def along(shift_m: float) -> RigidTransform:
    return RigidTransform.from_translation([shift_m, 0.0, 0.0])


def facade(places: np.ndarray, sensor_x_m: float = 8.0, horizontal: int = 5) -> ScanFeatures:
    """The plane y = 0, x from 0 to 16 m, z from 0 to 5 m, seen from y = -10 m, with edges that photos show."""
    x, z = (grid.ravel() for grid in np.meshgrid(np.arange(0.05, 16.0, VOXEL_M), np.arange(0.05, 5.0, VOXEL_M)))
    points = np.column_stack([x, np.zeros_like(x), z])
    heights = np.linspace(0.5, 4.5, horizontal)
    anchors = np.concatenate(
        [np.column_stack([places, np.zeros_like(places), np.full_like(places, 2.5)]),
         np.column_stack([np.full_like(heights, 8.0), np.zeros_like(heights), heights])]
    )  # fmt: skip
    directions = np.repeat([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]], [len(places), horizontal], axis=0)
    n = len(anchors)
    extents = np.repeat([[-1.0, 1.0], [-7.0, 7.0]], [len(places), horizontal], axis=0)
    towards = np.array([0.0, -1.0, 0.0])
    lines = lines_from_arrays(
        anchors,
        directions,
        np.tile(np.eye(4) * 1e-6, (n, 1, 1)),
        extents,
        sources=np.full(n, int(LineSource.PHOTO_EDGE), dtype=np.int32),
    )
    return ScanFeatures(
        lines=replace(lines, photos=np.zeros(n, dtype=np.int32), photo_jacobians=np.zeros((n, 4, 6))),
        planes=NO_PLANES,
        cylinders=NO_CYLINDERS,
        surface=SurfaceSample(points, np.tile(towards, (len(points), 1)), np.full(len(points), -1, np.int32), VOXEL_M),
        seen=None,
        origin_m=np.zeros(3),
        sensor_m=np.array([sensor_x_m, -10.0, 1.6]),
        point_count=len(points),
        noise_std_m=0.002,
        photo_edges=PhotoEdges(
            *(np.array([n]) for _ in range(3)),
            np.zeros((1, 2), dtype=np.int64),
            np.tile(towards, (n, 1)),
            np.zeros(n, dtype=np.int32),
        ),
    )


def test_edges_missing_in_a_shifted_pose_refute_it() -> None:
    refutation = LineWitness(facade(UNEVEN), facade(UNEVEN)).refutation(IDENTITY, along(0.36), alpha=1e-3)
    assert refutation is not None
    here, there = refutation
    assert here.found == here.expected >= 20
    assert there.expected >= 40
    assert there.found <= 4


def test_the_right_pose_is_not_refuted_by_a_shifted_one() -> None:
    assert LineWitness(facade(UNEVEN), facade(UNEVEN)).refutation(along(0.36), IDENTITY, alpha=1e-2) is None


def test_the_evidence_is_the_same_seen_from_the_other_pose() -> None:
    asked = LineWitness(facade(UNEVEN), facade(UNEVEN))
    assert asked.compare(IDENTITY, along(0.36)) == asked.compare(along(0.36), IDENTITY)[::-1]


def test_a_shift_by_one_of_equal_windows_is_not_refuted() -> None:
    asked = LineWitness(facade(EVEN), facade(EVEN))
    assert asked.compare(IDENTITY, along(1.0))[1].rate > 0.9
    assert asked.self_likeness(IDENTITY, along(1.0)).rate > 0.9
    assert asked.refutation(IDENTITY, along(1.0), alpha=1e-2) is None


def test_edges_along_the_shift_say_nothing() -> None:
    none = np.empty(0)
    here, there = LineWitness(facade(none), facade(none)).compare(IDENTITY, along(0.36))
    assert (here.expected, there.expected) == (0, 0)


def test_a_line_that_turns_moves_by_its_nearer_end() -> None:
    turn = RigidTransform.from_exp_coords([0.0, 0.0, 0.1, 0.0, 0.0, 0.0])
    line = lines_from_arrays(
        np.array([[5.0, 0.0, 0.0]]), np.array([[1.0, 0.0, 0.0]]), np.eye(4)[None], np.array([[-1.0, 1.0]])
    )
    # the nearer end, 4 m from the axis, moves by the chord 8 sin 0.05, half an angle off the normal of the line
    assert moved_across(line, IDENTITY, turn) == pytest.approx(8.0 * np.sin(0.05) * np.cos(0.05))


def test_places_that_the_other_photos_do_not_show_are_not_expected() -> None:
    unseen = facade(np.empty(0), horizontal=0)
    here, _ = LineWitness(facade(UNEVEN), unseen).compare(IDENTITY, along(0.36))
    assert here.expected == 0


def test_a_handful_of_lines_refutes_nothing() -> None:
    few = facade(UNEVEN[:3])
    assert LineWitness(few, few).refutation(IDENTITY, along(0.36), alpha=1e-2) is None


def test_evidence_adds_up() -> None:
    assert LineEvidence(20, 12) + LineEvidence(4, 0) == LineEvidence(24, 12)
    assert (LineEvidence(20, 12) + LineEvidence(4, 0)).rate == pytest.approx(0.5)


def test_lines_pull_a_pose_that_slid_along_the_facade_back() -> None:
    pose = feature_pose_near(facade(UNEVEN), facade(UNEVEN), along(0.08))
    assert np.abs(pose.translation).max() < 1e-3


def test_what_no_feature_fixes_stays_where_it_was() -> None:
    none = np.empty(0)
    pose = feature_pose_near(facade(none), facade(none), RigidTransform.from_translation([0.08, 0.02, 0.02]))
    assert pose.translation[0] == pytest.approx(0.08, abs=1e-9)
    assert np.abs(pose.translation[1:]).max() < 1e-3


def test_scans_without_lines_have_no_evidence() -> None:
    empty = facade(np.empty(0), horizontal=0)
    assert len(Lines.empty()) == len(empty.lines) == 0
    here, there = LineWitness(empty, empty).compare(IDENTITY, along(0.36))
    assert (here.rate, there.rate) == (0.0, 0.0)


def test_a_flat_facade_leaves_the_surfaces_pose_open_along_itself() -> None:
    covariance = surface_pose_covariance(facade(UNEVEN), facade(UNEVEN), IDENTITY)
    assert np.sqrt(covariance[3, 3]) >= 0.99 * OPEN_STD_M
    assert np.sqrt(covariance[5, 5]) >= 0.99 * OPEN_STD_M


def test_misfits_of_a_facade_give_its_depth_an_uncertainty_of_their_size() -> None:
    moved = facade(UNEVEN)
    rng = np.random.default_rng(3)
    cells = np.floor(moved.surface.points[:, [0, 2]] / 0.5).astype(int)
    # waves of 4 mm, the same within half a metre: 32 x 10 independent ones
    moved.surface.points[:, 1] += 0.004 * rng.normal(size=(40, 20))[cells[:, 0], cells[:, 1]]
    covariance = surface_pose_covariance(facade(UNEVEN), moved, IDENTITY)
    centre = np.array([8.0, 0.0, 2.5])
    lever = np.hstack([-np.array([[0, -centre[2], 0], [centre[2], 0, -centre[0]], [0, centre[0], 0]]), np.eye(3)])
    depth = np.sqrt((lever @ covariance @ lever.T)[1, 1])
    assert depth == pytest.approx(0.004 / np.sqrt(320.0), rel=0.3)


def room(pillars_x_m: list[float]) -> SurfaceIndex:
    """The inside of a room 12 m by 6 m by 3 m about the origin, with pillars along its middle; seen from inside."""
    step = np.arange(-6.0, 6.0, VOXEL_M) + 0.5 * VOXEL_M
    points, normals = [], []

    def sheet(a: np.ndarray, b: np.ndarray, axis: int, at: float, towards: float) -> None:
        u, v = (grid.ravel() for grid in np.meshgrid(a, b))
        sheet_points = np.insert(np.column_stack([u, v]), axis, at, axis=1)
        points.append(sheet_points)
        normals.append(np.tile(towards * np.eye(3)[axis], (len(u), 1)))

    y, z = step[np.abs(step) < 3.0], step[np.abs(step) < 1.5]
    for sign in (-1.0, 1.0):
        sheet(y, z, 0, sign * 6.0, -sign)
        sheet(step, z, 1, sign * 3.0, -sign)
        sheet(step, y, 2, sign * 1.5, -sign)
        side = 0.3 * sign
        for x in pillars_x_m:
            near = np.arange(-0.25, 0.3, VOXEL_M)
            sheet(near, z, 0, x + side, sign)
            sheet(x + near, z, 1, side, sign)
    return surface_index(np.concatenate(points), np.concatenate(normals), VOXEL_M, np.array([1.0, 1.8, 0.2]))


HALF_TURN = RigidTransform.from_exp_coords([0.0, 0.0, np.pi, 0.0, 0.0, 0.0])


def possible(scan: SurfaceIndex, alternative: Contradiction) -> bool:
    return is_possible_alternative(
        IDENTITY, HALF_TURN, best=Contradiction(0.9, 0.001), alternative=alternative, target=scan, source=scan,
        noise_m=0.002,
    )  # fmt: skip


def test_a_symmetric_room_is_like_itself_and_a_room_with_an_odd_pillar_is_not() -> None:
    even, odd = (self_likeness(room(places), HALF_TURN, 0.002) for places in ([-2.0, 2.0], [-3.5, -2.0, 0.6]))
    assert even.support > 0.8
    assert even.share < 0.01
    assert odd.share > 0.05


def test_a_clean_alternative_is_possible_where_the_building_is_symmetric_however_little_fits_there() -> None:
    assert possible(room([-2.0, 2.0]), Contradiction(0.1, 0.005))


def test_an_alternative_is_impossible_where_the_building_is_not_symmetric() -> None:
    assert not possible(room([-3.5, -2.0, 0.6]), Contradiction(0.1, 0.005))


def test_an_alternative_that_stands_in_free_space_is_impossible() -> None:
    assert not possible(room([-2.0, 2.0]), Contradiction(0.1, 0.2))
