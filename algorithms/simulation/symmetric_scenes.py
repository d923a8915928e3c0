"""Buildings that look the same turned or shifted, to find out whether a registration knows that it cannot know.

Each builder draws its measures from a generator and places two stations. `oddities` pieces of furniture, each there
once, break the symmetry; with none, two poses fit equally well (a room, an arcade) or nearly so.
"""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.simulation.curved_parts import tube
from algorithms.simulation.materials import CONCRETE, PAINT, STEEL, WOOD
from algorithms.simulation.parts import Part, box, moved, polygons
from algorithms.simulation.scene import Scene, scene_from_parts
from algorithms.simulation.stations import station_pose
from algorithms.simulation.walls import Opening, wall, wall_frame

EYE_M = 1.6
HALF_TURN = RigidTransform.from_rotation(Rotation.from_euler("z", np.pi))


def symmetric_room(rng: np.random.Generator, oddities: int = 0) -> Scene:
    """Build a furnished room that is itself again after half a turn about its middle."""
    length, depth, height = rng.uniform(7.0, 12.0), rng.uniform(4.5, 6.5), rng.uniform(2.5, 3.4)
    width, sill = rng.uniform(0.9, 1.6), rng.uniform(0.6, 1.0)
    places = np.sort(rng.uniform(0.12, 0.88 - width / length, 2)) * length
    if places[1] - places[0] < width + 0.3:
        places = places[:1]
    windows = [Opening(float(x), float(x + width), float(sill), float(sill + 1.3)) for x in places]
    door = Opening(0.4 * depth, 0.4 * depth + 0.9, 0.0, 2.05, glazed=False)
    spots = [(-0.28 * length, 0.1 * depth), (0.22 * length, -0.15 * depth)]
    half = [
        *_wall((-length / 2, depth / 2), (length / 2, depth / 2), height, windows),
        *_wall((length / 2, depth / 2), (length / 2, -depth / 2), height, [door]),
        *_pieces(rng, 3, length / 2 - 0.8, depth / 2 - 0.7, spots),
    ]
    parts = [*half, *moved(half, HALF_TURN), *_floor_and_ceiling(length, depth, height)]
    parts += _pieces(rng, oddities, length / 2 - 0.8, depth / 2 - 0.7, spots)
    return scene_from_parts("symmetric_room", parts, _stations(rng, spots))


def corridor_of_equal_doors(rng: np.random.Generator, oddities: int = 0) -> Scene:
    """Build a corridor with the same door every few metres on both sides, and equal ends."""
    step, doors = rng.uniform(2.6, 4.2), int(rng.integers(7, 11))
    width, height = rng.uniform(1.8, 2.6), rng.uniform(2.4, 2.9)
    length = step * doors
    holes = [
        Opening(float((k + 0.5) * step - 0.45), float((k + 0.5) * step + 0.45), 0.0, 2.05, glazed=False)
        for k in range(doors)
    ]
    half = [
        *_wall((-length / 2, width / 2), (length / 2, width / 2), height, holes),
        *_wall((length / 2, width / 2), (length / 2, -width / 2), height, []),
    ]
    parts = [*half, *moved(half, HALF_TURN), *_floor_and_ceiling(length, width, height)]
    first = rng.uniform(-0.35, 0.1) * length
    spots = [(first, 0.1), (first + rng.uniform(1.2, 2.8) * step, -0.1)]
    parts += _pieces(rng, oddities, length / 2 - 1.0, width / 2 - 0.3, spots, largest_m=0.4)
    return scene_from_parts("corridor_of_equal_doors", parts, _stations(rng, spots))


def car_park(rng: np.random.Generator, oddities: int = 0) -> Scene:
    """Build one storey of a car park: a grid of equal columns and beams between floor and ceiling, open all round."""
    bay_x, bay_y, height = rng.uniform(4.8, 5.4), rng.uniform(6.5, 7.8), rng.uniform(2.3, 2.8)
    nx, ny = int(rng.integers(8, 12)), int(rng.integers(4, 6))
    length, depth, half = nx * bay_x, ny * bay_y, rng.uniform(0.15, 0.25)
    parts = _floor_and_ceiling(length + 2.0, depth + 2.0, height)
    for i in range(nx + 1):
        x = (i - nx / 2) * bay_x
        parts.append(box((x - 0.15, -depth / 2, height - 0.35), (x + 0.15, depth / 2, height), CONCRETE, omit=("top",)))
        for j in range(ny + 1):
            y = (j - ny / 2) * bay_y
            parts.append(
                box((x - half, y - half, 0.0), (x + half, y + half, height - 0.35), CONCRETE, omit=("top", "bottom"))
            )
    first = (rng.uniform(-0.8, 0.8) * bay_x, rng.uniform(-0.8, 0.8) * bay_y)
    spots = [first, (first[0] + rng.uniform(1.2, 2.4) * bay_x, first[1] + rng.uniform(-0.4, 0.4) * bay_y)]
    parts += _pieces(rng, oddities, 1.5 * bay_x, bay_y, spots, largest_m=2.0)
    return scene_from_parts("car_park", parts, _stations(rng, spots))


