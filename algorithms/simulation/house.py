"""A detached house seen from the garden. Nothing in it repeats or is symmetric, so that poses are unambiguous."""

from dataclasses import replace

import numpy as np

from algorithms.simulation.curved_parts import bush, tube
from algorithms.simulation.materials import BRICK, CONCRETE, FOLIAGE, LAWN, PLASTER, ROOF_TILES, STEEL, WOOD
from algorithms.simulation.parts import Part, box, hexahedron, moved, path_of_boxes, polygons, slab
from algorithms.simulation.scene import Scene, scene_from_parts
from algorithms.simulation.stations import station_pose
from algorithms.simulation.textures import Stripes
from algorithms.simulation.walls import Opening, wall, wall_frame

LENGTH_M, DEPTH_M = 11.0, 8.0
"""Outer size of the main body along x and y; its south-west corner is the world's origin."""
PLINTH_M, EAVES_M = 0.5, 5.6
RIDGE_Y_M, RIDGE_M = 4.8, 9.2
"""The ridge runs along x, off the middle: the south slope is 0.75, the north slope 1.125."""
SOUTH_SLOPE = (RIDGE_M - EAVES_M) / RIDGE_Y_M
NORTH_SLOPE = (RIDGE_M - EAVES_M) / (DEPTH_M - RIDGE_Y_M)
ROOF_THICKNESS_M = 0.22
"""Measured vertically."""
UP = np.array([0.0, 0.0, 1.0])

SOUTH_OPENINGS = (
    Opening(1.0, 2.6, 1.4, 2.7),
    Opening(4.2, 5.3, 0.5, 2.65, glazed=False, frame_depth_m=0.2),
    Opening(6.6, 8.0, 1.4, 2.7),
    Opening(8.8, 10.3, 0.9, 2.7),
    Opening(0.9, 2.1, 3.8, 5.0),
    Opening(3.6, 4.6, 3.8, 5.0),
    Opening(6.4, 7.9, 3.7, 5.0),
    Opening(9.2, 9.9, 4.0, 4.8),
)
EAST_OPENINGS = (Opening(0.3, 1.1, 1.5, 2.6), Opening(2.0, 3.2, 3.8, 5.0), Opening(4.2, 5.2, 6.3, 7.4))
NORTH_OPENINGS = (
    Opening(1.0, 1.8, 1.6, 2.3),
    Opening(4.5, 6.9, 0.5, 2.7),
    Opening(8.6, 9.8, 1.4, 2.6),
    Opening(2.0, 3.1, 3.9, 4.9),
    Opening(7.2, 8.8, 3.7, 5.0),
)
WEST_OPENINGS = (
    Opening(1.5, 2.7, 1.4, 2.7),
    Opening(4.6, 5.3, 1.8, 4.4),
    Opening(6.0, 7.1, 3.9, 5.0),
    Opening(3.0, 3.9, 6.2, 7.2),
)


def house_scene() -> Scene:
    """Build the house with porch, garage, dormer, chimney, shed, garden wall and clutter."""
    parts = [*_main_body(), *_roof(), *_dormer(), *_chimney(), *_porch(), *_garage(), *_pipes(), *_garden()]
    degree = np.pi / 180.0
    stations = (
        station_pose((0.5, -6.8, 1.62), 37.0 * degree, 0.6 * degree, -0.9 * degree),
        station_pose((10.6, -7.2, 1.71), 205.0 * degree, -1.4 * degree, 0.3 * degree),
        station_pose((17.2, -6.0, 1.55), 111.0 * degree, 0.8 * degree, 1.1 * degree),
        station_pose((19.2, 8.6, 1.68), 292.0 * degree, -0.5 * degree, 0.7 * degree),
        station_pose((9.6, 14.6, 1.60), 64.0 * degree, 28.0 * degree, -11.0 * degree),
        station_pose((-2.6, 11.8, 1.66), 158.0 * degree, 0.4 * degree, -1.7 * degree),
        station_pose((-3.0, -4.5, 1.59), 333.0 * degree, 1.2 * degree, 0.2 * degree),
    )
    return scene_from_parts("house", parts, stations)


