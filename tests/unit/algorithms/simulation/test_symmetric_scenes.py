"""Scenes that are symmetric on purpose."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from algorithms.simulation.symmetric_scenes import HALF_TURN, SYMMETRIC_SCENES


def asymmetry_m(name: str, oddities: int, seed: int = 5) -> float:
    """The largest distance of a corner of the scene from the nearest one of the turned scene."""
    vertices = SYMMETRIC_SCENES[name](np.random.default_rng(seed), oddities).vertices
    return float(cKDTree(HALF_TURN.apply(vertices)).query(vertices)[0].max())


@pytest.mark.parametrize("name", list(SYMMETRIC_SCENES))
def test_half_a_turn_lays_the_scene_onto_itself(name: str) -> None:
    assert asymmetry_m(name, oddities=0) < 1e-9


@pytest.mark.parametrize("name", list(SYMMETRIC_SCENES))
def test_each_oddity_breaks_the_symmetry(name: str) -> None:
    assert asymmetry_m(name, oddities=1) > 0.05


@pytest.mark.parametrize("name", list(SYMMETRIC_SCENES))
def test_the_same_generator_builds_the_same_scene(name: str) -> None:
    first, second = (SYMMETRIC_SCENES[name](np.random.default_rng(8), 2) for _ in range(2))
    assert np.array_equal(first.vertices, second.vertices)
    assert all(
        np.array_equal(a.as_matrix(), b.as_matrix()) for a, b in zip(first.stations, second.stations, strict=True)
    )


@pytest.mark.parametrize("name", list(SYMMETRIC_SCENES))
def test_no_station_stands_in_a_piece_of_furniture(name: str) -> None:
    for seed in range(5):
        scene = SYMMETRIC_SCENES[name](np.random.default_rng(seed), 3)
        for station in scene.stations:
            nearest = cKDTree(scene.vertices).query(station.translation)[0]
            assert nearest > 0.3
