"""Buildings as they are common: regular, nearly like themselves elsewhere, but for what stands in them.

Each builder draws its measures from a generator and gives the parts of a building and a function that draws a place
for an instrument in it.
"""

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise

import numpy as np

from algorithms.simulation.materials import CONCRETE, PAINT, STEEL, WOOD, Material
from algorithms.simulation.parts import Part, box, polygons
from algorithms.simulation.walls import Opening, wall, wall_frame

Place = tuple[float, ...]
"""x, y and, where it is not the ground, the height of the floor [m]."""
Building = tuple[list[Part], Callable[[], Place]]


def warehouse(rng: np.random.Generator) -> Building:
    """Give a hall with rows of equal racks, loaded by chance, and a gate at one end."""
    length, width, height = rng.uniform(28, 45), rng.uniform(20, 28), rng.uniform(6.5, 9)
    parts = hall(length, width, height, {1: [gate_at(0.5 * width - 2, 4.0, 4.0)]})
    first_x, bay, step = 4 - length / 2, 2.8, 4.2
    bays, rows = int((length - 8) // bay), int(width // step)
    for row in range(rows):
        y = row * step + 3.2 - width / 2
        for side in (y, y + 1.0):
            parts += [
                block((first_x + k * bay, side, 0), (first_x + k * bay + 0.1, side + 0.1, 5), STEEL)
                for k in range(bays + 1)
            ]
            parts += [
                block((first_x, side, z), (first_x + bays * bay, side + 0.08, z + 0.12), STEEL) for z in (0.2, 1.8, 3.4)
            ]
        for x, z in ((first_x + k * bay, z) for k in range(bays) for z in (0.32, 1.92, 3.52)):
            if rng.uniform() < 0.55:
                wide, high, left = rng.uniform(1.1, 2.2), rng.uniform(0.4, 1.2), rng.uniform(0.15, 0.4)
                parts.append(block((x + left, y + 0.1, z), (x + left + wide, y + 0.95, z + high), WOOD))

    def place() -> Place:
        aisle = (int(rng.integers(rows))) * step + 1.6 - width / 2
        return rng.uniform(2 - length / 2, length / 2 - 2), aisle + rng.uniform(-0.4, 0.4)

    return parts, place


def nave(rng: np.random.Generator) -> Building:
    """Give a church of equal bays with pews, an altar at one end and a door at the other."""
    length, width, height, bay = rng.uniform(30, 42), rng.uniform(15, 19), rng.uniform(9, 13), rng.uniform(4.5, 5.5)
    bays = int(length // bay)
    windows = [window_at((k + 0.5) * bay - 0.7, (k + 0.5) * bay + 0.7, 2.5, 6.5) for k in range(bays)]
    parts = hall(length, width, height, {0: windows, 2: windows, 3: [gate_at(width / 2 - 1.2, 2.4, 3.2)]})
    for x in (k * bay - length / 2 for k in range(1, bays)):
        parts += [
            block((x - 0.4, y - 0.4, 0), (x + 0.4, y + 0.4, height - 1), CONCRETE) for y in (-width / 4, width / 4)
        ]
        parts.append(block((x - 0.3, -width / 2, height - 1), (x + 0.3, width / 2, height), CONCRETE))
    for x in (4 + k * 1.1 - length / 2 for k in range(int(length // 2))):
        for y in (-3.2, 0.6):
            parts.append(block((x, y, 0), (x + 0.08, y + 2.6, 0.85), WOOD))
            parts.append(block((x + 0.08, y, 0.4), (x + 0.45, y + 2.6, 0.46), WOOD))
    parts.append(block((length / 2 - 5, -4, 0), (length / 2, 4, 0.5), CONCRETE))
    parts.append(block((length / 2 - 3, -1.2, 0.5), (length / 2 - 2, 1.2, 1.5), CONCRETE))

    def place() -> Place:
        aisle = float(rng.choice([0.0, 2 - width / 2, width / 2 - 2]))
        return rng.uniform(2 - length / 2, length / 2 - 6), aisle + rng.uniform(-0.3, 0.3)

    return parts, place


def courtyard(rng: np.random.Generator) -> Building:
    """Give a court between four facades of equal windows, one of which has a gate, with a few things in it."""
    length, width, height, step = rng.uniform(18, 30), rng.uniform(14, 24), rng.uniform(8, 13), rng.uniform(2.8, 3.6)
    openings = {}
    for side, run in enumerate((length, width, length, width)):
        columns = int(run // step)
        edges = [(run - columns * step) / 2 + k * step + 0.8 for k in range(columns)]
        openings[side] = [
            window_at(x, x + 1.2, f * 3.2 + 1, f * 3.2 + 2.6) for x in edges for f in range(int(height // 3.3))
        ]
    side = int(rng.integers(4))
    gate = gate_at(rng.uniform(2, (length, width)[side % 2] - 6), 3.0, 3.5)
    openings[side] = [
        each for each in openings[side] if each.right_m < gate.left_m or each.left_m > gate.right_m + 0.2
    ] + [gate]
    parts = walls_round(length, width, height, openings)
    parts.append(ground(length, width))
    for _ in range(int(rng.integers(1, 4))):
        x, y = rng.uniform(-length / 3, length / 3), rng.uniform(-width / 3, width / 3)
        size = rng.uniform([0.6, 0.6, 0.5], [2.5, 1.5, 1.6])
        parts.append(thing(x, y, size, rng.uniform(0, 1.5), CONCRETE))
    return parts, lambda: anywhere(rng, length - 3, width - 3)


def row_houses(rng: np.random.Generator) -> Building:
    """Give a street between two rows of equal houses, other ones on either side, with parked cars."""
    houses, bay, street, height = int(rng.integers(6, 10)), rng.uniform(5.5, 7), rng.uniform(10, 16), rng.uniform(7, 9)
    length, other = houses * bay, rng.uniform(5, 8)
    here = [
        opening
        for x in (k * bay for k in range(houses))
        for opening in (
            door_at(x + 0.6), window_at(x + 2.4, x + 4.2, 0.9, 2.3),
            window_at(x + 0.9, x + 2.1, 3.6, 5.1), window_at(x + 3.1, x + 4.3, 3.6, 5.1),
        )
    ]  # fmt: skip
    there = [
        window_at(k * other + 1, k * other + 2.4, z, z + 1.5) for k in range(int(length // other)) for z in (0.9, 3.8)
    ]
    parts = wall_between((-length / 2, street / 2), (length / 2, street / 2), height, here)
    parts += wall_between((length / 2, -street / 2), (-length / 2, -street / 2), height - 1, there)
    parts.append(ground(120.0, 120.0))
    for low, high in ((street / 2 - 1.6, street / 2), (-street / 2, 1.6 - street / 2)):
        parts.append(block((-length / 2, low, 0), (length / 2, high, 0.14), CONCRETE))
    for _ in range(int(rng.integers(2, 7))):
        x, y = rng.uniform(-length / 2, length / 2 - 5), float(rng.choice([street / 2 - 3.8, 2 - street / 2]))
        parts.append(block((x, y, 0.25), (x + 4.3, y + 1.8, 0.9), STEEL))
        parts.append(block((x + 0.9, y + 0.1, 0.9), (x + 3.5, y + 1.7, 1.45), STEEL))
    return parts, lambda: anywhere(rng, length - 6, street - 5)


def storeroom(rng: np.random.Generator) -> Building:
    """Give a rectangular room without windows, full of boxes."""
    length, width, height = rng.uniform(12, 25), rng.uniform(10, 18), rng.uniform(3.5, 6)
    parts = hall(length, width, height, {})
    taken = []
    for _ in range(int(rng.integers(8, 25))):
        (x, y), size = anywhere(rng, length - 4, width - 4), rng.uniform([0.3, 0.3, 0.3], [2.0, 1.5, 2.5])
        taken.append((x, y, 0.5 * float(np.hypot(size[0], size[1])) + 0.5))
        parts.append(thing(x, y, size, rng.uniform(0, 3), WOOD))

    def place() -> Place:
        while True:
            x, y = anywhere(rng, length - 2, width - 2)
            if all(np.hypot(x - u, y - v) > clear for u, v, clear in taken):
                return x, y

    return parts, place


def tunnel(rng: np.random.Generator) -> Building:
    """Give a tunnel with doors in equal distances on one side and a few cabinets."""
    length, width, height, step = rng.uniform(50, 80), rng.uniform(4, 6), rng.uniform(4, 5), rng.uniform(8, 12)
    doors = [door_at(k * step + 2) for k in range(int((length - 4) // step))]
    parts = wall_between((-length / 2, width / 2), (length / 2, width / 2), height, doors)
    parts += wall_between((length / 2, -width / 2), (-length / 2, -width / 2), height, [])
    parts += [ground(length, width), ground(length, width, height)]
    for _ in range(int(rng.integers(2, 8))):
        x, y = rng.uniform(-length / 2, length / 2 - 1), float(rng.choice([-1, 1])) * (width / 2 - 0.25)
        parts.append(block((x, y - 0.22, 0), (x + rng.uniform(0.4, 1.2), y + 0.22, rng.uniform(0.8, 2)), STEEL))
    return parts, lambda: anywhere(rng, 2 * length / 3, width / 2)


BUILDINGS: dict[str, Callable[[np.random.Generator], Building]] = {
    each.__name__: each for each in (warehouse, nave, courtyard, row_houses, storeroom, tunnel)
}


def anywhere(rng: np.random.Generator, length: float, width: float) -> tuple[float, float]:
    """Draw a place in a rectangle about the origin."""
    return rng.uniform(-length / 2, length / 2), rng.uniform(-width / 2, width / 2)


def thing(x: float, y: float, size: Sequence[float], turn_rad: float, material: Material) -> Part:
    """Give a box of a size (a, b, c) on the ground, turned about its middle."""
    a, b, c = size
    return block((x - a / 2, y - b / 2, 0), (x + a / 2, y + b / 2, c), material, turn_rad=turn_rad)


def block(low: Sequence[float], high: Sequence[float], material: Material, turn_rad: float = 0.0) -> Part:
    """Give a box between two corners."""
    (x, y, z), (u, v, w) = (map(float, corner) for corner in (low, high))
    return box((x, y, z), (u, v, w), material, turn_rad=float(turn_rad))


def window_at(left: float, right: float, sill: float, lintel: float) -> Opening:
    """Give a glazed opening."""
    return Opening(float(left), float(right), float(sill), float(lintel))


def gate_at(left: float, width: float, height: float) -> Opening:
    """Give a gate, its leaf shut."""
    return Opening(left, left + width, 0.0, height, glazed=False)


def door_at(left: float) -> Opening:
    """Give a door, its leaf shut."""
    return Opening(left, left + 1.0, 0.0, 2.1, glazed=False)


def wall_between(
    start: Place, end: Place, height: float, openings: Iterable[Opening], reveal_m: float = 0.3
) -> list[Part]:
    """Build a wall that is seen from the right of its direction."""
    rim = np.array([[0.0, height], [np.hypot(end[0] - start[0], end[1] - start[1]), height]])
    return wall(wall_frame(start, end), rim, list(openings), PAINT, low_m=0.0, reveal_m=reveal_m)


def walls_round(length: float, width: float, height: float, openings: dict[int, list[Opening]]) -> list[Part]:
    """Build four walls round the origin, seen from inside; the first is the one of largest y."""
    x, y = length / 2, width / 2
    corners = [(-x, y), (x, y), (x, -y), (-x, -y), (-x, y)]
    return [
        part
        for k, (start, end) in enumerate(pairwise(corners))
        for part in wall_between(start, end, height, openings.get(k, []))
    ]


def ground(length: float, width: float, height: float = 0.0) -> Part:
    """Give a floor or a ceiling."""
    x, y = length / 2 + 1, width / 2 + 1
    return polygons([np.array([(-x, -y, height), (x, -y, height), (x, y, height), (-x, y, height)])], CONCRETE)


def hall(length: float, width: float, height: float, openings: dict[int, list[Opening]]) -> list[Part]:
    """Build four walls, floor and ceiling."""
    return [
        *walls_round(length, width, height, openings), ground(length, width), ground(length, width, height),
    ]  # fmt: skip