def house_front_scene() -> Scene:
    """Build the front of the house alone, seen from two stations in the meadow before it.

    Wall, plinth, roof and ground meet in parallel lines, so that a point cloud hardly holds the shift along the front;
    windows, sills and a painted band are for photos. Head angles towards the front's middle: `head_angle_towards`.
    """
    parts = [*_main_body(), *_roof(), *_pipes()[:2]]
    meadow = np.array([(-30.0, -28.0, 0.0), (38.0, -28.0, 0.0), (38.0, 32.0, 0.0), (-30.0, 32.0, 0.0)])
    parts.append(polygons([meadow], LAWN, with_edges=False))
    banded = replace(PLASTER, texture=Stripes((0.45, 0.20, 0.14), levels_m=((3.05, 3.25),)))
    parts = [replace(part, material=banded) if part.material == PLASTER else part for part in parts]
    degree = np.pi / 180.0
    stations = (
        station_pose((2.9, -12.6, 1.62), 37.0 * degree, 0.6 * degree, -0.9 * degree),
        station_pose((8.3, -13.4, 1.71), 205.0 * degree, -1.4 * degree, 0.3 * degree),
    )
    return scene_from_parts("house_front", parts, stations)


def _south_roof_m(y: float) -> float:
    """Give the height of the south slope's tiles at y."""
    return RIDGE_M + ROOF_THICKNESS_M - SOUTH_SLOPE * (RIDGE_Y_M - y)


def _main_body() -> list[Part]:
    eaves = np.array([[0.0, EAVES_M], [LENGTH_M, EAVES_M]])
    east_gable = np.array([[0.0, EAVES_M], [RIDGE_Y_M, RIDGE_M], [DEPTH_M, EAVES_M]])
    west_gable = np.array([[0.0, EAVES_M], [DEPTH_M - RIDGE_Y_M, RIDGE_M], [DEPTH_M, EAVES_M]])
    corners = ((0.0, 0.0), (LENGTH_M, 0.0), (LENGTH_M, DEPTH_M), (0.0, DEPTH_M))
    sides = (
        (0, eaves, SOUTH_OPENINGS),
        (1, east_gable, EAST_OPENINGS),
        (2, eaves, NORTH_OPENINGS),
        (3, west_gable, WEST_OPENINGS),
    )
    parts: list[Part] = []
    for k, top, openings in sides:
        frame = wall_frame(corners[k], corners[(k + 1) % 4])
        parts += wall(frame, top, openings, PLASTER, low_m=PLINTH_M)
        for o in openings:
            if o.sill_m > PLINTH_M:
                ring = frame.at(np.array([[o.left_m - 0.05, o.sill_m - 0.04], [o.right_m + 0.05, o.sill_m - 0.04]]))
                outwards = 0.07 * frame.axes[:, 2]
                board = np.array([ring[0] + outwards, ring[1] + outwards, ring[1], ring[0]])
                parts.append(slab(board, 0.04 * UP, STEEL, omit=("back",)))
    parts.append(box((-0.05, -0.05, 0.0), (LENGTH_M + 0.05, DEPTH_M + 0.05, PLINTH_M), CONCRETE))
    parts.append(box((0.3, 0.3, 2.95), (LENGTH_M - 0.3, DEPTH_M - 0.3, 3.15), CONCRETE))
    parts.append(box((5.6, 0.3, PLINTH_M), (5.75, DEPTH_M - 0.3, 2.95), PLASTER))
    return parts


def _roof() -> list[Part]:
    west, east, south, north = -0.4, LENGTH_M + 0.4, -0.6, DEPTH_M + 0.5
    low_south = RIDGE_M - SOUTH_SLOPE * (RIDGE_Y_M - south)
    low_north = RIDGE_M - NORTH_SLOPE * (north - RIDGE_Y_M)
    ridge_west, ridge_east = (west, RIDGE_Y_M, RIDGE_M), (east, RIDGE_Y_M, RIDGE_M)
    south_ring = np.array([(west, south, low_south), (east, south, low_south), ridge_east, ridge_west])
    north_ring = np.array([ridge_west, ridge_east, (east, north, low_north), (west, north, low_north)])
    thickness = ROOF_THICKNESS_M * UP
    return [
        slab(south_ring, thickness, ROOF_TILES, omit=("back",)),
        slab(north_ring, thickness, ROOF_TILES, omit=("front",)),
    ]


