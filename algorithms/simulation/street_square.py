"""House fronts along a street and round a square, seen from many stations 5 m apart, some on tilted tripods."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.simulation.curved_parts import bush, tube
from algorithms.simulation.materials import BRICK, CONCRETE, FOLIAGE, LAWN, PLASTER, ROOF_TILES, STEEL, WOOD
from algorithms.simulation.parts import Part, box, polygons, slab
from algorithms.simulation.scene import Scene, scene_from_parts
from algorithms.simulation.stations import station_pose
from algorithms.simulation.walls import Opening, WallFrame, wall, wall_frame

STEP_M = 5.0
"""From one station to the next."""
EYE_M = 1.6
HALF_WIDTH_M = 6.0
"""Of the street, from its middle to the nearest fronts."""
HOUSE_WIDTHS_M = (6.5, 12.0)
HOUSE_HEIGHTS_M = (6.5, 13.0)
DEEPEST_SETBACK_M = 1.6
"""How far a front may stand behind the line of the street."""
STOREY_M = 3.1
BUILT_DEPTH_M, RISE_M = 5.0, 3.2
"""How far a roof is built behind its front, and how much it rises on the way."""
WIDEST_WINDOW_M = 2.0
PARAPET_M = 0.7
"""Wall above the uppermost windows."""

STATION_WALK_M: tuple[tuple[float, float], ...] = (
    (-33.0, -0.8), (-28.1, 0.2), (-23.2, -0.8), (-18.3, 0.2), (-13.4, -0.8), (-8.5, 0.2),
    (-3.9, -1.75), (0.2, -4.62), (5.1, -5.62), (9.7, -3.67), (12.5, 0.48), (13.02, 5.45),
)  # fmt: skip
"""Where the stations of the square stand: along the street, then round a fountain; 5 m from one to the next."""
LAMPS_M = ((-30.0, 4.6), (-14.0, -4.7), (-6.0, 8.0), (8.0, 10.5), (18.5, -7.0))
TILTS_DEG = {1: (24.0, 9.0), 4: (-38.0, 5.0), 7: (16.0, -14.0), 10: (52.0, -12.0)}
"""About the scanner's own x and y axes, of the stations whose tripods lean."""


def street_square_scene() -> Scene:
    """Build a street that leads into a square, nineteen houses in all, with twelve stations, a third of them tilted."""
    rng = np.random.default_rng(2004)
    rows = (
        ((-40.0, HALF_WIDTH_M), (-10.0, HALF_WIDTH_M)),
        ((-10.0, HALF_WIDTH_M), (-10.0, 15.0)),
        ((-10.0, 15.0), (24.0, 15.0)),
        ((24.0, 12.0), (24.0, -13.0)),
        ((24.0, -13.0), (-10.0, -13.0)),
        ((-10.0, -13.0), (-10.0, -HALF_WIDTH_M)),
        ((-10.0, -HALF_WIDTH_M), (-40.0, -HALF_WIDTH_M)),
    )
    parts = [part for start, end in rows for part in row_of_houses(start, end, rng)]
    parts += [*ground(-60.0, 50.0), *_furniture_of_the_square(rng)]
    headings = rng.uniform(0.0, 2.0 * np.pi, len(STATION_WALK_M))
    stations = tuple(
        set_up_by_hand(place, float(heading), TILTS_DEG.get(k), rng)
        for k, (place, heading) in enumerate(zip(STATION_WALK_M, headings, strict=True))
    )
    return scene_from_parts("street_square", parts, stations)


