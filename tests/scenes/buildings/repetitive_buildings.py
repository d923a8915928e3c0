"""More buildings that repeat themselves: pilasters, panels, desks, parked cars, flights of stairs, an arcade.

What tells their sides apart stands a decimetre from walls, or is one thing among many that are alike.
"""

import numpy as np

from algorithms.simulation.curved_parts import tube
from algorithms.simulation.materials import CONCRETE, PAINT, STEEL, WOOD
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
    walls_round,
    window_at,
)


def chapel(rng: np.random.Generator) -> Building:
    """Give a square room with the same windows on all four sides, and flat pilasters of which a few are missing."""
    side, height, depth = rng.uniform(9, 14), rng.uniform(5, 8), rng.uniform(0.1, 0.25)
    windows = [window_at(side / 2 - 1.5, side / 2 - 0.3, 2, 4), window_at(side / 2 + 0.3, side / 2 + 1.5, 2, 4)]
    parts = hall(side, side, height, dict.fromkeys(range(4), windows))
    for along in (-side / 4, 0.0, side / 4):
        for x, y, wide, deep in (
            (along, side / 2 - depth, 0.5, depth),
            (side / 2 - depth, along, depth, 0.5),
            (along, -side / 2, 0.5, depth),
            (-side / 2, along, depth, 0.5),
        ):
            if rng.uniform() < 0.85:
                parts.append(block((x, y, 0), (x + wide, y + deep, height - 0.5), CONCRETE))
    for _ in range(int(rng.integers(0, 3))):
        size = rng.uniform([0.3, 0.3, 0.3], [1.2, 0.8, 1.2])
        parts.append(thing(*anywhere(rng, side - 3, side - 3), size, rng.uniform(0, 3), WOOD))
    return parts, lambda: anywhere(rng, side - 2, side - 2)


