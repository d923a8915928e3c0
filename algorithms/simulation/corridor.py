"""A long corridor of an office building: doors, niches, a crossing with another corridor."""

import numpy as np

from algorithms.simulation.curved_parts import tube
from algorithms.simulation.materials import CONCRETE, PAINT, STEEL, TEXTILE, WOOD
from algorithms.simulation.parts import Part, box, polygons
from algorithms.simulation.scene import Scene, scene_from_parts
from algorithms.simulation.stations import station_pose
from algorithms.simulation.walls import Opening, wall, wall_frame

LENGTH_M, WIDTH_M, HEIGHT_M = 46.0, 2.3, 2.7
ARM_M = 9.0
"""Length of the crossing corridor on either side."""
CROSSING_M = (27.4, 29.6)
"""Where along the corridor the other one crosses."""
REVEAL_M = 0.2
"""Depth of windows and doors."""
NICHE_M = 0.9
"""Depth of the niches."""
SOUTH_NICHE_M, NORTH_NICHE_M = (8.6, 10.9), (37.2, 38.7)
"""Where along the corridor they are."""


def corridor_scene() -> Scene:
    """Build the corridor along x: shut doors at unequal distances, two niches, cabinets, and a glazed end."""
    degree = np.pi / 180.0
    stations = (
        station_pose((3.1, 1.2, 1.56), 17.0 * degree, 0.4 * degree, -0.7 * degree),
        station_pose((9.8, 0.9, 1.63), 141.0 * degree, -0.8 * degree, 0.3 * degree),
        station_pose((17.2, 1.3, 1.59), 266.0 * degree, 1.1 * degree, 0.5 * degree),
        station_pose((23.9, 1.0, 1.61), 35.0 * degree, 0.2 * degree, 1.0 * degree),
        station_pose((28.5, 1.2, 1.54), 199.0 * degree, -0.5 * degree, -0.9 * degree),
        station_pose((28.4, 6.4, 1.66), 312.0 * degree, 0.9 * degree, 0.6 * degree),
        station_pose((34.6, 1.1, 1.58), 88.0 * degree, -1.2 * degree, 0.1 * degree),
        station_pose((41.8, 1.3, 1.62), 230.0 * degree, 0.6 * degree, -0.4 * degree),
    )
    return scene_from_parts("corridor", [*_walls(), *_floors_and_ceilings(), *_things()], stations)


def _door(left_m: float, width_m: float = 0.9) -> Opening:
    return Opening(left_m, left_m + width_m, 0.0, 2.05, glazed=False)


def _walls() -> list[Part]:
    """Build the walls round corridor, niches and arms, seen from the inside."""
    (west, east), top = CROSSING_M, WIDTH_M + ARM_M
    (south_west, south_east), (north_west, north_east) = SOUTH_NICHE_M, NORTH_NICHE_M
    back, front = -NICHE_M, WIDTH_M + NICHE_M
    runs: list[tuple[tuple[float, float], tuple[float, float], tuple[Opening, ...]]] = [
        ((0.0, 0.0), (0.0, WIDTH_M), (Opening(0.4, 1.9, 0.3, 2.4),)),
        ((0.0, WIDTH_M), (west, WIDTH_M), (_door(1.6), _door(5.9), _door(13.2), _door(16.1, 1.6), _door(22.7))),
        ((west, WIDTH_M), (west, top), (_door(2.1), _door(6.3))),
        ((west, top), (east, top), (_door(0.5, 1.2),)),
        ((east, top), (east, WIDTH_M), (_door(1.2),)),
        ((east, WIDTH_M), (north_west, WIDTH_M), (_door(1.4), _door(4.9))),
        ((north_west, WIDTH_M), (north_west, front), ()),
        ((north_west, front), (north_east, front), (Opening(0.3, 1.2, 0.9, 2.2),)),
        ((north_east, front), (north_east, WIDTH_M), ()),
        ((north_east, WIDTH_M), (LENGTH_M, WIDTH_M), (_door(2.0), _door(4.6))),
        ((LENGTH_M, WIDTH_M), (LENGTH_M, 0.0), (_door(0.35, 1.6),)),
        ((LENGTH_M, 0.0), (east, 0.0), (_door(1.7), _door(6.0), _door(9.1, 1.4), _door(13.4))),
        ((east, 0.0), (east, -ARM_M), (_door(3.3), _door(6.9))),
        ((east, -ARM_M), (west, -ARM_M), (Opening(0.5, 1.7, 0.8, 2.3),)),
        ((west, -ARM_M), (west, 0.0), (_door(4.4),)),
        ((west, 0.0), (south_east, 0.0), (_door(2.2), _door(7.3), _door(11.9, 1.1))),
        ((south_east, 0.0), (south_east, back), ()),
        ((south_east, back), (south_west, back), ()),
        ((south_west, back), (south_west, 0.0), ()),
        ((south_west, 0.0), (0.0, 0.0), (_door(2.7), _door(6.2))),
    ]
    parts: list[Part] = []
    for start, end, openings in runs:
        length = float(np.hypot(end[0] - start[0], end[1] - start[1]))
        rim = np.array([[0.0, HEIGHT_M], [length, HEIGHT_M]])
        parts += wall(wall_frame(start, end), rim, openings, PAINT, reveal_m=REVEAL_M)
    return parts


