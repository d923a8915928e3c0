"""The street and its square are what a campaign in a town centre looks like."""

from functools import cache

import numpy as np
import pytest

from algorithms.simulation.parts import CylinderTruth
from algorithms.simulation.ray_casting import RayCaster
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import simulate_stations
from algorithms.simulation.scene import Scene
from algorithms.simulation.street_square import STEP_M, row_of_houses, street_scene, street_square_scene

COARSE = VirtualScanner(rows=60, columns=150, mixed_pixels=False)


@cache
def _square() -> Scene:
    return street_square_scene()


def _tilts_deg(scene: Scene) -> np.ndarray:
    """Angles between the instruments' vertical axes and the plumb line."""
    return np.degrees(np.arccos([pose.rotation.as_matrix()[2, 2] for pose in scene.stations]))


def test_twelve_stations_stand_five_metres_apart() -> None:
    places = np.array([pose.translation[:2] for pose in _square().stations])
    assert len(places) == 12
    # The places are written with centimetres.
    np.testing.assert_allclose(np.linalg.norm(np.diff(places, axis=0), axis=1), STEP_M, atol=0.02)


def test_a_third_of_the_tripods_leans_by_tens_of_degrees() -> None:
    tilts = np.sort(_tilts_deg(_square()))
    assert (tilts[:8] < 3.0).all()
    assert ((tilts[8:] > 20.0) & (tilts[8:] < 60.0)).all()


def test_lamps_stand_upright() -> None:
    posts = [tube for tube in _square().cylinders if tube.radius_m == 0.075]
    assert len(posts) == 5
    assert all(_is_upright(post) for post in posts)


def _is_upright(tube: CylinderTruth) -> bool:
    return tube.start_m[:2] == tube.end_m[:2]


def test_houses_of_a_row_have_heights_and_depths_of_their_own() -> None:
    parts = row_of_houses((0.0, 0.0), (46.0, 0.0), np.random.default_rng(3))
    fronts = [part for part in parts if np.ptp(part.vertices[:, 1]) < 1e-9 and np.ptp(part.vertices[:, 0]) > 6.0]
    assert len(fronts) == 5
    assert len({round(float(part.vertices[:, 2].max()), 2) for part in fronts}) == 5
    assert len({round(float(part.vertices[0, 1]), 2) for part in fronts}) == 5


def test_each_station_has_in_sight_a_third_of_what_the_one_before_sees() -> None:
    scene = _square()
    caster = RayCaster(scene)
    scans = list(simulate_stations(scene, scene.stations, COARSE, np.random.default_rng(0)))
    for k in range(1, len(scans)):
        rays = scene.stations[k - 1].apply(scans[k - 1].points) - scene.stations[k].translation
        distances = np.linalg.norm(rays, axis=1)
        hits = caster.cast(np.asarray(scene.stations[k].translation), rays / distances[:, None])
        assert np.mean(np.abs(hits.ranges_m - distances) < 0.03) > 1 / 3


def test_no_station_stands_against_a_surface() -> None:
    for scan in simulate_stations(_square(), _square().stations, COARSE, np.random.default_rng(0)):
        assert np.linalg.norm(scan.points, axis=1).min() > 1.0


@pytest.mark.parametrize("stations", [5, 20])
def test_a_street_is_as_long_as_its_stations_need(stations: int) -> None:
    scene = street_scene(stations, np.random.default_rng(1))
    assert len(scene.stations) == stations
    assert scene.stations[-1].translation[0] - scene.stations[0].translation[0] == STEP_M * (stations - 1)


def test_the_same_generator_builds_the_same_street() -> None:
    first, second = (street_scene(5, np.random.default_rng(8)).vertices for _ in range(2))
    assert np.array_equal(first, second)
