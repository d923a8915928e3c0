"""Surfaces slid along the direction that planes leave open."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.matching.plane_triples import OffsetVotes
from algorithms.matching.sliding import BIN_M, sliding_motions
from algorithms.scans.surface_index import SurfaceIndex, surface_index

SPACING_M = 0.1
ROTATION = Rotation.from_rotvec([0.4, -0.7, 1.2])
SHIFT_M = np.array([14.0, 2.0, -1.0])
MOTION = RigidTransform.from_components(SHIFT_M, ROTATION)
"""Target from source. The street runs along x of the target frame, its facade stands across y, its ground across z."""
REVEALS_M = np.array([0.0, 1.3, 4.1, 5.2, 9.7, 11.0, 15.9, 16.6])
"""Where along the street pieces of a few decimetres face along it."""


def _street(first_m: float, last_m: float, *, seed: int, side: float = 1.0) -> SurfaceIndex:
    """A stretch of facade and ground with reveals in unequal steps, in the target frame."""
    rng = np.random.default_rng(seed)
    length = last_m - first_m
    facade = rng.uniform([first_m, 0.0, 0.0], [last_m, 0.0, 6.0], (int(40 * length), 3))
    ground = rng.uniform([first_m, 0.0, 0.0], [last_m, 8.0, 0.0], (int(40 * length), 3))
    points, normals = (
        [facade, ground],
        [np.tile([0.0, 1.0, 0.0], (len(facade), 1)), np.tile([0.0, 0.0, 1.0], (len(ground), 1))],
    )
    for number, x in enumerate(REVEALS_M):
        if first_m <= x <= last_m:
            low = 0.4 * number
            points.append(rng.uniform([x, 0.0, low], [x, 0.4, low + 1.0], (60, 3)))
            normals.append(np.tile([side, 0.0, 0.0], (60, 1)))
    return surface_index(
        np.concatenate(points), np.concatenate(normals), SPACING_M, np.array([0.5 * (first_m + last_m), 4.0, 1.7])
    )


def _in_source_frame(scan: SurfaceIndex) -> SurfaceIndex:
    """Move a stretch of the street into the frame of the source."""
    back = MOTION.inv()
    return surface_index(
        back.apply(scan.points), back.rotation.apply(scan.normals), SPACING_M, back.apply(scan.sensor_m)
    )


def _known_across() -> OffsetVotes:
    """The facade and the ground give two components of the translation, and wrong ones beside."""
    axes = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    offsets = tuple(np.array([SHIFT_M[axis] + 3.0, SHIFT_M[axis]]) for axis in (1, 2))
    return OffsetVotes(ROTATION.as_matrix(), axes, offsets, (np.ones(2), np.ones(2)))


@pytest.fixture(scope="module")
def target() -> SurfaceIndex:
    return _street(-2.0, 12.0, seed=1)


def test_reveals_tell_the_place_along_a_street_in_which_a_quarter_overlaps(target):
    found = sliding_motions([_known_across()], target, _in_source_frame(_street(8.5, 22.0, seed=2)))
    best = int(np.argmax(found.votes))
    # half a bin, and the noise of the two other components, which is none
    np.testing.assert_allclose(found.translations_m[best], SHIFT_M, atol=BIN_M)
    np.testing.assert_allclose(found.rotations[best], ROTATION.as_matrix())


def test_a_surface_never_meets_one_that_faces_the_other_way(target):
    behind = _in_source_frame(_street(-2.0, 12.0, seed=3, side=-1.0))
    assert len(sliding_motions([_known_across()], target, behind)) == 0


def test_one_known_direction_is_not_enough_to_slide(target):
    votes = _known_across()
    single = OffsetVotes(votes.rotation, votes.axes[:1], votes.offsets_m[:1], votes.votes[:1])
    assert len(sliding_motions([single], target, _in_source_frame(target))) == 0


def test_sliding_twice_gives_the_same_bytes(target):
    source = _in_source_frame(_street(8.5, 22.0, seed=2))
    first, second = (sliding_motions([_known_across()], target, source) for _ in range(2))
    assert first.translations_m.tobytes() == second.translations_m.tobytes()
    assert first.votes.tobytes() == second.votes.tobytes()
