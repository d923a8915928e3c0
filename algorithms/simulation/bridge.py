"""A footbridge over a river: nearly all edges parallel, two pillars, the same seen from either bank."""

import numpy as np

from algorithms.simulation.curved_parts import bush, tube
from algorithms.simulation.materials import CONCRETE, FOLIAGE, GRAVEL, LAWN, PAINT, STEEL, WATER, WOOD
from algorithms.simulation.parts import Part, box, polygons
from algorithms.simulation.scene import Scene, scene_from_parts
from algorithms.simulation.stations import station_pose

HALF_LENGTH_M, HALF_WIDTH_M = 18.0, 2.0
"""The deck lies along x; the bridge's middle is over the world's origin."""
DECK_M, DECK_THICKNESS_M = 5.2, 0.45
"""Height of the deck above the water."""
GIRDER_Y_M, GIRDER_WIDTH_M, GIRDER_DEPTH_M = 1.2, 0.4, 0.7
PILLAR_X_M, PILLAR_RADIUS_M = 7.0, 0.55
"""One pillar on each side of the river."""
POST_STEP_M = 2.0
SHORE_X_M, BANK_X_M, BANK_M = 8.5, 14.5, 2.1
"""The banks rise from the water at x = ± SHORE to their height at x = ± BANK."""
FAR_M = 45.0
"""Half size of the ground."""


def bridge_scene() -> Scene:
    """Build the bridge, which turned by half a circle about its middle is itself again, and the banks.

    What stands on the left bank (a bench, a signpost, a life belt's box, bushes) is all that tells the ends apart. Both
    stations stand upstream, one on each bank.
    """
    degree = np.pi / 180.0
    stations = (
        station_pose((-12.2, -16.4, 2.95), 63.0 * degree, 0.9 * degree, -0.6 * degree),
        station_pose((9.8, -14.1, 2.14), 171.0 * degree, -0.7 * degree, 1.2 * degree),
    )
    return scene_from_parts("bridge", [*bridge_parts(), *_banks(), *_left_bank()], stations)


def bridge_parts() -> list[Part]:
    """Build the bridge alone: symmetric about both vertical planes through its middle."""
    return [*_deck(), *_supports(), *(part for side in (-1.0, 1.0) for part in _railing(side))]


def _deck() -> list[Part]:
    a, b = HALF_LENGTH_M, HALF_WIDTH_M
    under = DECK_M - DECK_THICKNESS_M
    parts = [box((-a, -b, under), (a, b, DECK_M), CONCRETE)]
    for side in (-1.0, 1.0):
        kerb, girder = sorted((side * b, side * (b - 0.3))), GIRDER_Y_M * side
        parts.append(box((-a, kerb[0], DECK_M), (a, kerb[1], DECK_M + 0.18), CONCRETE, omit=("bottom",)))
        low, high = girder - 0.5 * GIRDER_WIDTH_M, girder + 0.5 * GIRDER_WIDTH_M
        parts.append(box((-a, low, under - GIRDER_DEPTH_M), (a, high, under), PAINT, omit=("top",)))
    return parts


def _supports() -> list[Part]:
    under = DECK_M - DECK_THICKNESS_M - GIRDER_DEPTH_M
    parts = []
    for side in (-1.0, 1.0):
        x = side * PILLAR_X_M
        parts.append(box((x - 0.45, -1.7, under - 0.55), (x + 0.45, 1.7, under), CONCRETE))
        parts.append(tube((x, 0.0, -1.0), (x, 0.0, under - 0.55), PILLAR_RADIUS_M, CONCRETE))
        near, far = sorted((side * HALF_LENGTH_M, side * (HALF_LENGTH_M + 1.5)))
        parts.append(box((near, -2.6, 0.0), (far, 2.6, DECK_M), CONCRETE))
        near, far = sorted((side * (HALF_LENGTH_M - 0.8), side * HALF_LENGTH_M))
        parts.append(box((near, -2.6, 0.0), (far, 2.6, under), CONCRETE))
    return parts


def _railing(side: float) -> list[Part]:
    """Build the railing at y = side times nearly half the width."""
    y, foot = side * (HALF_WIDTH_M - 0.15), DECK_M + 0.18
    posts = np.arange(-HALF_LENGTH_M + 1.0, HALF_LENGTH_M, POST_STEP_M)
    parts = [box((x - 0.03, y - 0.03, foot), (x + 0.03, y + 0.03, foot + 1.05), STEEL) for x in posts]
    rails = ((0.30, 0.02), (0.65, 0.02), (1.05, 0.045))
    for height, half in rails:
        low, high = foot + height, foot + height + 2.0 * half
        parts.append(box((-HALF_LENGTH_M, y - half, low), (HALF_LENGTH_M, y + half, high), STEEL))
    return parts


def _banks() -> list[Part]:
    """Build water and banks; they too are symmetric."""

    def strip(x0: float, z0: float, x1: float, z1: float) -> np.ndarray:
        return np.array([(x0, -FAR_M, z0), (x1, -FAR_M, z1), (x1, FAR_M, z1), (x0, FAR_M, z0)])

    slopes = [strip(SHORE_X_M, 0.0, BANK_X_M, BANK_M), strip(-BANK_X_M, BANK_M, -SHORE_X_M, 0.0)]
    meadows = [strip(BANK_X_M, BANK_M, FAR_M, BANK_M), strip(-FAR_M, BANK_M, -BANK_X_M, BANK_M)]
    return [
        polygons([strip(-SHORE_X_M, 0.0, SHORE_X_M, 0.0)], WATER, with_edges=False),
        polygons(slopes, GRAVEL, with_edges=False),
        polygons(meadows, LAWN, with_edges=False),
    ]


def _left_bank() -> list[Part]:
    rng = np.random.default_rng(20240517)
    degree = np.pi / 180.0
    return [
        box((-20.5, -8.2, BANK_M + 0.42), (-18.7, -7.8, BANK_M + 0.48), WOOD, turn_rad=24.0 * degree),
        box((-20.1, -8.1, BANK_M), (-19.9, -7.9, BANK_M + 0.42), CONCRETE, turn_rad=24.0 * degree),
        box((-19.3, -8.1, BANK_M), (-19.1, -7.9, BANK_M + 0.42), CONCRETE, turn_rad=24.0 * degree),
        tube((-16.2, -6.3, BANK_M), (-16.2, -6.3, BANK_M + 2.4), 0.04, STEEL),
        box((-16.6, -6.36, BANK_M + 1.7), (-15.8, -6.33, BANK_M + 2.3), PAINT, turn_rad=-12.0 * degree),
        box((-15.2, -3.9, BANK_M), (-14.8, -3.6, BANK_M + 1.3), PAINT, turn_rad=7.0 * degree),
        bush((-23.0, 7.0, BANK_M + 0.8), (1.6, 1.4, 1.2), FOLIAGE, rng, corners=1200),
        bush((-21.0, -14.5, BANK_M + 0.5), (1.0, 0.9, 0.8), FOLIAGE, rng, corners=800),
        bush((22.5, -6.5, BANK_M + 0.9), (1.5, 1.8, 1.3), FOLIAGE, rng, corners=1200),
        bush((17.5, 9.0, BANK_M + 0.6), (1.1, 1.0, 0.9), FOLIAGE, rng, corners=800),
    ]
