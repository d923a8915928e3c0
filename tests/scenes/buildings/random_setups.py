"""Instruments set up anywhere about the recommended stations of the simulator's scenes."""

from collections.abc import Callable
from itertools import combinations

import numpy as np

from algorithms.simulation.ray_casting import RayCaster
from algorithms.simulation.scanner import directions_of
from algorithms.simulation.scene import Scene
from tests.scenes.buildings.regular_buildings import Place
from tests.scenes.buildings.simulated_pairs import OVERLAPPING

NEIGHBOURS = OVERLAPPING | {
    "corridor": ((1, 2), (2, 3), (3, 4), (6, 7)),
    "street_square": tuple(combinations(range(4), 2)),
}
"""Pairs of recommended stations that see much of the same."""
FARTHEST_M, CLEARANCE_M = 3.0, 0.4
"""From a recommended station along x and along y, and from what stands around."""
HEIGHTS_M = 1.2, 2.3
"""Less or more below the instrument is no floor to stand on."""


def places_about_stations(scene: Scene, rng: np.random.Generator) -> Callable[[], Place]:
    """Give a function that draws places with a floor below and nothing near, with the floor's height [m]."""
    caster = RayCaster(scene)
    around = np.linspace(0.0, 2 * np.pi, 90, endpoint=False)
    beams = np.vstack([directions_of(around, np.full(90, angle)) for angle in (-0.5, 0.0, 0.5)])

    def place() -> Place:
        while True:
            station = scene.stations[int(rng.integers(len(scene.stations)))]
            x, y, z = station.translation + np.append(rng.uniform(-FARTHEST_M, FARTHEST_M, 2), 0.0)
            centre = np.array([x, y, z])
            below = float(caster.cast(centre, np.array([[0.0, 0.0, -1.0]])).ranges_m[0])
            free = caster.cast(centre, beams).ranges_m.min() > CLEARANCE_M
            if free and HEIGHTS_M[0] < below < HEIGHTS_M[1]:
                return x, y, z - below

    return place
