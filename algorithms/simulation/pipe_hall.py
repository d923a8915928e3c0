"""An industrial hall with pipes in three directions, seen from inside."""

import numpy as np

from algorithms.simulation.curved_parts import tube
from algorithms.simulation.materials import BRICK, CONCRETE, PAINT, STEEL, WOOD
from algorithms.simulation.parts import Part, box, polygons, slab
from algorithms.simulation.scene import Scene, scene_from_parts
from algorithms.simulation.stations import station_pose
from algorithms.simulation.walls import Opening, wall, wall_frame

HEIGHT_M = 6.5
OUTLINE_M = ((0.0, 0.0), (0.0, 11.0), (11.2, 11.0), (11.2, 7.8), (16.0, 7.8), (16.0, 0.0))
"""Clockwise, so that the seen side of each wall is the inner one: an oblong with a corner missing."""
OPENINGS = (
    (Opening(1.2, 4.4, 0.03, 4.2, glazed=False, frame_depth_m=0.25), Opening(6.0, 9.5, 3.6, 5.2)),
    (Opening(2.1, 3.1, 0.03, 2.1, glazed=False), Opening(5.0, 7.2, 3.8, 5.4)),
    (),
    (Opening(1.5, 3.2, 1.0, 2.6),),
    (Opening(4.9, 6.0, 0.03, 2.2, glazed=False),),
    (Opening(1.0, 4.0, 3.5, 5.5), Opening(6.5, 8.2, 3.5, 5.5), Opening(11.3, 14.5, 2.9, 5.5)),
)

PIPES: tuple[tuple[tuple[float, float, float], tuple[float, float, float], float], ...] = (
    # along x
    ((0.0, 0.42, 4.55), (16.0, 0.42, 4.55), 0.16),
    ((0.0, 0.85, 4.62), (16.0, 0.85, 4.62), 0.084),
    ((0.0, 1.18, 4.60), (12.4, 1.18, 4.60), 0.057),
    ((0.0, 10.55, 3.30), (11.2, 10.55, 3.30), 0.21),
    ((0.0, 6.60, 5.50), (16.0, 6.60, 5.50), 0.27),
    ((2.4, 10.75, 1.10), (9.8, 10.75, 1.10), 0.045),
    # along y
    ((3.35, 0.0, 5.15), (3.35, 11.0, 5.15), 0.11),
    ((9.60, 0.0, 5.05), (9.60, 11.0, 5.05), 0.162),
    ((10.1, 0.0, 5.10), (10.1, 11.0, 5.10), 0.070),
    ((15.62, 0.0, 2.75), (15.62, 7.8, 2.75), 0.13),
    ((13.2, 0.0, 5.95), (13.2, 7.8, 5.95), 0.109),
    # upright
    ((0.55, 9.9, 0.0), (0.55, 9.9, 6.5), 0.11),
    ((0.95, 9.95, 0.0), (0.95, 9.95, 6.5), 0.057),
    ((12.4, 1.18, 0.0), (12.4, 1.18, 6.5), 0.084),
    ((7.3, 10.55, 0.0), (7.3, 10.55, 3.3), 0.136),
    ((15.4, 5.3, 0.0), (15.4, 5.3, 6.5), 0.18),
    ((5.9, 0.42, 0.0), (5.9, 0.42, 4.55), 0.07),
    # oblique
    ((1.6, 2.2, 0.9), (1.6, 5.9, 3.4), 0.076),
    ((10.6, 2.0, 0.45), (13.6, 4.4, 0.45), 0.09),
)
"""Start, end [m] and radius [m]."""


def pipe_hall_scene() -> Scene:
    """Build the hall: walls, floor, ceiling, pipes of many radii, beams, columns, a tank, machines, a platform."""
    parts = [*_shell(), *(tube(start, end, radius, STEEL) for start, end, radius in PIPES), *_structure(), *_machines()]
    degree = np.pi / 180.0
    stations = (
        station_pose((5.2, 2.6, 1.65), 23.0 * degree, 0.7 * degree, -0.4 * degree),
        station_pose((8.6, 6.9, 1.58), 141.0 * degree, -1.1 * degree, 0.9 * degree),
        station_pose((13.4, 2.7, 1.72), 257.0 * degree, 0.3 * degree, 1.6 * degree),
        station_pose((2.6, 8.3, 1.60), 318.0 * degree, 24.0 * degree, 15.0 * degree),
    )
    return scene_from_parts("pipe_hall", parts, stations)


