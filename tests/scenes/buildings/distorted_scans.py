"""Clouds that differ from what was scanned by more than a rigid motion. All about the scan's own origin."""

import numpy as np


def scaled(points, factor):
    """Make a cloud larger in all directions: other units, or a rescaled file."""
    return points * factor


def stretched(points, factor, axis=2):
    """Make a cloud larger along one axis: a projection's scale, or a height in other units."""
    factors = np.ones(3)
    factors[axis] = factor
    return points * factors


def sheared(points, shear, axis=0, along=2):
    """Move points along one axis in proportion to another one: axes of the instrument that are not square."""
    moved = points.copy()
    moved[:, axis] += shear * points[:, along]
    return moved


def bent(points, sagitta_m, length_m, axis=0, along=2):
    """Bend a cloud along one axis: it rises by the sagitta at half the length from the origin (a parabola)."""
    moved = points.copy()
    moved[:, along] += sagitta_m * (points[:, axis] / (0.5 * length_m)) ** 2
    return moved


DISTORTIONS = {
    "scaled": scaled,
    "stretched x": lambda points, factor: stretched(points, factor, 0),
    "stretched z": lambda points, factor: stretched(points, factor, 2),
    "sheared": lambda points, factor: sheared(points, factor - 1.0),
    "bent": lambda points, factor: bent(points, 10.0 * (factor - 1.0), 20.0),
}
"""By name, called with points (n, 3) in the scanner's frame and a factor; 1 changes nothing."""
