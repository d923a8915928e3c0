"""Floors of rooms that show each other no more than a doorway lets through: flats, and offices at a corridor.

Rooms of a row have two walls in line, a corridor looks the same from both ends, and every room has four corners that
can be laid on each other: what stands behind the next door could as well stand behind the one across.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from algorithms.simulation.materials import WOOD
from algorithms.simulation.parts import Part
from algorithms.simulation.walls import Opening
from tests.scenes.buildings.regular_buildings import Building, Place, block, ground, wall_between

HALF_WALL, DOOR, LINTEL = 0.06, 0.9, 2.05


class Room(NamedTuple):
    """A rectangle between the middles of walls."""

    west: float
    east: float
    south: float
    north: float

    @property
    def size(self) -> tuple[float, float]:
        """Width and depth."""
        return self.east - self.west, self.north - self.south

    @property
    def corners(self) -> list[Place]:
        """The walls' faces, from the north-west on: every wall is seen from the right of its direction."""
        west, south = self.west + HALF_WALL, self.south + HALF_WALL
        east, north = self.east - HALF_WALL, self.north - HALF_WALL
        return [(west, north), (east, north), (east, south), (west, south), (west, north)]


def _walls(rng: np.random.Generator, room: Room, doors: list[Place], hull: Room, height: float) -> list[Part]:
    """Build the faces of a room's four walls: doors where there are some, windows in most of the outer ones."""
    parts = []
    for start, end in pairwise(room.corners):
        long = float(np.hypot(end[0] - start[0], end[1] - start[1]))
        along = (np.array(end) - start) / long
        inwards = np.array([along[1], -along[0]])
        places = [((np.array(door) - start) @ along, (np.array(door) - start) @ inwards) for door in doors]
        lefts = [float(u) - DOOR / 2 for u, v in places if abs(v) < 2 * HALF_WALL and DOOR / 2 < u < long - DOOR / 2]
        openings, reveal = (
            [Opening(left, left + DOOR, 0.0, LINTEL, frame_depth_m=None) for left in lefts],
            2 * HALF_WALL,
        )
        middle = (np.array(start) + end) / 2
        gap = min(middle[0] - hull.west, hull.east - middle[0], middle[1] - hull.south, hull.north - middle[1])
        if gap < 2 * HALF_WALL and long > 1.2 and rng.uniform() < 0.8:
            wide = rng.uniform(0.4, 0.6) * min(long, 3.0)
            left, reveal = rng.uniform(0.2, long - wide - 0.2), 0.3
            openings = [Opening(float(left), float(left + wide), rng.uniform(0.7, 1), rng.uniform(2, 2.3))]
        parts += wall_between(start, end, height, openings, reveal_m=reveal)
    return parts


def _furniture(rng: np.random.Generator, room: Room, count: int) -> list[Part]:
    """Put boxes along the walls of a room."""
    parts, (west, north), (east, south) = [], room.corners[0], room.corners[2]
    for _ in range(count):
        a, b, c = rng.uniform([0.4, 0.3, 0.4], [1.8, 0.9, 2.0])
        wide, deep = (a, b) if rng.uniform() < 0.5 else (b, a)
        wide, deep = min(wide, 0.8 * (east - west)), min(deep, 0.3 * (north - south))
        x, y = rng.uniform(west + 0.03, east - wide - 0.03), rng.uniform(south + 0.03, north - deep - 0.03)
        if wide > deep:
            y = float(rng.choice([south + 0.03, north - deep - 0.03]))
        else:
            x = float(rng.choice([west + 0.03, east - wide - 0.03]))
        parts.append(block((x, y, 0), (x + wide, y + deep, c), WOOD))
    return parts


def _floor(rng: np.random.Generator, rooms: list[Room], doors: list[Place], pieces: tuple[int, int]) -> Building:
    """Build rooms with their doors; set-ups stand in the middle half of a room (rather a large one) or in a doorway."""
    west, east, south, north = zip(*rooms, strict=True)
    hull, height = Room(min(west), max(east), min(south), max(north)), rng.uniform(2.4, 2.8)
    size = 3 * (hull.east - hull.west + hull.north - hull.south)
    parts = [ground(size, size), ground(size, size, height)]
    for room in rooms:
        parts += _walls(rng, room, doors, hull, height)
        parts += _furniture(rng, room, int(rng.integers(*pieces)))

    areas = np.array([np.prod(room.size) for room in rooms])

    def place() -> Place:
        if doors and rng.uniform() < 0.3:
            middle, spread = np.array(doors[int(rng.integers(len(doors)))]), 0.2
        else:
            room = rooms[int(rng.choice(len(rooms), p=areas / areas.sum()))]
            middle = np.array([room.west + room.east, room.south + room.north]) / 2
            spread = 0.25 * np.array(room.size)
        x, y = middle + rng.uniform(-1, 1, 2) * spread
        return float(x), float(y)

    return parts, place


def flat(rng: np.random.Generator) -> Building:
    """Give four or six rooms of different sizes with doors between most of them, windows and furniture."""
    xs = np.cumsum([0.0, *rng.uniform(2.8, 5.5, int(rng.integers(2, 4)))]).tolist()
    ys = np.cumsum([0.0, *rng.uniform(2.8, 5.0, 2)]).tolist()
    rooms = [Room(*columns, *rows) for columns in pairwise(xs) for rows in pairwise(ys)]
    doors = [
        (x, low + rng.uniform(0.7, 1.9)) for x in xs[1:-1] for low, _ in pairwise(ys) if rng.uniform() < 0.75
    ] + [(low + rng.uniform(0.7, 1.9), ys[1]) for low, _ in pairwise(xs) if rng.uniform() < 0.75]  # fmt: skip
    return _floor(rng, rooms, doors, (2, 6))


def office_floor(rng: np.random.Generator) -> Building:
    """Give a corridor with rooms on both sides, in half of the floors of one width, with doors at one place in them."""
    length, half = rng.uniform(10, 24), rng.uniform(0.65, 1.3)
    module = rng.uniform(2.6, 4.5) if rng.uniform() < 0.5 else None
    door_left = rng.uniform(0.7, 1.7) if rng.uniform() < 0.5 else None
    corridor = Room(0.0, 0.0, -half, half)
    rooms, doors = [], []
    for side in (1, -1):
        depth, x = rng.uniform(3.2, 5.5), 0.0
        while x < length:
            east = x + (rng.uniform(2.6, 6.0) if module is None else module)
            south, north = sorted((side * half, side * (half + depth)))
            rooms.append(Room(x, east, south, north))
            if rng.uniform() < 0.9:
                doors.append((x + (rng.uniform(0.7, 1.9) if door_left is None else door_left), side * half))
            if x > 0.0 and rng.uniform() < 0.25:
                doors.append((x, side * (half + rng.uniform(0.8, depth - 0.8))))
            x = east
        corridor = corridor._replace(east=max(corridor.east, x))
    return _floor(rng, [*rooms, corridor], doors, (1, 6))


FLOOR_PLANS = {each.__name__: each for each in (flat, office_floor)}