def _floors_and_ceilings() -> list[Part]:
    """Cover corridor, niches and arms, to the depth of the doors; rectangles of one height lie in one plane."""
    west, east = CROSSING_M
    r = REVEAL_M
    rectangles = (
        (0.0, 0.0, LENGTH_M, WIDTH_M),
        (west, WIDTH_M, east, WIDTH_M + ARM_M),
        (west, -ARM_M, east, 0.0),
        (SOUTH_NICHE_M[0], -NICHE_M, SOUTH_NICHE_M[1], 0.0),
        (NORTH_NICHE_M[0], WIDTH_M, NORTH_NICHE_M[1], WIDTH_M + NICHE_M),
    )
    return [
        polygons(
            [
                np.array([(a - r, b - r, z), (c + r, b - r, z), (c + r, d + r, z), (a - r, d + r, z)])
                for a, b, c, d in rectangles
            ],
            material,
            with_edges=False,
        )
        for z, material in ((0.0, CONCRETE), (HEIGHT_M, PAINT))
    ]


def _things() -> list[Part]:
    """Put what stands in corridors along the walls, and a beam and a pipe below the ceiling."""
    degree = np.pi / 180.0
    return [
        box((4.1, 0.0, 0.0), (5.3, 0.42, 1.95), STEEL),
        box((11.6, WIDTH_M - 0.38, 0.0), (13.0, WIDTH_M, 1.1), WOOD),
        box((8.8, -0.85, 0.0), (10.2, -0.35, 0.46), TEXTILE),
        box((20.6, 0.0, 0.0), (21.5, 0.45, 1.8), STEEL),
        box((19.0, WIDTH_M - 0.35, 0.0), (19.6, WIDTH_M - 0.02, 1.25), PAINT, turn_rad=4.0 * degree),
        box((32.3, WIDTH_M - 0.42, 0.0), (33.6, WIDTH_M, 1.95), STEEL),
        box((37.5, WIDTH_M + 0.35, 0.0), (38.4, WIDTH_M + 0.8, 0.8), WOOD),
        box((40.2, 0.25, 0.0), (40.9, 0.7, 1.0), WOOD, turn_rad=24.0 * degree),
        box((27.5, 8.6, 0.0), (27.9, 10.3, 2.0), WOOD),
        box((28.9, -7.4, 0.0), (29.55, -6.1, 0.75), TEXTILE),
        box((15.0, 0.0, HEIGHT_M - 0.3), (15.35, WIDTH_M, HEIGHT_M), PAINT, omit=("top",)),
        box((35.4, 0.0, HEIGHT_M - 0.3), (35.75, WIDTH_M, HEIGHT_M), PAINT, omit=("top",)),
        tube((0.0, 0.28, 2.45), (15.0, 0.28, 2.45), 0.06, STEEL),
        tube((45.6, 1.95, 0.0), (45.6, 1.95, HEIGHT_M), 0.05, STEEL),
    ]