def _shell() -> list[Part]:
    parts: list[Part] = []
    for k, openings in enumerate(OPENINGS):
        start, end = OUTLINE_M[k], OUTLINE_M[(k + 1) % len(OUTLINE_M)]
        length = float(np.hypot(end[0] - start[0], end[1] - start[1]))
        parts += wall(wall_frame(start, end), np.array([[0.0, HEIGHT_M], [length, HEIGHT_M]]), openings, BRICK)
    pieces = [np.array([(0.0, 0.0), (11.2, 0.0), (11.2, 11.0), (0.0, 11.0)])]
    pieces += [np.array([(11.2, 0.0), (16.0, 0.0), (16.0, 7.8), (11.2, 7.8)])]
    for height in (0.0, HEIGHT_M):
        rings = [np.column_stack([piece, np.full(4, height)]) for piece in pieces]
        parts.append(polygons(rings, CONCRETE, with_edges=False))
    return parts


def _structure() -> list[Part]:
    return [
        box((2.3, 0.0, 6.1), (2.6, 11.0, 6.5), STEEL, omit=("front", "back")),
        box((6.55, 0.0, 6.1), (6.85, 11.0, 6.5), STEEL, omit=("front", "back")),
        box((11.7, 0.0, 6.15), (11.95, 7.8, 6.5), STEEL, omit=("front", "back")),
        box((0.0, 3.9, 6.25), (2.3, 4.05, 6.5), STEEL, omit=("left", "right")),
        box((6.85, 8.6, 6.2), (11.2, 8.8, 6.5), STEEL, omit=("left", "right")),
        box((6.5, 4.1, 0.0), (6.9, 4.5, 6.1), CONCRETE),
        box((11.65, 5.9, 0.0), (12.0, 6.25, 6.15), CONCRETE),
        box((2.25, 6.4, 0.0), (2.65, 6.75, 6.1), CONCRETE),
        box((0.0, 2.05, 4.25), (16.0, 2.35, 4.31), STEEL, omit=("left", "right")),
        box((4.4, 9.3, 2.6), (8.9, 11.0, 2.72), STEEL, omit=("back",)),
        box((4.45, 9.35, 0.0), (4.57, 9.47, 2.6), STEEL),
        box((8.7, 9.35, 0.0), (8.82, 9.47, 2.6), STEEL),
    ]


def _machines() -> list[Part]:
    degree = np.pi / 180.0
    ramp = np.array([(13.0, 6.4, 0.0), (15.0, 6.4, 0.0), (15.0, 7.8, 0.7), (13.0, 7.8, 0.7)])
    return [
        box((3.5, 4.9, 0.0), (5.4, 6.2, 1.45), PAINT, turn_rad=12.0 * degree),
        box((3.9, 5.1, 1.45), (4.6, 5.7, 2.1), STEEL, turn_rad=12.0 * degree),
        box((9.3, 3.1, 0.0), (10.3, 5.0, 1.9), PAINT),
        box((9.5, 3.3, 1.9), (9.9, 3.9, 2.35), STEEL),
        box((12.6, 3.9, 0.0), (14.3, 4.9, 0.9), PAINT, turn_rad=-31.0 * degree),
        box((0.1, 6.9, 0.0), (0.6, 8.9, 2.0), STEEL),
        box((7.3, 0.9, 0.0), (8.4, 1.7, 0.85), WOOD, turn_rad=5.0 * degree),
        box((10.2, 8.9, 0.0), (11.0, 10.2, 2.3), STEEL, turn_rad=-3.0 * degree),
        tube((9.0, 9.0, 0.35), (9.0, 9.0, 2.35), 0.62, PAINT),
        tube((14.2, 1.5, 0.0), (14.2, 1.5, 1.9), 0.45, STEEL),
        slab(ramp, np.array([0.0, 0.0, 0.05]), CONCRETE, omit=("back",)),
    ]
