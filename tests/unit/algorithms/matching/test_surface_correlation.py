"""Surface correlated with surface and with free space, for all shifts at once."""

from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from algorithms.matching.plane_triples import OffsetVotes
from algorithms.matching.surface_correlation import LEAST_CELL_M, ROUNDING, _transformed, correlated_motions
from algorithms.matching.surface_correlation_kernels import peaks
from algorithms.scans.surface_index import surface_index
from tests.scenes.buildings.indexed_rooms import index, room, walls

NOTHING = np.empty(0)


def votes(rotation=None, axes=None):
    axes = np.eye(3) if axes is None else axes
    return OffsetVotes(
        np.eye(3) if rotation is None else rotation, axes, (NOTHING,) * len(axes), (NOTHING,) * len(axes)
    )


def half_turn():
    return np.diag([-1.0, -1.0, 1.0])


@pytest.mark.parametrize("rotation", [np.eye(3), half_turn()], ids=["parallel", "turned"])
def test_the_best_shift_is_the_true_one_within_a_cell(rotation):
    points, normals = room()
    shift = np.array([3.3, -7.1, 0.4])
    target = index(points, normals, (3.0, 2.5, 1.5))
    moved = (points - shift) @ rotation
    source = index(moved, normals @ rotation, (np.array([3.2, 2.2, 1.4]) - shift) @ rotation)
    found = correlated_motions([votes(rotation)], target, source)
    best = found[np.argsort(-found.votes)[:1]]
    assert np.abs(best.translations_m[0] - shift).max() <= 0.75 * LEAST_CELL_M


def test_the_leading_shift_is_tried_from_the_corners_of_its_cell_as_well():
    points, normals = room()
    target = index(points, normals, (3.0, 2.5, 1.5))
    found = correlated_motions([votes()], target, target)
    offsets = (found.translations_m - found.translations_m[np.argmax(found.votes)]) / LEAST_CELL_M
    for corner in product((-0.5, 0.5), repeat=3):
        assert np.abs(offsets - corner).max(axis=1).min() < 1e-9


def test_a_strip_of_the_room_is_enough():
    points, normals = room()
    strip = points[:, 0] < 1.7
    shift = np.array([-2.0, 1.0, 0.3])
    target = index(points, normals, (3.0, 2.5, 1.5))
    source = index(points[strip] - shift, normals[strip], np.array([1.0, 2.5, 1.5]) - shift)
    found = correlated_motions([votes()], target, source)
    assert np.abs(found.translations_m - shift).max(axis=1).min() <= 0.75 * LEAST_CELL_M


def test_a_place_where_a_wall_stands_in_free_space_scores_less_than_one_where_it_does_not():
    points, normals = room()
    target = index(points, normals, (3.0, 2.5, 1.5))
    found = correlated_motions([votes()], target, target)
    right = np.abs(found.translations_m).max(axis=1) < LEAST_CELL_M
    # shifted along the room by its length's part, floor and ceiling and long walls fit as well, end walls stand inside
    inside = (np.abs(found.translations_m[:, 0]) > 1.0) & (
        np.abs(found.translations_m[:, 1:]).max(axis=1) < LEAST_CELL_M
    )
    assert found.votes[right].max() > 3.0 * found.votes[inside].max(initial=0.0)


def test_two_directions_of_normals_are_completed_by_the_one_across():
    points, normals = room()
    target = index(points, normals, (3.0, 2.5, 1.5))
    found = correlated_motions([votes(axes=np.eye(3)[:2])], target, target)
    assert np.abs(found.translations_m[np.argmax(found.votes)]).max() <= 0.75 * LEAST_CELL_M


