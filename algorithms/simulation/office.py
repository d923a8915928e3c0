"""The inside of an office flat: six rooms along a corridor, seen through open doors."""

from collections.abc import Sequence

import numpy as np

from algorithms.simulation.curved_parts import bush, tube
from algorithms.simulation.materials import FOLIAGE, PAINT, STEEL, TEXTILE, WOOD
from algorithms.simulation.parts import Part, box, moved, polygons
from algorithms.simulation.scene import Scene, scene_from_parts
from algorithms.simulation.stations import station_pose
from algorithms.simulation.walls import Opening, partition, wall, wall_frame

LENGTH_M, DEPTH_M, HEIGHT_M = 13.2, 8.6, 2.62
THICKNESS_M = 0.12
"""Of the walls between rooms."""
DOOR_M = 2.05


def office_scene() -> Scene:
    """Build the flat: outer walls with windows, partitions with door openings, furniture that differs in each room."""
    degree = np.pi / 180.0
    stations = (
        station_pose((10.9, 4.4, 1.55), 48.0 * degree, 0.5 * degree, -0.8 * degree),
        station_pose((8.3, 4.95, 1.61), 187.0 * degree, -0.9 * degree, 0.2 * degree),
        station_pose((5.8, 4.1, 1.57), 301.0 * degree, 1.3 * degree, 0.6 * degree),
        station_pose((2.2, 4.85, 1.64), 95.0 * degree, 0.1 * degree, 1.2 * degree),
        station_pose((1.5, 3.55, 1.52), 222.0 * degree, 22.0 * degree, -9.0 * degree),
        station_pose((2.9, 6.2, 1.66), 12.0 * degree, -0.4 * degree, -1.0 * degree),
        station_pose((6.75, 7.1, 1.58), 156.0 * degree, 0.7 * degree, 0.5 * degree),
        station_pose((8.3, 3.4, 1.6), 260.0 * degree, -0.6 * degree, 1.1 * degree),
        station_pose((2.5, 1.1, 1.63), 341.0 * degree, 1.0 * degree, -0.3 * degree),
    )
    return scene_from_parts("office", [*_outer_walls(), *_partitions(), *_furniture()], stations)


def _door(left_m: float, width_m: float) -> Opening:
    return Opening(left_m, left_m + width_m, 0.0, DOOR_M, frame_depth_m=None)


def _outer_walls() -> list[Part]:
    corners = ((0.0, 0.0), (0.0, DEPTH_M), (LENGTH_M, DEPTH_M), (LENGTH_M, 0.0))
    openings: tuple[Sequence[Opening], ...] = (
        (Opening(1.1, 2.7, 0.9, 2.2), Opening(4.55, 5.15, 1.2, 2.2), Opening(6.4, 7.9, 0.9, 2.2)),
        (Opening(1.4, 3.6, 0.9, 2.2), Opening(6.3, 7.1, 1.4, 2.2), Opening(10.2, 12.6, 0.4, 2.3)),
        (Opening(1.0, 1.9, 0.02, 2.1, glazed=False), Opening(3.4, 5.8, 0.9, 2.25)),
        (
            Opening(1.0, 3.5, 0.4, 2.3),
            Opening(5.2, 6.4, 0.9, 2.2),
            Opening(7.1, 8.3, 0.9, 2.2),
            Opening(10.0, 12.3, 0.9, 2.2),
        ),
    )
    parts: list[Part] = []
    for k, holes in enumerate(openings):
        start, end = corners[k], corners[(k + 1) % 4]
        length = float(np.hypot(end[0] - start[0], end[1] - start[1]))
        parts += wall(wall_frame(start, end), np.array([[0.0, HEIGHT_M], [length, HEIGHT_M]]), holes, PAINT)
    for height, material in ((0.0, WOOD), (HEIGHT_M, PAINT)):
        ring = np.array([(x, y, height) for x, y in corners])
        parts.append(polygons([ring], material, with_edges=False))
    return parts


def _partitions() -> list[Part]:
    half = 0.5 * THICKNESS_M
    south, north, east = 4.2, 5.6, 9.4
    lines = (
        ((0.0, south), (east - half, south), (_door(1.0, 0.9), _door(5.0, 1.7))),
        ((0.0, north), (east - half, north), (_door(2.4, 0.9), _door(7.2, 1.0))),
        ((4.1, 0.0), (4.1, south - half), ()),
        ((east, 0.0), (east, DEPTH_M), (_door(4.45, 0.95),)),
        ((5.2, north + half), (5.2, DEPTH_M), (_door(1.0, 0.8),)),
    )
    return [part for start, end, doors in lines for part in partition(start, end, HEIGHT_M, THICKNESS_M, doors, PAINT)]