def street_scene(stations: int, rng: np.random.Generator) -> Scene:
    """Build a straight street, as long as its stations need, every third of which is tilted.

    Parameters
    ----------
    stations
        How many, 5 m from one to the next.
    rng
        Draws the houses; another generator gives another street.
    """
    start, end = -12.0, STEP_M * (stations - 1) + 12.0
    parts = [
        *row_of_houses((start, HALF_WIDTH_M), (end, HALF_WIDTH_M), rng),
        *row_of_houses((end, -HALF_WIDTH_M), (start, -HALF_WIDTH_M), rng),
        *ground(start - 10.0, end + 10.0),
    ]
    for x in np.arange(start + 5.0, end, 17.0).tolist():
        side = HALF_WIDTH_M - 1.2 if rng.random() < 0.5 else 1.2 - HALF_WIDTH_M
        parts += [*lamp(x + float(rng.uniform(-2.0, 2.0)), side), *parked_car(x + 8.0, -0.6 * side, rng)]
    tilts = rng.uniform(20.0, 50.0, stations) * rng.choice((-1.0, 1.0), stations)
    poses = tuple(
        set_up_by_hand(
            (STEP_M * k, 0.5 * (-1.0) ** k),
            float(rng.uniform(0.0, 2.0 * np.pi)),
            (float(tilts[k]), 0.0) if k % 3 == 1 else None,
            rng,
        )
        for k in range(stations)
    )
    return scene_from_parts("street", parts, poses)


def row_of_houses(
    start_m: tuple[float, float],
    end_m: tuple[float, float],
    rng: np.random.Generator,
    heights_m: tuple[float, float] = HOUSE_HEIGHTS_M,
) -> list[Part]:
    """Build houses wall to wall on a ground line, each with a width, height, setback and windows of its own.

    Their fronts look to the right of the direction start -> end.

    Parameters
    ----------
    start_m, end_m
        Of the line of the street [m].
    rng
        Draws the houses.
    heights_m
        Lowest and highest eaves.
    """
    start, end = np.array(start_m, dtype=np.float64), np.array(end_m, dtype=np.float64)
    length = float(np.linalg.norm(end - start))
    count = max(1, round(length / float(np.mean(HOUSE_WIDTHS_M))))
    widths = rng.uniform(*HOUSE_WIDTHS_M, count)
    corners = np.concatenate([[0.0], np.cumsum(widths)]) * length / widths.sum()
    along = (end - start) / length
    behind = np.array([-along[1], along[0]])
    parts: list[Part] = []
    for k in range(count):
        setback = rng.uniform(0.0, DEEPEST_SETBACK_M) * behind
        foot, far = start + corners[k] * along + setback, start + corners[k + 1] * along + setback
        frame = wall_frame((float(foot[0]), float(foot[1])), (float(far[0]), float(far[1])))
        parts += _house(frame, float(corners[k + 1] - corners[k]), rng, heights_m)
    return parts


def _house(frame: WallFrame, width: float, rng: np.random.Generator, heights_m: tuple[float, float]) -> list[Part]:
    """Build front, party walls and the slope of the roof towards the street."""
    height = float(rng.uniform(*heights_m))
    material = (PLASTER, BRICK, CONCRETE)[rng.integers(3)]
    top = np.array([[0.0, height], [width, height]])
    reveal = float(rng.uniform(0.12, 0.3))
    parts = wall(frame, top, _windows(width, height, rng), material, reveal_m=reveal)
    for side in (0.0, width):
        front, back = (
            frame.at(np.array([[side, 0.0], [side, height]])),
            frame.at(np.array([[side, height + RISE_M], [side, 0.0]]), -BUILT_DEPTH_M),
        )
        parts.append(polygons([np.concatenate([front, back])], material))
    eaves = float(rng.uniform(0.25, 0.6))
    drop = RISE_M * eaves / BUILT_DEPTH_M
    low = frame.at(np.array([[0.0, height - drop], [width, height - drop]]), eaves)
    high = frame.at(np.array([[width, height + RISE_M], [0.0, height + RISE_M]]), -BUILT_DEPTH_M)
    parts.append(slab(np.concatenate([low, high]), np.array([0.0, 0.0, 0.15]), ROOF_TILES))
    if rng.random() < 0.5:
        pipe = frame.at(np.array([[0.2, 0.0], [0.2, height - drop]]), 0.1).tolist()
        parts.append(tube(tuple(pipe[0]), tuple(pipe[1]), 0.05, STEEL, capped=False))
    return parts


