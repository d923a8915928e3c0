"""Rooms in a row, joined by doors, as many as there are stations for: one in each room and one in each door."""

import numpy as np

from algorithms.simulation.materials import CONCRETE, PAINT, WOOD
from algorithms.simulation.parts import Part, box, polygons
from algorithms.simulation.scene import Scene, scene_from_parts
from algorithms.simulation.stations import station_pose
from algorithms.simulation.walls import Opening, partition, wall, wall_frame

HEIGHT_M, THICKNESS_M = 2.8, 0.15
EYE_M = 1.6


def room_row_scene(stations: int, rng: np.random.Generator) -> Scene:
    """Build rooms of drawn lengths and depths, each with windows and four boxes of its own."""
    rooms = stations // 2 + 1
    ends = np.concatenate([[0.0], np.cumsum(rng.uniform(4.0, 7.5, rooms))])
    depths = rng.uniform(4.0, 6.5, rooms)
    doors = rng.uniform(1.0, 2.6, rooms)  # y of the middle of the door at the end of each room
    parts: list[Part] = _closed(0.0, float(depths[0])) + _closed(float(ends[-1]), float(depths[-1]), last=True)
    places: list[tuple[float, float]] = []
    for k in range(rooms):
        low, high, depth = float(ends[k]), float(ends[k + 1]), float(depths[k])
        middle = (0.5 * (low + high), 0.5 * depth)
        parts += [*_long_walls(low, high, depth, rng), *_boxes(low, high, depth, middle, rng)]
        places.append(middle)
        if k + 1 < rooms:
            door = float(doors[k])
            opening = Opening(door - 0.5, door + 0.5, 0.0, 2.1, frame_depth_m=None)
            far = max(depth, float(depths[k + 1]))
            parts += partition((high, 0.0), (high, far), HEIGHT_M, THICKNESS_M, [opening], PAINT)
            places.append((high, door))
    poses = tuple(
        station_pose((x, y, EYE_M), rng.uniform(0.0, 2.0 * np.pi), *rng.normal(0.0, 0.01, 2))
        for x, y in places[:stations]
    )
    return scene_from_parts("room_row", parts, poses)


def _closed(x: float, depth: float, *, last: bool = False) -> list[Part]:
    ends = ((x, depth), (x, 0.0)) if last else ((x, 0.0), (x, depth))
    return wall(wall_frame(*ends), np.array([[0.0, HEIGHT_M], [depth, HEIGHT_M]]), [], PAINT)


def _long_walls(low: float, high: float, depth: float, rng: np.random.Generator) -> list[Part]:
    length = high - low
    rim = np.array([[0.0, HEIGHT_M], [length, HEIGHT_M]])
    wide = float(rng.uniform(1.0, 2.2))
    left = float(rng.uniform(0.4, length - wide - 0.4))
    window = Opening(left, left + wide, float(rng.uniform(0.6, 1.0)), 2.2)
    return [
        *wall(wall_frame((high, 0.0), (low, 0.0)), rim, [window], PAINT),
        *wall(wall_frame((low, depth), (high, depth)), rim, [], PAINT),
        *(
            polygons([np.array([(low, 0, z), (high, 0, z), (high, depth, z), (low, depth, z)])], CONCRETE)
            for z in (0.0, HEIGHT_M)
        ),
    ]


def _boxes(low: float, high: float, depth: float, station: tuple[float, float], rng: np.random.Generator) -> list[Part]:
    """Put four boxes into a room, away from the station and the way to the doors."""
    parts: list[Part] = []
    while len(parts) < 4:
        x, y = float(rng.uniform(low + 1.2, high - 1.2)), float(rng.uniform(0.5, depth - 0.5))
        a, b, top = (float(v) for v in rng.uniform((0.2, 0.2, 0.4), (0.6, 0.5, 1.9)))
        if np.hypot(x - station[0], y - station[1]) > 0.6 + np.hypot(a, b):
            turn = float(rng.choice([0.0, rng.uniform(0.0, np.pi)]))
            parts.append(box((x - a, y - b, 0.0), (x + a, y + b, top), WOOD, turn_rad=turn))
    return parts
