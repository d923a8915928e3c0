"""The drawn square is what Dold, Ripperda and Brenner say of theirs."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial import cKDTree

from algorithms.simulation.holzmarkt import LMS_Z360I, PRINTED_OVERLAPS, SET_UPS, SetUp, holzmarkt, holzmarkt_scene
from algorithms.simulation.scanning import scan_scene

COARSE = replace(LMS_Z360I, rows=250, columns=1000, mixed_pixels=False)
NEAR_M = 0.5
"""Points of set-up 1 with a point of another so near overlap (the paper's definition)."""


@cache
def set_ups() -> dict[str, SetUp]:
    return {each.name: each for each in holzmarkt(np.random.default_rng(1))}


def test_there_are_twelve_upright_and_eight_tilted_set_ups() -> None:
    leaning = {
        name: np.degrees(np.arccos(each.world_from_scan.rotation.as_matrix()[2, 2])) for name, each in set_ups().items()
    }
    assert list(leaning) == list(SET_UPS)
    assert sum(each.tilted for each in set_ups().values()) == 8
    assert all((angle > 20.0) if name.endswith("a") else (angle < 5.0) for name, angle in leaning.items())


def test_upright_set_ups_are_five_metres_apart() -> None:
    places = np.array([each.world_from_scan.translation for each in set_ups().values() if not each.tilted])
    np.testing.assert_allclose(np.linalg.norm(np.diff(places[:, :2], axis=0), axis=1), 5.0, atol=0.3)


def test_the_data_sheet_is_the_printed_one() -> None:
    assert np.degrees(LMS_Z360I.row_step_rad) == pytest.approx(0.12)
    assert np.degrees(LMS_Z360I.column_step_rad) == pytest.approx(0.12)
    assert (LMS_Z360I.range_noise_std_m, LMS_Z360I.max_range_m) == (0.012, 200.0)


def test_other_people_and_cars_pass_at_each_set_up() -> None:
    vertices = [each.scene.vertices for each in set_ups().values()]
    standing = len(holzmarkt_scene().vertices) // 2
    for here, there in pairwise(vertices):
        np.testing.assert_array_equal(here[:standing], there[:standing])
        assert len(here) != len(there) or not np.array_equal(here[standing:], there[standing:])


def test_another_generator_draws_another_place() -> None:
    other = next(holzmarkt(np.random.default_rng(2)))
    assert not np.array_equal(other.scene.vertices[:100], set_ups()["1"].scene.vertices[:100])


@pytest.mark.slow
def test_overlaps_fall_as_the_printed_ones() -> None:
    rng = np.random.default_rng(3)
    clouds = {}
    for name in ("1", "2", "5", "6", "9", "12"):
        each = set_ups()[name]
        clouds[name] = each.world_from_scan.apply(scan_scene(each.scene, each.world_from_scan, COARSE, rng).points)
    first = clouds.pop("1")[::5]
    found = {
        name: float(np.isfinite(cKDTree(cloud).query(first, distance_upper_bound=NEAR_M)[0]).mean())
        for name, cloud in clouds.items()
    }
    assert found == pytest.approx({name: PRINTED_OVERLAPS[name] for name in found}, abs=0.2)
    assert list(found.values()) == sorted(found.values(), reverse=True)
