"""Scenes that do not determine a pose: what registration must refuse."""

import numpy as np

from algorithms.simulation.curved_parts import tube
from algorithms.simulation.materials import CONCRETE, STEEL
from algorithms.simulation.parts import polygons
from algorithms.simulation.scene import Scene, scene_from_parts
from algorithms.simulation.stations import station_pose

ENDLESS_M = 150.0
"""Half length of what shall have no ends: far beyond what comes back at slanting incidence."""
PIPE_SECTIONS = (
    # y [m], z [m], radius [m]
    (-3.1, 0.4, 0.20),
    (-2.4, 2.9, 0.11),
    (-1.6, -0.9, 0.16),
    (0.3, 3.4, 0.25),
    (1.1, -1.1, 0.084),
    (2.2, 2.3, 0.07),
    (2.9, 0.7, 0.18),
    (3.6, -0.6, 0.30),
)


def parallel_pipes_scene() -> Scene:
    """Build endless pipes of several radii along x and nothing else: the shift along x is free."""
    parts = [tube((-ENDLESS_M, y, z), (ENDLESS_M, y, z), radius, STEEL, capped=False) for y, z, radius in PIPE_SECTIONS]
    stations = (
        station_pose((0.0, 0.0, 0.9), 0.7, 0.01, -0.02),
        station_pose((1.3, -0.4, 1.1), -1.9, -0.03, 0.01),
    )
    return scene_from_parts("parallel_pipes", parts, stations)


def single_plane_scene() -> Scene:
    """Build one endless level plane: two shifts and one rotation are free."""
    a = ENDLESS_M
    ground = np.array([(-a, -a, 0.0), (a, -a, 0.0), (a, a, 0.0), (-a, a, 0.0)])
    stations = (
        station_pose((0.0, 0.0, 1.7), 0.4, 0.02, 0.01),
        station_pose((2.1, 1.2, 1.6), 2.2, -0.01, 0.03),
    )
    return scene_from_parts("single_plane", [polygons([ground], CONCRETE, with_edges=False)], stations)
