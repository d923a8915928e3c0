"""Places that a turn or shift lays on themselves: crossings, towers, platforms, racks, cells, galleries, carriages."""

import numpy as np
from scipy.spatial.transform import Rotation

from algorithms.simulation.curved_parts import tube
from algorithms.simulation.materials import CONCRETE, STEEL, WOOD
from algorithms.simulation.walls import Opening
from tests.scenes.buildings.regular_buildings import (
    Building,
    Place,
    anywhere,
    block,
    door_at,
    gate_at,
    ground,
    hall,
    thing,
    wall_between,
    window_at,
)


def _quarter(k: int, x: float, y: float) -> tuple[float, float]:
    """Turn a place by k quarters of a circle."""
    turned = Rotation.from_euler("z", k * np.pi / 2).apply([x, y, 0.0])
    return float(turned[0]), float(turned[1])


def crossing(rng: np.random.Generator) -> Building:
    """Give two equal corridors that cross, with equal doors of which a few are missing, and a few lockers."""
    width, height, arm, step = rng.uniform(2.2, 4), rng.uniform(2.5, 3.2), rng.uniform(14, 25), rng.uniform(3.5, 5)
    half, parts = width / 2, [ground(2 * arm, 2 * arm), ground(2 * arm, 2 * arm, height)]
    for k in range(4):
        for side in (1, -1):
            lefts = [i * step + 1.2 for i in range(int((arm - 2) // step)) if rng.uniform() < 0.9]
            near, far = _quarter(k, half, side * half), _quarter(k, arm, side * half)
            if side < 0:
                lefts, near, far = [arm - half - left - 1 for left in lefts], far, near
            parts += wall_between(near, far, height, map(door_at, lefts))
        window = [window_at(half - 0.5, half + 0.5, 1, 2)] if rng.uniform() < 0.7 else []
        parts += wall_between(_quarter(k, arm, half), _quarter(k, arm, -half), height, window)
    for _ in range(int(rng.integers(1, 5))):
        x, y = _quarter(int(rng.integers(4)), rng.uniform(half, arm - 1), float(rng.choice([-1, 1])) * (half - 0.25))
        parts.append(thing(x, y, rng.uniform([0.4, 0.4, 0.5], [0.48, 0.48, 1.9]), 0, STEEL))

    def place() -> Place:
        return _quarter(int(rng.integers(4)), rng.uniform(0, 0.7 * arm), rng.uniform(-0.5, 0.5) * half)

    return parts, place


def round_tower(rng: np.random.Generator) -> Building:
    """Give a room of six, eight or twelve equal walls with equal windows, and a few things."""
    corners, radius, height = int(rng.choice([6, 8, 12])), rng.uniform(3, 7), rng.uniform(3, 6)
    angles = -2 * np.pi * np.arange(corners + 1) / corners
    places = [(radius * float(np.cos(u)), radius * float(np.sin(u))) for u in angles]
    wide, parts = 2 * radius * np.sin(np.pi / corners), [ground(2 * radius, 2 * radius)]
    parts.append(ground(2 * radius, 2 * radius, height))
    for k in range(corners):
        window = [] if k % max(1, corners // 6) else [window_at(wide / 3, 2 * wide / 3, 1, 2.2)]
        parts += wall_between(places[k], places[k + 1], height, window)

    def inside() -> tuple[float, float]:
        turn, far = rng.uniform(0, 2 * np.pi), rng.uniform(0, 0.7 * radius)
        return far * np.cos(turn), far * np.sin(turn)

    for _ in range(int(rng.integers(1, 5))):
        parts.append(thing(*inside(), rng.uniform([0.3, 0.3, 0.3], [1.2, 0.9, 1.9]), rng.uniform(0, 3), WOOD))
    return parts, inside


def metro_station(rng: np.random.Generator) -> Building:
    """Give a platform between two tracks with two rows of columns, the same from both ends but for benches."""
    length, width, height = rng.uniform(50, 80), rng.uniform(14, 18), rng.uniform(4, 5.5)
    step, half = rng.uniform(5, 7), rng.uniform(3, 4)
    parts = hall(length, width, height, {})
    parts.append(block((-length / 2, -half, 0), (length / 2, half, 1), CONCRETE))
    for x in (k * step - length / 2 + 4 for k in range(int((length - 6) // step))):
        parts += [block((x, y, 1), (x + 0.4, y + 0.4, height), CONCRETE) for y in (1.2 - half, half - 1.6)]
    parts += [block((x - 1.5, -1, 1), (x + 1.5, 1, 2.2), STEEL) for x in (6 - length / 2, length / 2 - 6)]
    for _ in range(int(rng.integers(1, 6))):
        x, y = anywhere(rng, length - 18, 2)
        a, b, c = rng.uniform([0.4, 0.4, 0.4], [2, 0.8, 1.6])
        parts.append(block((x, y, 1), (x + a, y + b, 1 + c), STEEL))
    return parts, lambda: (*anywhere(rng, length - 16, 2 * half - 1.2), 1.0)


def pipe_rack(rng: np.random.Generator) -> Building:
    """Give equal frames under open sky that carry pipes on two levels."""
    step, frames, half = rng.uniform(5, 7), int(rng.integers(6, 10)), rng.uniform(2, 3)
    length, levels = step * frames, (rng.uniform(2.8, 3.4), rng.uniform(4.4, 5))
    parts = [ground(length + 60, 60)]
    for x in (k * step - length / 2 for k in range(frames + 1)):
        parts += [block((x - 0.15, y - 0.15, 0), (x + 0.15, y + 0.15, levels[1] + 0.3), STEEL) for y in (-half, half)]
        parts += [block((x - 0.12, -half, z - 0.25), (x + 0.12, half, z), STEEL) for z in levels]
    for z in levels:
        for y in rng.uniform(0.4 - half, half - 0.4, int(rng.integers(2, 5))).tolist():
            radius = float(rng.uniform(0.06, 0.25))
            ends = (-length / 2 - 1, y, z + radius), (length / 2 + 1, y, z + radius)
            parts.append(tube(*ends, radius, STEEL))
    for _ in range(int(rng.integers(2, 7))):
        x, y = anywhere(rng, length, 2 * half)
        parts.append(tube((x, y, 0.0), (x, y, levels[0]), float(rng.uniform(0.05, 0.15)), STEEL))
    for _ in range(int(rng.integers(1, 4))):
        parts.append(thing(*anywhere(rng, length, 2 * half - 1), rng.uniform([0.5, 0.5, 0.4], [2, 1.2, 1.6]), 0, STEEL))
    return parts, lambda: anywhere(rng, length, 2 * half + 8)


def cell(rng: np.random.Generator) -> Building:
    """Give a closed room that is very nearly a cube, with a few boxes on floor and ceiling."""
    side = rng.uniform(2.6, 4.5)
    width, height = side + rng.normal(0, 0.02, 2)
    parts = hall(side, width, height, {})
    for _ in range(int(rng.integers(1, 5))):
        (x, y), (a, b, c) = anywhere(rng, side - 1, side - 1), rng.uniform([0.15, 0.15, 0.15], [0.6, 0.6, 0.9])
        z = float(rng.choice([0, 0, height - c]))
        parts.append(block((x, y, z), (x + a, y + b, z + c), WOOD))
    return parts, lambda: anywhere(rng, side - 1.4, side - 1.4)


def atrium(rng: np.random.Generator) -> Building:
    """Give a square court under a roof with two equal galleries round it and equal doors on every floor."""
    side, storey, deep, storeys = rng.uniform(14, 20), 3.2, rng.uniform(2, 3), 3
    half, inner = side / 2, side / 2 - deep
    openings = {}
    for k in range(4):
        below = [door_at((i + 0.5) * side / 4 - 0.5) for i in range(4) if rng.uniform() < 0.9]
        lefts = [(i + 0.5) * side / 4 - 0.5 for i in range(4)]
        sills = [floor * storey for floor in range(1, storeys)]
        above = [Opening(left, left + 1, sill, sill + 2.1, glazed=False) for sill in sills for left in lefts]
        openings[k] = below + above
    parts = hall(side, side, storeys * storey, openings)
    for z in (floor * storey for floor in range(1, storeys)):
        parts += [block((-half, y, z - 0.25), (half, y + deep, z), CONCRETE) for y in (inner, -half)]
        parts += [block((x, -inner, z - 0.25), (x + deep, inner, z), CONCRETE) for x in (inner, -half)]
        parts += [block((-inner, y, z), (inner, y + 0.06, z + 1), STEEL) for y in (inner, -inner - 0.06)]
        parts += [block((x, -inner, z), (x + 0.06, inner, z + 1), STEEL) for x in (inner, -inner - 0.06)]
    for x, y in ((x, y) for x in (-inner, inner) for y in (-inner, inner)):
        parts.append(block((x - 0.2, y - 0.2, 0), (x + 0.2, y + 0.2, storeys * storey), CONCRETE))
    for _ in range(int(rng.integers(1, 5))):
        size = rng.uniform([0.5, 0.5, 0.5], [2, 1.2, 1.4])
        parts.append(thing(*anywhere(rng, 2 * inner - 1, 2 * inner - 1), size, rng.uniform(0, 3), WOOD))

    def place() -> Place:
        floor = int(rng.integers(storeys))
        if floor == 0 and rng.uniform() < 0.5:
            return anywhere(rng, 2 * inner, 2 * inner)
        return (*_quarter(int(rng.integers(4)), rng.uniform(1 - half, half - 1), half - deep / 2), floor * storey)

    return parts, place


def carriage(rng: np.random.Generator) -> Building:
    """Give a railway carriage with equal windows and seats, open at both ends, and a few pieces of luggage."""
    length, width, step = rng.uniform(18, 24), rng.uniform(2.7, 3), rng.uniform(1.6, 1.9)
    rows, door = int((length - 4) // step), [gate_at(width / 2 - 0.4, 0.8, 2.0)]
    windows = [window_at(2 + k * step + 0.3, 2 + (k + 1) * step - 0.3, 0.8, 1.7) for k in range(rows)]
    parts = hall(length, width, 2.3, {0: windows, 2: windows, 1: door, 3: door})
    for x in (k * step - length / 2 + 2.2 for k in range(rows)):
        for y in (0.05 - width / 2, width / 2 - 1):
            parts.append(block((x, y, 0.35), (x + 0.45, y + 0.95, 0.45), STEEL))
            parts.append(block((x - 0.08, y, 0.35), (x, y + 0.95, 1.15), STEEL))
    for _ in range(int(rng.integers(1, 5))):
        x, y = rng.uniform(0.5 - length / 2, length / 2 - 0.5), float(rng.choice([-1, 1])) * width / 3
        parts.append(thing(x, y, rng.uniform([0.25, 0.25, 0.5], [0.5, 0.4, 1.2]), 0, WOOD))
    return parts, lambda: anywhere(rng, length - 2, 0.3)


def greenhouse(rng: np.random.Generator) -> Building:
    """Give equal frames without panes over long tables, with pots on them."""
    width, height, step = rng.uniform(8, 12), rng.uniform(2.6, 3.2), rng.uniform(2.5, 3.2)
    bays = int(rng.uniform(24, 36) // step)
    end, side = bays * step / 2, width / 2
    parts = [ground(2 * end + 20, width + 20)]
    for x in (k * step - end for k in range(bays + 1)):
        parts += [block((x - 0.05, y - 0.05, 0), (x + 0.05, y + 0.05, height), STEEL) for y in (-side, side)]
        parts.append(block((x - 0.05, -side, height), (x + 0.05, side, height + 0.12), STEEL))
    parts += [block((-end, y - 0.05, height), (end, y + 0.05, height + 0.1), STEEL) for y in (-side, 0, side)]
    rows = np.arange(0.6 - side, side - 1.5, 2.2).tolist()
    for y in rows:
        parts.append(block((1 - end, y, 0.7), (end - 1, y + 1.3, 0.8), WOOD))
        for x in rng.uniform(1.2 - end, end - 1.6, int(rng.integers(2, 9))).tolist():
            a, b, c = rng.uniform([0.2, 0.2, 0.2], [0.5, 0.8, 0.8])
            parts.append(block((x, y + 0.2, 0.8), (x + a, y + 0.2 + b, 0.8 + c), WOOD))
    return parts, lambda: (rng.uniform(1 - end, end - 1), rows[int(rng.integers(len(rows)))] - 0.45)


TURNED_BUILDINGS = {
    each.__name__: each
    for each in (
        crossing, round_tower, metro_station, pipe_rack, cell, atrium, carriage, greenhouse,
    )
}  # fmt: skip