def _windows(width: float, height: float, rng: np.random.Generator) -> list[Opening]:
    """Draw windows in storeys one above the other, with a door in one of the lower places."""
    across = int(rng.integers(2, max(3, int(width / 2.4)) + 1))
    storeys = max(1, int((height - PARAPET_M) / STOREY_M))
    pitch = width / across
    wide = min(float(rng.uniform(0.42, 0.58)) * pitch, WIDEST_WINDOW_M)
    sill, tall = float(rng.uniform(0.75, 1.05)), float(rng.uniform(1.25, 1.65))
    shift = float(rng.uniform(-0.12, 0.12)) * pitch
    door = int(rng.integers(across))
    openings = []
    for storey in range(storeys):
        for place in range(across):
            left = (place + 0.5) * pitch - 0.5 * wide + shift
            base = storey * STOREY_M
            if storey == 0 and place == door:
                openings.append(Opening(left, left + min(wide, 1.1), 0.0, 2.15, glazed=False))
            else:
                openings.append(Opening(left, left + wide, base + sill, base + sill + tall))
    return openings


def ground(low_x: float, high_x: float) -> list[Part]:
    """Lay the street's surface, from 40 m on one side of its axis to 40 m on the other."""
    ring = np.array([(low_x, -40.0, 0.0), (high_x, -40.0, 0.0), (high_x, 40.0, 0.0), (low_x, 40.0, 0.0)])
    return [polygons([ring], CONCRETE, with_edges=False)]


def _furniture_of_the_square(rng: np.random.Generator) -> list[Part]:
    """Put up what stands about: lamps, a fountain, a kiosk, cars, a tree in a bed, steps."""
    degree = np.pi / 180.0
    return [
        *(
            part
            for x, y in ((-30.0, 4.6), (-14.0, -4.7), (-6.0, 8.0), (8.0, 10.5), (18.5, -7.0))
            for part in lamp(x, y)
        ),
        tube((4.6, 1.6, 0.0), (4.6, 1.6, 0.75), 2.1, CONCRETE),
        tube((4.6, 1.6, 0.75), (4.6, 1.6, 3.1), 0.28, CONCRETE),
        box((17.0, 3.0, 0.0), (19.6, 5.3, 2.7), STEEL, turn_rad=18.0 * degree),
        box((-4.0, 11.0, 0.0), (1.5, 13.2, 0.45), CONCRETE),
        tube((-1.4, 12.1, 0.45), (-1.3, 12.2, 3.0), 0.17, WOOD),
        bush((-1.3, 12.2, 4.4), (1.9, 1.8, 1.7), FOLIAGE, rng),
        box((-2.0, -12.9, 0.0), (4.0, -11.9, 0.18), CONCRETE),
        box((-1.6, -12.9, 0.18), (3.6, -12.4, 0.36), CONCRETE),
        box((10.0, -11.0, 0.0), (14.0, -9.0, 0.5), LAWN, turn_rad=-9.0 * degree),
        *(part for x, y in ((-25.5, -3.9), (-19.5, 4.0), (15.5, 10.6)) for part in parked_car(x, y, rng)),
    ]


def lamp(x: float, y: float) -> list[Part]:
    """Put up a street lamp."""
    return [tube((x, y, 0.0), (x, y, 4.8), 0.075, STEEL), tube((x, y, 4.8), (x, y, 5.1), 0.2, STEEL)]


def parked_car(x: float, y: float, rng: np.random.Generator, heading_rad: float = 0.0) -> list[Part]:
    """Put a car of two boxes about where it belongs, lengthwise along a heading from x."""
    turn = heading_rad + float(rng.normal(0.0, np.radians(3.0)))
    return [
        box((x - 2.1, y - 0.85, 0.25), (x + 2.1, y + 0.85, 0.9), STEEL, turn_rad=turn),
        box((x - 1.3, y - 0.72, 0.9), (x + 1.1, y + 0.72, 1.45), STEEL, turn_rad=turn),
    ]


def set_up_by_hand(
    place_m: Sequence[float], heading_rad: float, tilt_deg: tuple[float, float] | None, rng: np.random.Generator
) -> RigidTransform:
    """Set up a tripod by hand within about a degree of the vertical, unless it leans on purpose."""
    tilt_x, tilt_y = np.radians(rng.normal(0.0, 0.8, 2) if tilt_deg is None else tilt_deg)
    height = EYE_M + float(rng.uniform(-0.08, 0.08))
    return station_pose((*place_m, height), heading_rad, float(tilt_x), float(tilt_y))