def _dormer() -> list[Part]:
    left, right, front, top, pitch = 2.5, 4.7, 1.0, 8.2, 0.05
    foot = _south_roof_m(front)

    def meets_roof(height_at_front: float) -> tuple[float, float]:
        """Give y and z where a plane of the dormer's pitch reaches the tiles."""
        y = (height_at_front - pitch * front - _south_roof_m(0.0)) / (SOUTH_SLOPE - pitch)
        return y, _south_roof_m(y)

    frame = wall_frame((left, front), (right, front))
    window = Opening(0.4, 1.7, foot + 0.3, top - 0.3)
    parts = wall(frame, np.array([[0.0, top], [right - left, top]]), (window,), WOOD, low_m=foot, reveal_m=0.2)
    back_y, back_z = meets_roof(top)
    cheeks = [np.array([(x, front, foot), (x, front, top), (x, back_y, back_z)]) for x in (left, right)]
    parts.append(polygons(cheeks, WOOD))
    y0, thickness = front - 0.25, 0.12
    top_y, top_z = meets_roof(top + thickness)
    low = top - 0.25 * pitch
    x0, x1 = left - 0.12, right + 0.12
    bottom_ring = [(x0, y0, low), (x1, y0, low), (x1, back_y, back_z), (x0, back_y, back_z)]
    top_ring = [(x0, y0, low + thickness), (x1, y0, low + thickness), (x1, top_y, top_z), (x0, top_y, top_z)]
    parts.append(hexahedron(np.array(bottom_ring + top_ring), STEEL))
    return parts


def _chimney() -> list[Part]:
    x0, x1, y0, y1, top = 8.0, 8.7, 5.6, 6.3, 10.6
    ring = ((x0, y0), (x1, y0), (x1, y1), (x0, y1))
    tiles = RIDGE_M + ROOF_THICKNESS_M
    bottom = [(x, y, tiles - NORTH_SLOPE * (y - RIDGE_Y_M)) for x, y in ring]
    shaft = hexahedron(np.array(bottom + [(x, y, top) for x, y in ring]), BRICK)
    return [shaft, box((x0 - 0.08, y0 - 0.08, top), (x1 + 0.08, y1 + 0.08, top + 0.1), CONCRETE)]


def _porch() -> list[Part]:
    front, low, high = -1.9, 2.85, 3.15
    roof = np.array([(3.7, front, low), (5.9, front, low), (5.9, 0.0, high), (3.7, 0.0, high)])

    def post(x: float) -> Part:
        """Build a post from the landing to the slanting roof."""
        ring = ((x, -1.45), (x + 0.14, -1.45), (x + 0.14, -1.31), (x, -1.31))
        tops = [(px, py, low + (high - low) * (py - front) / -front) for px, py in ring]
        return hexahedron(np.array([(px, py, 0.46) for px, py in ring] + tops), WOOD)

    return [
        box((3.9, -1.5, 0.0), (5.7, -0.05, 0.46), CONCRETE),
        box((3.9, -1.85, 0.0), (5.2, -1.5, 0.3), CONCRETE),
        box((3.9, -2.2, 0.0), (5.2, -1.85, 0.15), CONCRETE),
        post(3.95),
        post(5.51),
        slab(roof, 0.12 * UP, WOOD),
    ]


def _garage() -> list[Part]:
    west, east, south, north, high, low = LENGTH_M, 15.2, 1.5, 7.0, 3.0, 2.5
    long = east - west
    door = Opening(0.6, 3.4, 0.0, 2.2, glazed=False, frame_depth_m=0.18)
    parts = wall(wall_frame((west, south), (east, south)), np.array([[0.0, high], [long, low]]), (door,), BRICK)
    windows = (Opening(0.8, 2.3, 1.2, 2.0), Opening(3.6, 4.4, 1.0, 2.1))
    rim = np.array([[0.0, low], [north - south, low]])
    parts += wall(wall_frame((east, south), (east, north)), rim, windows, BRICK, reveal_m=0.2)
    back_door = Opening(2.4, 3.3, 0.02, 2.05, glazed=False)
    parts += wall(wall_frame((east, north), (west, north)), np.array([[0.0, low], [long, high]]), (back_door,), BRICK)
    drop = (high - low) / long
    edge = low - 0.3 * drop
    roof = [(west, south - 0.35, high), (east + 0.3, south - 0.35, edge), (east + 0.3, north + 0.2, edge)]
    parts.append(slab(np.array([*roof, (west, north + 0.2, high)]), 0.18 * UP, ROOF_TILES, omit=("left",)))
    return parts