def _desk(x: float, y: float, heading_rad: float, length: float, depth: float) -> list[Part]:
    """Build a table with two side panels and a screen, its corner at (x, y)."""
    parts = [
        box((0.0, 0.0, 0.70), (length, depth, 0.73), WOOD),
        box((0.04, 0.05, 0.0), (0.08, depth - 0.05, 0.70), STEEL),
        box((length - 0.08, 0.05, 0.0), (length - 0.04, depth - 0.05, 0.70), STEEL),
        box((0.5 * length - 0.3, depth - 0.22, 0.85), (0.5 * length + 0.25, depth - 0.19, 1.2), STEEL),
    ]
    return moved(parts, station_pose((x, y, 0.0), heading_rad))


def _shelf(x: float, y: float, heading_rad: float, length: float, height: float, boards: int) -> list[Part]:
    """Build an open shelf, 0.35 m deep, its corner at (x, y)."""
    depth = 0.35
    parts = [
        box((0.0, 0.0, 0.0), (0.03, depth, height), WOOD),
        box((length - 0.03, 0.0, 0.0), (length, depth, height), WOOD),
    ]
    parts += [
        box((0.03, 0.0, z), (length - 0.03, depth, z + 0.025), WOOD, omit=("left", "right"))
        for z in np.linspace(0.05, height - 0.03, boards).tolist()
    ]
    return moved(parts, station_pose((x, y, 0.0), heading_rad))


def _furniture() -> list[Part]:
    rng = np.random.default_rng(977)
    degree = np.pi / 180.0
    return [
        # south-west room
        *_desk(0.3, 0.5, 0.0, 1.6, 0.8),
        box((3.45, 0.2, 0.0), (4.04, 2.1, 2.1), WOOD),
        box((1.2, 1.6, 0.0), (1.7, 2.1, 0.9), TEXTILE, turn_rad=33.0 * degree),
        # south-middle room
        *_desk(4.6, 0.4, 4.0 * degree, 1.8, 0.9),
        *_desk(8.9, 1.2, 90.0 * degree, 1.4, 0.7),
        *_shelf(4.17, 3.6, -90.0 * degree, 1.5, 2.0, 5),
        # corridor
        box((3.0, 4.27, 0.0), (4.3, 4.65, 1.15), WOOD),
        tube((0.35, 5.3, 0.0), (0.35, 5.3, 1.8), 0.03, STEEL),
        # east room
        box((11.0, 0.5, 0.0), (13.0, 1.4, 0.42), TEXTILE),
        box((11.0, 0.25, 0.0), (13.0, 0.5, 0.85), TEXTILE),
        *_desk(10.3, 6.4, 21.0 * degree, 2.2, 1.0),
        box((9.47, 0.6, 0.0), (9.95, 2.9, 1.9), WOOD),
        tube((12.7, 8.1, 0.0), (12.7, 8.1, 2.62), 0.09, PAINT),
        bush((12.6, 5.9, 1.1), (0.4, 0.4, 0.5), FOLIAGE, rng),
        tube((12.6, 5.9, 0.0), (12.6, 5.9, 0.7), 0.17, PAINT),
        # north-west room
        *_shelf(0.1, 8.4, -90.0 * degree, 1.9, 2.3, 6),
        *_desk(2.9, 7.5, -12.0 * degree, 1.5, 0.75),
        # north-middle room: a kitchen
        box((5.27, 8.0, 0.0), (8.2, 8.6, 0.9), WOOD),
        box((5.27, 8.25, 1.5), (7.1, 8.6, 2.2), PAINT),
        box((8.7, 7.95, 0.0), (9.3, 8.55, 1.85), STEEL),
        # radiators below windows
        box((1.5, 8.42, 0.15), (3.4, 8.52, 0.75), STEEL),
        box((10.7, 8.44, 0.05), (12.2, 8.54, 0.33), STEEL),
        box((0.08, 1.3, 0.15), (0.17, 2.5, 0.72), STEEL),
    ]
