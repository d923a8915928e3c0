"""Votes for motions."""

import numpy as np
from scipy.spatial.transform import Rotation

from algorithms.matching.votes import Motions, nearest_rotations, rotation_clusters, vote_motions


def _motions(count: int, seed: int) -> Motions:
    rng = np.random.default_rng(seed)
    rotations = Rotation.random(count, random_state=seed).as_matrix()
    return Motions(rotations, rng.uniform(-20.0, 20.0, (count, 3)), np.ones(count))


def test_many_agreeing_motions_win_over_scattered_ones() -> None:
    rng = np.random.default_rng(3)
    true = Rotation.from_rotvec([0.3, -0.8, 1.9])
    near = Rotation.from_rotvec(rng.normal(scale=0.01, size=(60, 3))) * true
    centre = np.array([5.0, 2.0, 1.0])
    wanted = np.array([4.0, -3.0, 2.0])
    translations = wanted + rng.normal(scale=0.05, size=(60, 3)) - near.apply(centre)
    scattered = _motions(400, 1)
    motions = Motions(
        np.concatenate([scattered.rotations, near.as_matrix()]),
        np.concatenate([scattered.translations_m, translations]),
        np.ones(460),
    )
    best = vote_motions(motions, centre, radius_rad=0.07, radius_m=0.3, most_rotations=50, most=10)
    assert np.linalg.norm(best.rotations[0] @ centre + best.translations_m[0] - wanted) < 0.1
    assert (Rotation.from_matrix(best.rotations[0]).inv() * true).magnitude() < 0.02


def test_opposite_quaternions_are_one_rotation() -> None:
    half_turns = Rotation.from_rotvec(np.array([[np.pi - 0.001, 0.0, 0.0], [-np.pi + 0.001, 0.0, 0.0]]))
    leaders, members = rotation_clusters(half_turns.as_matrix(), np.ones(2), radius_rad=0.05, most=5)
    assert len(leaders) == 1
    assert members.tolist() == [0, 0]


def test_no_motions_give_no_answer() -> None:
    kept = vote_motions(Motions.empty(), np.zeros(3), radius_rad=0.1, radius_m=0.1, most_rotations=5, most=5)
    assert len(kept) == 0


def test_the_nearest_rotation_is_proper_even_for_a_mirror() -> None:
    assert np.linalg.det(nearest_rotations(np.diag([1.0, 1.0, -1.0])[None])[0]) > 0.0