def _pipes() -> list[Part]:
    return [
        tube((-0.4, -0.68, 5.15), (11.4, -0.68, 5.15), 0.07, STEEL),
        tube((10.85, -0.12, 0.0), (10.85, -0.12, 5.1), 0.05, STEEL),
        tube((-0.12, 7.7, 0.0), (-0.12, 7.7, 5.0), 0.05, STEEL),
    ]


def _garden() -> list[Part]:
    rng = np.random.default_rng(20240311)
    degree = np.pi / 180.0
    ground = np.array([(-30.0, -28.0, 0.0), (38.0, -28.0, 0.0), (38.0, 32.0, 0.0), (-30.0, 32.0, 0.0)])
    return [
        polygons([ground], LAWN, with_edges=False),
        *path_of_boxes(((-7.0, -12.0), (-6.2, 3.0), (-10.0, 14.0)), 0.24, 1.45, BRICK),
        *path_of_boxes(((22.0, 16.0), (24.5, 2.0)), 0.1, 1.8, WOOD),
        *_shed(),
        box((3.2, 8.05, 0.0), (7.6, 11.2, 0.16), CONCRETE),
        box((4.6, 9.0, 0.82), (6.3, 9.9, 0.88), WOOD, turn_rad=14.0 * degree),
        box((5.2, 9.3, 0.16), (5.6, 9.6, 0.82), WOOD, turn_rad=14.0 * degree),
        box((7.3, -3.6, 0.0), (8.1, -2.9, 1.15), STEEL, turn_rad=8.0 * degree),
        box((8.4, -3.4, 0.0), (9.1, -2.8, 1.05), STEEL, turn_rad=-5.0 * degree),
        box((12.0, -4.9, 0.25), (16.3, -3.1, 0.95), STEEL, turn_rad=3.0 * degree),
        box((12.9, -4.7, 0.95), (15.2, -3.3, 1.5), STEEL, turn_rad=3.0 * degree),
        box((-2.0, 11.0, 0.0), (-0.6, 11.8, 0.9), WOOD, turn_rad=40.0 * degree),
        box((17.4, 5.2, 0.0), (18.2, 6.6, 0.7), CONCRETE, turn_rad=17.0 * degree),
        tube((1.5, -12.5, 0.0), (1.5, -12.5, 4.2), 0.06, STEEL),
        tube((-2.8, 3.0, 0.0), (-2.65, 3.1, 2.6), 0.16, WOOD),
        bush((-2.6, 3.1, 3.7), (1.5, 1.4, 1.3), FOLIAGE, rng),
        bush((-1.3, -2.4, 0.6), (0.8, 0.7, 0.7), FOLIAGE, rng),
        bush((10.2, 10.6, 0.7), (0.9, 0.8, 0.9), FOLIAGE, rng),
        bush((18.3, 1.0, 0.5), (0.7, 0.9, 0.6), FOLIAGE, rng),
        bush((6.2, -6.4, 0.4), (0.7, 0.6, 0.5), FOLIAGE, rng),
    ]


def _shed() -> list[Part]:
    """Build a shed with a pent roof, in its own coordinates, and set it up turned by 25 degrees."""
    ring = ((0.0, 0.0), (2.9, 0.0), (2.9, 2.4), (0.0, 2.4))
    tops = (2.3, 2.3, 1.95, 1.95)
    corners = [(x, y, 0.0) for x, y in ring] + [(x, y, z) for (x, y), z in zip(ring, tops, strict=True)]
    slope = (tops[2] - tops[0]) / ring[2][1]
    low, high = tops[0] + slope * 2.65, tops[0] - slope * 0.25
    roof = np.array([(-0.2, -0.25, high), (3.1, -0.25, high), (3.1, 2.65, low), (-0.2, 2.65, low)])
    parts = [hexahedron(np.array(corners), WOOD, omit=("top",)), slab(roof, 0.1 * UP, ROOF_TILES)]
    return moved(parts, station_pose((12.6, 13.0, 0.0), np.deg2rad(25.0)))
