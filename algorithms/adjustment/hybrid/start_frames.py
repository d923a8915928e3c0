"""Frames and forms that start values are brought into: a 3-2-1 datum, planes and lines (H-11, H-15)."""

from dataclasses import replace
from itertools import product

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from algorithms.adjustment.hybrid.network import Network
from algorithms.adjustment.hybrid.point_equations import InPlane, ObservedUnknowns, OnLine
from algorithms.adjustment.hybrid.state import Kind, State
from algorithms.arrays import Array

TURNS = tuple(product((0.0, 0.5 * np.pi, np.pi, 1.5 * np.pi), repeat=2))
"""Turns about X and Z [rad] from which a datum is looked for."""


def onto_expected_coordinates(network: Network, state: State, placed: Array) -> tuple[Array, Array] | None:
    """Turn a network with a frame of its own so that expected coordinates (a 3-2-1 datum) hold (Haring 2003)."""
    rows: list[tuple[int, int, float]] = []
    for each in network.observations:
        if isinstance(each, ObservedUnknowns) and each.kind is Kind.POINT:
            rows += zip(each.numbers.tolist(), each.parameters.tolist(), each.values.tolist(), strict=True)
    rows = [row for row in rows if placed[row[0]]]
    if not rows:
        return None
    numbers, places, values = (np.array(column) for column in zip(*rows, strict=True))
    points = state.points[numbers]
    centre = points.mean(axis=0)

    def misses(parameters: Array) -> Array:
        turned = (points - centre) @ Rotation.from_rotvec(parameters[:3]).as_matrix().T + parameters[3:]
        return np.asarray(turned[np.arange(len(places)), places] - values)

    best: tuple[float, float, Array] | None = None
    for about_x, about_z in TURNS:
        turn = Rotation.from_euler("XZ", [about_x, about_z]).as_rotvec()
        found = least_squares(misses, np.concatenate([turn, centre]), method="trf", max_nfev=200)
        turned = Rotation.from_rotvec(found.x[:3])
        tilt = float(np.arccos(np.clip(turned.as_matrix()[2, 2], -1.0, 1.0)))
        key = (round(float(found.cost), 9), round(tilt + 1e-3 * float(turned.magnitude()), 6), found.x)
        if best is None or key[:2] < best[:2]:
            best = key
    if best is not None:
        turn = best[2][:3]
        shift = best[2][3:] - Rotation.from_rotvec(turn).apply(centre)
        return turn, shift
    return None


def with_fitted_forms(network: Network, state: State) -> State:
    """Start planes and lines at what fits their points (Haring 2003)."""
    for each in network.observations:
        if isinstance(each, InPlane):
            normals, offsets = state.normals.copy(), state.offsets.copy()
            for k in np.unique(each.planes):
                points = _points_of(state, each.points[each.planes == k])
                centre = points.mean(axis=0)
                normals[k] = np.linalg.svd(points - centre)[2][-1]
                offsets[k] = normals[k] @ centre
            state = replace(state, normals=normals, offsets=offsets)
        elif isinstance(each, OnLine):
            directions, anchors = state.directions.copy(), state.anchors.copy()
            for k in np.unique(each.lines):
                points = _points_of(state, each.points[each.lines == k])
                anchors[k] = points.mean(axis=0)
                directions[k] = np.linalg.svd(points - anchors[k])[2][0]
            state = replace(state, directions=directions, anchors=anchors)
    return state


def _points_of(state: State, numbers: Array) -> Array:
    return np.asarray(state.points[numbers])