def panelled_room(rng: np.random.Generator) -> Building:
    """Give a room of which boards in equal steps cover the walls, some of them missing."""
    length, width, height = rng.uniform(12, 22), rng.uniform(5, 9), rng.uniform(2.6, 4)
    parts, step, depth = hall(length, width, height, {}), rng.uniform(1.2, 2), rng.uniform(0.09, 0.2)
    for end in (1, -1):
        for k in (k for k in range(int(length // step)) if rng.uniform() < 0.8):
            x, y = k * step - length / 2 + 0.1, (width / 2 - depth if end > 0 else -width / 2)
            parts.append(block((x, y, 0.1), (x + step * 0.6, y + depth, height - 0.4), WOOD))
        for k in (k for k in range(int(width // step)) if rng.uniform() < 0.8):
            x, y = (length / 2 - depth if end > 0 else -length / 2), k * step - width / 2 + 0.1
            parts.append(block((x, y, 0.1), (x + depth, y + step * 0.6, height - 0.4), WOOD))
    return parts, lambda: anywhere(rng, length - 2, width - 2)


def open_office(rng: np.random.Generator) -> Building:
    """Give a floor of equal pairs of desks with a screen between them, between two rows of windows."""
    length, width, height, step = rng.uniform(20, 35), rng.uniform(12, 18), rng.uniform(2.8, 3.3), rng.uniform(2.6, 3.2)
    windows = [window_at(k * step + 0.4, k * step + step - 0.4, 0.8, 2.4) for k in range(int(length // step))]
    parts = hall(length, width, height, {0: windows, 2: windows, 1: [gate_at(width / 2 - 0.5, 1.0, 2.1)]})
    rows = int((width - 3) // 3.6)
    for x, y in ((i * 3.2 - length / 2 + 2, j * 3.6 - width / 2 + 1.8) for i in range(int((length - 4) // 3.2))
                 for j in range(rows) if rng.uniform() < 0.85):  # fmt: skip
        parts.append(block((x, y, 0.7), (x + 1.6, y + 0.8, 0.74), WOOD))
        parts.append(block((x, y + 0.8, 0), (x + 1.6, y + 0.84, 1.2), PAINT))
        parts.append(block((x, y + 0.86, 0.7), (x + 1.6, y + 1.64, 0.74), WOOD))
        if rng.uniform() < 0.5:
            parts.append(thing(x + rng.uniform(0, 1.6), y - 0.4, (0.5, 0.5, 0.9), rng.uniform(0, 3), STEEL))

    def place() -> Place:
        aisle = int(rng.integers(rows)) * 3.6 - width / 2 + 0.9
        return rng.uniform(1 - length / 2, length / 2 - 1), aisle + rng.uniform(-0.3, 0.3)

    return parts, place


def parking_deck(rng: np.random.Generator) -> Building:
    """Give a deck of equal bays between columns with cars parked by chance, and one way in."""
    bay_x, bay_y, height = rng.uniform(7, 8.5), rng.uniform(7, 8.5), rng.uniform(2.4, 2.9)
    nx, ny = int(rng.integers(4, 7)), int(rng.integers(3, 5))
    length, width = nx * bay_x, ny * bay_y
    parts = hall(length, width, height, {0: [gate_at(length / 2 - 3, 6, 2.2)]})
    for x in (i * bay_x - length / 2 for i in range(1, nx)):
        for y in (j * bay_y - width / 2 for j in range(1, ny)):
            parts.append(block((x - 0.2, y - 0.2, 0), (x + 0.2, y + 0.2, height), CONCRETE))
        parts.append(block((x - 0.15, -width / 2, height - 0.4), (x + 0.15, width / 2, height), CONCRETE))
    for _ in range(int(rng.integers(5, 25))):
        x = rng.integers(nx * 3) * bay_x / 3 - length / 2 + 0.3
        y = rng.integers(ny) * bay_y - width / 2 + rng.uniform(0.8, 1.4)
        parts.append(block((x, y, 0.25), (x + 1.8, y + 4.3, 0.9), STEEL))
        parts.append(block((x + 0.1, y + 0.9, 0.9), (x + 1.7, y + 3.5, 1.45), STEEL))

    def place() -> Place:
        return rng.uniform(2 - length / 2, length / 2 - 2), int(rng.integers(ny)) * bay_y - width / 2 + 6.3

    return parts, place


def stairwell(rng: np.random.Generator) -> Building:
    """Give four storeys of the same flights of stairs with a few boxes; stations stand on the landings."""
    length, width, storey, storeys, steps = rng.uniform(5, 6.5), rng.uniform(2.6, 3.2), rng.uniform(2.8, 3.3), 4, 9
    windows = [window_at(width / 2 - 0.5, width / 2 + 0.5, k * storey + 1, k * storey + 2.2) for k in range(storeys)]
    parts = [*walls_round(length, width, storeys * storey, {1: windows}), ground(length, width)]
    going, rise, landing = (length - 2.4) / steps, storey / 2 / steps, length / 2 - 1.2
    for z in (k * storey for k in range(storeys - 1)):
        for k in range(steps):
            up, down = k * going - landing, landing - (k + 1) * going
            parts.append(block((up, 0.1, z), (up + going, width / 2, z + (k + 1) * rise), CONCRETE))
            high = z + storey / 2 + k * rise
            parts.append(block((down, -width / 2, high - 0.15), (down + going, -0.1, high + rise), CONCRETE))
        half = z + storey / 2
        parts.append(block((landing, -width / 2, half - 0.2), (length / 2, width / 2, half), CONCRETE))
        parts.append(block((-length / 2, -width / 2, z + storey - 0.2), (-landing, width / 2, z + storey), CONCRETE))
    for _ in range(int(rng.integers(0, 4))):
        z, (a, b, c) = rng.integers(storeys) * storey, rng.uniform([0.2, 0.2, 0.3], [0.4, 0.5, 1.0])
        corner = (0.1 - length / 2, 0.1 - width / 2)
        parts.append(block((*corner, z), (corner[0] + a, corner[1] + b, z + c), WOOD))

    def place() -> Place:
        x, y = rng.uniform(0.5, 0.9) - length / 2, rng.uniform(-width / 4, width / 4)
        return x, y, float(rng.integers(storeys - 1) * storey)

    return parts, place


def cloister(rng: np.random.Generator) -> Building:
    """Give an arcade of round columns on four sides of a court, with doors on some sides and a few things in it."""
    step, walk, height = rng.uniform(3, 3.8), rng.uniform(2.8, 3.6), rng.uniform(3.2, 4.2)
    court = int(rng.integers(4, 7)) * step
    side, half = court + 2 * walk, court / 2
    doors = {k: [door_at(side / 2 - 0.5)] if rng.uniform() < 0.5 else [] for k in range(4)}
    parts = [*walls_round(side, side, height, doors), ground(side, side)]
    for along in np.arange(-half, half - 0.1, step):
        for x, y in ((along, half), (half, -along), (-along, -half), (-half, along)):
            parts.append(tube((float(x), float(y), 0.5), (float(x), float(y), height - 0.4), 0.18, CONCRETE))
    for low, high in ((0.0, 0.5), (height - 0.4, height)):
        parts += [block((-half, y, low), (half, y + 0.4, high), CONCRETE) for y in (half - 0.2, -half - 0.2)]
        parts += [block((x, -half, low), (x + 0.4, half, high), CONCRETE) for x in (half - 0.2, -half - 0.2)]
    for _ in range(int(rng.integers(1, 4))):
        size = rng.uniform([0.5, 0.5, 0.5], [1.5, 1.5, 1.4])
        parts.append(thing(*anywhere(rng, court - 2, court - 2), size, rng.uniform(0, 1.5), CONCRETE))

    def place() -> Place:
        along, off = rng.uniform(-half, half), half + walk / 2
        return ((along, off), (off, along), (along, -off), (-off, along))[int(rng.integers(4))]

    return parts, place


REPETITIVE_BUILDINGS = {
    each.__name__: each for each in (chapel, panelled_room, open_office, parking_deck, stairwell, cloister)
}