def equal_storeys(rng: np.random.Generator, oddities: int = 0) -> Scene:
    """Build a hall with the same gallery round it on every storey; the stations stand on galleries above each other."""
    length, depth, storey = rng.uniform(12.0, 16.0), rng.uniform(9.0, 12.0), rng.uniform(3.0, 3.6)
    storeys, gallery = 4, rng.uniform(1.8, 2.4)
    height = storeys * storey
    step = length / 5.0
    parts: list[Part] = _floor_and_ceiling(length, depth, height)
    for k in range(storeys):
        base = k * storey
        holes = [
            Opening(float((m + 0.5) * step - 0.45), float((m + 0.5) * step + 0.45), base, base + 2.05, glazed=False)
            for m in range(5)
        ]
        half = [
            *_wall((-length / 2, depth / 2), (length / 2, depth / 2), base + storey, holes, base),
            *_wall((length / 2, depth / 2), (length / 2, -depth / 2), base + storey, [], base),
        ]
        if k:
            half.append(box((-length / 2, depth / 2 - gallery, base - 0.25), (length / 2, depth / 2, base), CONCRETE))
            rail = depth / 2 - gallery + 0.05
            half.append(box((-length / 2, rail - 0.03, base + 0.95), (length / 2, rail + 0.03, base + 1.01), STEEL))
            half += [tube((x, rail, base), (x, rail, base + 0.95), 0.03, STEEL) for x in np.arange(-2, 3) * step]
        parts += [*half, *moved(half, HALF_TURN)]
    lower = int(rng.integers(1, storeys - 1))
    y = depth / 2 - gallery / 2
    xs = rng.uniform(-0.3, 0.3, 2) * length
    spots = [(float(x), 0.0) for x in xs]
    parts += moved(_pieces(rng, oddities, length / 2 - 1.0, 0.3, spots), station_pose((0.0, y, lower * storey), 0.0))
    stations = tuple(
        station_pose((float(x), y, level * storey + EYE_M), rng.uniform(0.0, 2.0 * np.pi))
        for x, level in zip(xs, (lower, lower + 1), strict=True)
    )
    return scene_from_parts("equal_storeys", parts, stations)


SYMMETRIC_SCENES: Mapping[str, Callable[[np.random.Generator, int], Scene]] = MappingProxyType(
    {
        "symmetric_room": symmetric_room,
        "corridor_of_equal_doors": corridor_of_equal_doors,
        "car_park": car_park,
        "equal_storeys": equal_storeys,
    }
)
"""Builders by name, called with a generator and the number of oddities."""


def _wall(
    start: tuple[float, float], end: tuple[float, float], top_m: float, openings: list[Opening], low_m: float = 0.0
) -> list[Part]:
    """Build a wall whose outer side is on the left, so that its face is seen from the right."""
    length = float(np.hypot(end[0] - start[0], end[1] - start[1]))
    rim = np.array([[0.0, top_m], [length, top_m]])
    return wall(wall_frame(start, end), rim, openings, PAINT, low_m=low_m)


def _floor_and_ceiling(length_m: float, depth_m: float, height_m: float) -> list[Part]:
    x, y = length_m / 2, depth_m / 2
    return [
        polygons([np.array([(-x, -y, z), (x, -y, z), (x, y, z), (-x, y, z)])], CONCRETE, with_edges=False)
        for z in (0.0, height_m)
    ]


def _pieces(
    rng: np.random.Generator,
    count: int,
    reach_x_m: float,
    reach_y_m: float,
    spots: Sequence[tuple[float, float]],
    largest_m: float = 1.2,
) -> list[Part]:
    """Put boxes on the floor, each turned and sized by chance, none where a station (or its image) stands."""
    parts: list[Part] = []
    while len(parts) < count:
        x, y = rng.uniform(-reach_x_m, reach_x_m), rng.uniform(-reach_y_m, reach_y_m)
        a, b = 0.5 * rng.uniform(0.3, 1.0, 2) * largest_m
        clear = 0.7 + np.hypot(a, b)
        if any(min(np.hypot(x - u, y - v), np.hypot(x + u, y + v)) < clear for u, v in spots):
            continue
        top = rng.uniform(0.4, 1.8)
        parts.append(box((x - a, y - b, 0.0), (x + a, y + b, top), WOOD, turn_rad=rng.uniform(0.0, np.pi)))
    return parts


def _stations(rng: np.random.Generator, spots: list[tuple[float, float]]) -> tuple[RigidTransform, ...]:
    return tuple(
        station_pose(
            (x + rng.uniform(-0.2, 0.2), y + rng.uniform(-0.1, 0.1), EYE_M + rng.uniform(-0.1, 0.1)),
            rng.uniform(0.0, 2.0 * np.pi),
            *rng.normal(0.0, np.radians(0.7), 2),
        )
        for x, y in spots
    )
