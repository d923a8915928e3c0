"""Hypotheses of a pose, sifted coarse to fine."""

import numpy as np
import pytest

from algorithms.matching.hypotheses import FINE_SIFTS, rank_hypotheses
from algorithms.matching.votes import Motions
from tests.scenes.buildings.indexed_rooms import index, room


def two_rooms():
    """Give a room, and the next one with the strip of the first that is seen from there."""
    points, normals = room()
    strip, mirrored = points[:, 0] < 0.8, np.array([-1.0, 1.0, 1.0])
    places = np.concatenate([points[strip], points * mirrored - [0.2, 0.0, 0.0]])
    facing = np.concatenate([normals[strip], normals * mirrored])
    return index(points, normals, (3.0, 2.5, 1.5)), index(places, facing, (-1.0, 2.5, 1.5))


def shifts(rng, off_m):
    """Give many shifts that lay floor on floor, and one that is off the right place by so much."""
    wrong = np.column_stack([rng.uniform(1.0, 12.0, 2000), rng.uniform(-4.0, 4.0, 2000), np.zeros(2000)])
    translations = np.vstack([off_m, wrong])
    return Motions(np.tile(np.eye(3), (len(translations), 1, 1)), translations, np.ones(len(translations)))


@pytest.mark.parametrize("settle_first", [False, True], ids=["as they are", "settled first"])
def test_a_rough_hypothesis_with_little_in_common_survives_only_if_it_is_settled_first(settle_first):
    target, source = two_rooms()
    rough = shifts(np.random.default_rng(1), (0.24, -0.24, 0.24))
    ranked = rank_hypotheses(rough, target, source, noise_m=0.002, sifts=FINE_SIFTS, settle_first=settle_first, most=4)
    nearest_m = min(np.linalg.norm(np.asarray(pose.translation)) for pose in ranked.poses)
    assert (nearest_m < 0.01) == settle_first