def test_the_cells_of_a_long_hall_are_small_however_it_lies_in_the_frame_of_its_scan():
    points, normals = walls(
        ((0, 0, 0), (60.0, 0, 0), (0, 4.0, 0)),
        ((0, 4.0, 0), (60.0, 0, 0), (0, 0, 3.0)),
        ((0, 0, 0), (0, 4.0, 0), (0, 0, 3.0)),
        ((41.0, 1.0, 0), (0, 0.7, 0), (0, 0, 3.0)),
    )
    eye, turn = np.array([30.0, 2.0, 1.5]), Rotation.from_rotvec([0.5, -0.7, 0.6]).as_matrix()
    askew = index(points @ turn.T, normals @ turn.T, turn @ eye)
    found = correlated_motions([votes(axes=turn.T)], askew, askew)
    best = found.translations_m[np.argmax(found.votes)]
    assert np.abs(best).max() <= 0.75 * LEAST_CELL_M
    # from the corners of a cell, which is as small as it would be along the walls
    others = np.linalg.norm(found.translations_m - best, axis=1)
    assert others[others > 1e-6].min() == pytest.approx(np.sqrt(0.75) * LEAST_CELL_M)


def test_without_a_rotation_nothing_is_proposed():
    points, normals = room()
    target = index(points, normals, (3.0, 2.5, 1.5))
    assert len(correlated_motions([], target, target)) == 0


def test_a_scan_whose_instrument_is_unknown_is_laid_surface_on_surface():
    points, normals = room()
    target = surface_index(points, normals, 0.1, None)
    found = correlated_motions([votes()], target, target)
    assert np.abs(found.translations_m[np.argmax(found.votes)]).max() <= 0.75 * LEAST_CELL_M


def test_a_direction_in_which_nothing_is_common_does_not_rule_a_place_out():
    ground, long_wall = ((0, 0, 0), (12.0, 0, 0), (0, 6.0, 0)), ((0, 6.0, 0), (12.0, 0, 0), (0, 0, 3.0))
    steps = [((x, 5.5, 0), (0.5, 0, 0), (0, 0, 1.0 + 0.5 * k)) for k, x in enumerate((3.0, 5.0, 8.5))]
    own = ((0.5, 0, 0), (0, 4.0, 0), (0, 0, 3.0)), ((11.5, 0, 0), (0, 0, 3.0), (0, 4.0, 0))
    shift = np.array([4.0, -3.0, 0.2])
    first = walls(ground, long_wall, *steps, own[0])
    points, normals = walls(ground, long_wall, *steps, own[1])
    target = index(*first, (4.0, 2.0, 1.5))
    source = index(points - shift, normals, np.array([8.0, 2.0, 1.5]) - shift)
    found = correlated_motions([votes()], target, source)
    right = np.abs(found.translations_m - shift).max(axis=1) <= 0.75 * LEAST_CELL_M
    assert found.votes[right].max(initial=0.0) > 0.2


def test_shifts_that_score_alike_side_by_side_count_once_from_their_middle():
    score = np.zeros((12, 10, 8), dtype=np.float32)
    score[3:5, 4:7, 2] = 1.0
    score[3, 4, 2] -= 1e-6  # rounding
    score[9, 2, 6] = 0.5
    score[[11, 0], 8, 4] = 0.25  # round the edge
    cells, middles = peaks(score, 0.1, ROUNDING)
    assert middles[np.argsort(-score[tuple(cells.T)])[:2]].tolist() == [[3.5, 5.0, 2.0], [9.0, 2.0, 6.0]]
    assert sorted(middles[:, 0] % 12) == [3.5, 9.0, 11.5]


def test_where_nothing_scores_there_is_no_peak():
    cells, middles = peaks(np.zeros((4, 5, 6), dtype=np.float32), 0.1, ROUNDING)
    assert (cells.shape, middles.shape) == ((0, 3), (0, 3))


def test_fields_in_the_corner_of_a_raster_are_transformed_as_if_it_were_filled_up_with_zeros():
    fields = np.random.default_rng(3).random((2, 5, 7, 9)).astype(np.float32)
    shape = (12, 15, 20)
    expected = np.fft.rfftn(fields, shape, axes=(1, 2, 3))
    assert np.abs(_transformed(fields, shape) - expected).max() < 1e-5 * np.abs(expected).max()  # single precision
