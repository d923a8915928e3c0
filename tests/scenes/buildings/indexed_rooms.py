"""Surfaces of small rooms, ready to be laid into each other."""

import numpy as np

from algorithms.scans.surface_index import surface_index


def walls(*planes, step=0.1):
    """Give points and normals of rectangles (corner, side, side), facing the cross product of the sides."""
    points, normals = [], []
    for corner, *sides in planes:
        first, second = np.array(sides, float)
        lengths = np.linalg.norm(first), np.linalg.norm(second)
        u, v = (np.arange(0.0, length, step) / length for length in lengths)
        grid = np.array(corner, float) + u[:, None, None] * first + v[None, :, None] * second
        points.append(grid.reshape(-1, 3))
        normals.append(np.broadcast_to(np.cross(first, second) / np.prod(lengths), points[-1].shape))
    return np.concatenate(points), np.concatenate(normals)


def room(length=6.0, width=4.0, height=2.5):
    """Give a room with a pillar on one side, seen from inside."""
    return walls(
        ((0, 0, 0), (length, 0, 0), (0, width, 0)),
        ((0, 0, height), (0, width, 0), (length, 0, 0)),
        ((0, 0, 0), (0, width, 0), (0, 0, height)),
        ((length, 0, 0), (0, 0, height), (0, width, 0)),
        ((0, 0, 0), (0, 0, height), (length, 0, 0)),
        ((0, width, 0), (length, 0, 0), (0, 0, height)),
        ((1.5, 1.0, 0), (0, 0, height), (0.5, 0, 0)),
        ((1.5, 1.0, 0), (0, 0.5, 0), (0, 0, height)),
    )


def index(points, normals, sensor):
    return surface_index(points, normals, 0.1, np.array(sensor, float))
