"""A small block of strips over a made-up village, with planted errors and control on roofs and ground."""

import numpy as np

from algorithms.arrays import Array, Generator
from algorithms.simulation.strip_flights import Flight, FlownStrip, Landscape, PlantedErrors, fly
from algorithms.strips.control import ControlPatch
from algorithms.strips.corrections import Degrees

DEGREES = Degrees(1, 1)
GON = np.pi / 200.0
HEIGHT_M, LENGTH_M, CORNER_M = 220.0, 240.0, 110.0
STDS = np.array([0.2] * 3 + [0.1] * 3 + [0.02 * GON] * 3 + [0.01 * GON] * 3)
"""Of what is planted, coefficient by coefficient; near what the observations of zero expect."""
LINES = Flight.block(3, LENGTH_M, cross=2, height_m=HEIGHT_M)
FLIGHT = Flight(LINES, height_m=HEIGHT_M, points_per_line=160, lines_per_s=50.0)
LAND = Landscape(seed=3, trees=0.15)


def planted_errors(seed: int) -> PlantedErrors:
    """Draw what is wrong with each strip and with the mount."""
    rng = np.random.default_rng(seed)
    coefficients = rng.normal(0.0, STDS, (len(LINES), len(STDS)))
    return PlantedErrors(DEGREES, coefficients, rng.normal(0.0, 0.1 * GON, 3))


def village(errors: PlantedErrors, land: Landscape = LAND, seed: int = 1) -> list[FlownStrip]:
    """Fly over the village."""
    return fly(FLIGHT, land, errors, seed)


def known_places(land: Landscape = LAND, *, std_m: float = 0.01, seed: int = 2) -> list[ControlPatch]:
    """Measure the largest roof faces, four points on each, and heights of open ground in each corner of the block."""
    rng = np.random.default_rng(seed)
    low, high = np.array([-20.0, -70.0]), np.array([LENGTH_M + 20.0, LINES[2].start_m[1] + 70.0])
    found = []
    for corner in (low, [high[0] - CORNER_M, low[1]], [low[0], high[1] - CORNER_M], high - CORNER_M):
        x, y = float(corner[0]), float(corner[1])
        faces = land.roof_faces((x, y), (x + CORNER_M, y + CORNER_M))
        patches = [_measured(f"roof {x:.0f} {y:.0f} {k}", face, std_m, rng) for k, face in enumerate(faces)]
        found += sorted(patches, key=lambda patch: -patch.radius_m(4.0))[:4]
        grounds = _open_ground(land, np.array([x, y]) + rng.uniform(0.0, CORNER_M, (60, 2)))[:3]
        found += [_measured(f"ground {x:.0f} {y:.0f} {k}", each[None], std_m, rng) for k, each in enumerate(grounds)]
    return found


def _open_ground(land: Landscape, places: Array) -> Array:
    """Keep places without a house within 8 m, and give their heights."""
    ring = 8.0 * np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0], [0.7, 0.7], [-0.7, -0.7]])
    around = (places[:, None, :] + ring).reshape(-1, 2)
    bare = (land.surface(*around.T) == land.terrain(*around.T)).reshape(len(places), -1).all(axis=1)
    return np.column_stack([places[bare], land.terrain(*places[bare].T)])


def _measured(name: str, points: Array, std_m: float, rng: Generator) -> ControlPatch:
    return ControlPatch(name, points + rng.normal(0.0, std_m, points.shape), np.full(points.shape, std_m))
