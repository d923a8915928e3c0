"""Which freedoms the features of a scan leave open, whatever they are matched with (MATH 5.1)."""

import numpy as np

from algorithms.arrays import Array
from algorithms.errors import DegenerateGeometryError
from algorithms.features.scan_features import ScanFeatures

PARALLEL_SINE = 0.1
"""Directions within 6 degrees count as one: what differs less fixes nothing reliably."""


def require_determining_geometry(features: ScanFeatures, which: str) -> None:
    """Refuse a scan whose lines and planes cannot determine a pose.

    Parameters
    ----------
    features
        Features of one scan.
    which
        What to call the scan in the message, e.g. "target scan".

    Raises
    ------
    DegenerateGeometryError
        When only parallel lines, only parallel planes, or only planes parallel to one direction exist.
    """
    free = free_freedoms(features)
    if free.shape[1] == 0:
        return
    rank = 6 - free.shape[1]
    raise DegenerateGeometryError(
        rank,
        [_in_words(column, which) for column in free.T],
        free,
        "Add surfaces or lines in another direction: a wall, a floor, a pipe across.",
    )


def free_freedoms(features: ScanFeatures) -> Array:
    """Give the motions that change no line and no plane of the scan, (6, k): columns (rotation vector, translation).

    Rotations are about axes through the features' centre, given in the scan's reduced frame.
    """
    lines, normals = features.lines.directions, features.planes.normals
    shifts = _null_directions(lines, normals)
    if shifts.shape[1] == 0:
        return np.empty((6, 0))
    columns = [np.concatenate([np.zeros(3), shift]) for shift in shifts.T]
    turns = _free_turns(lines, normals, features.lines.anchors)
    columns += [np.concatenate([turn, np.zeros(3)]) for turn in turns]
    return np.array(columns).T


def _null_directions(lines: Array, normals: Array) -> Array:
    """Find the directions of shift that no feature resists: a line resists across itself, a plane along its normal."""
    rows = [np.eye(3) - np.outer(d, d) for d in lines] + [n[None] for n in normals]
    if not rows:
        return np.eye(3)
    values, vectors = np.linalg.eigh(sum(row.T @ row for row in rows))
    # A feature tilted by a hardly resists with sin^2 a; the best of all counts, not their sum.
    free = []
    for k in range(3):
        v = vectors[:, k]
        resistance = max(float(np.linalg.norm(row @ v)) for row in rows)
        if resistance < PARALLEL_SINE or values[k] < 1e-12:
            free.append(v)
    return np.array(free).reshape(-1, 3).T


def _free_turns(lines: Array, normals: Array, anchors: Array) -> list[Array]:
    """Find the axes about which a turn changes nothing: the common normal of planes, or the only line."""
    directions = np.vstack([lines, normals])
    if len(directions) == 0:
        return list(np.eye(3))
    axis = np.linalg.svd(directions)[2][0]
    if np.linalg.norm(np.cross(directions, axis), axis=1).max() >= PARALLEL_SINE:
        return []
    if len(lines) >= 2:
        relative = anchors - anchors[0]
        if np.linalg.norm(relative - np.outer(relative @ axis, axis), axis=1).max() > PARALLEL_SINE:
            return []  # parallel lines side by side resist a turn about their direction
    return [axis]


def _in_words(freedom: Array, which: str) -> str:
    """Name one column of the null space."""
    turn = np.linalg.norm(freedom[:3]) > 0.5
    vector = freedom[:3] if turn else freedom[3:]
    vector = vector * (1.0 if vector[np.argmax(np.abs(vector))] > 0.0 else -1.0)
    kind = "rotation about" if turn else "translation along"
    return f"{kind} ({vector[0]:.2f}, {vector[1]:.2f}, {vector[2]:.2f}) of the {which}"
