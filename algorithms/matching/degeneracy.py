"""Which freedoms the features of a scan leave open, whatever they are matched with (MATH 5.1).

The features may leave a motion open because the geometry does (parallel pipes, one plane), or because points are too
sparse or too noisy to show the planes that are there. What became no feature tells the two apart: where surface stands
across the open motion, or where most points lie on no feature at all, more is there than was found.
"""

import numpy as np

from algorithms.arrays import Array
from algorithms.errors import DegenerateGeometryError, TooFewFeaturesError
from algorithms.features.scan_features import ScanFeatures

PARALLEL_SINE = 0.1
"""Directions within 6 degrees count as one: what differs less fixes nothing reliably."""
ACROSS_COSINE = 0.5
"""Surface whose normal is within 60 degrees of a motion stands across it."""
UNEXPLAINED_SHARE, UNEXPLAINED_CELLS = 0.005, 4
"""Where so large a share of the surface, and so many cells, stand across an open motion and belong to no feature, it is
not the geometry that leaves it open. Single planes, pipes, corridors without ends and a lone tank showed 0.000 to 0.001
at any density and noise; houses, bridges and streets of which only the largest planes were found 0.006 and more."""
EXPLAINED_SHARE = 0.5
"""Where features hold less of the points, what they leave open says nothing of the geometry."""
RADIUS_SHARE, RADIUS_NOISES = 0.1, 3.0
"""Cells that are off the surface of a cylinder by less than this share of its radius and so many standard deviations of
the noise belong to it."""


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
        When only parallel lines, only parallel planes, only planes parallel to one direction, or only one line and
        planes across it exist.
    TooFewFeaturesError
        When so few lines and planes were found because the points are too sparse or too noisy to show more.
    """
    free = free_freedoms(features)
    if free.shape[1] == 0:
        return
    why = _why_more_must_be_there(features, free)
    if why is not None:
        raise TooFewFeaturesError(
            "planes",
            features.point_count,
            f"{which.removesuffix(' frame')} scan",
            f"{_found_in_words(features)} were found; {why}",
            "Send more points (not thinned, or of a longer scan), less noisy ones, or scan nearer to walls, floors or "
            "pipes",
        )
    rank = 6 - free.shape[1]
    raise DegenerateGeometryError(
        rank,
        [_in_words(column, which) for column in free.T],
        free,
        "Add surfaces or lines in another direction: a wall, a floor, a pipe across.",
    )


def features_in_words(features: ScanFeatures, which: str) -> str:
    """Say how many features a scan has, and in how many points.

    Parameters
    ----------
    features
        Features of one scan.
    which
        What to call the scan, e.g. "target".
    """
    return f"{which}: {_found_in_words(features)} in {features.point_count} points"


def _found_in_words(features: ScanFeatures) -> str:
    counts = {"plane": len(features.planes), "line": len(features.lines), "cylinder": len(features.cylinders)}
    parts = [f"{count} {name}{'' if count == 1 else 's'}" for name, count in counts.items()]
    return f"{', '.join(parts[:-1])} and {parts[-1]}"


def _why_more_must_be_there(features: ScanFeatures, free: Array) -> str | None:
    """Say what shows that it is not the geometry which leaves motions open; None where nothing does."""
    held = int(features.planes.point_counts.sum() + features.cylinders.point_counts.sum())
    held_share = held / max(features.point_count, 1)
    spread = (
        f"points are about {features.spacing_m:.2g} m apart, with a standard deviation of about "
        f"{features.noise_std_m * 1e3:.1f} mm"
    )
    if held_share < EXPLAINED_SHARE:
        return f"only {held_share:.0%} of the points lie on planes and cylinders ({spread})"
    across = max(int(np.count_nonzero(_stand_across(features, column))) for column in free.T)
    share = across / max(len(features.surface.points), 1)
    if across < UNEXPLAINED_CELLS or share < UNEXPLAINED_SHARE:
        return None
    return (
        f"these do not determine a pose, but {share:.1%} of the surface stands across what they leave open and was not "
        f"recognised as plane or cylinder ({spread})"
    )


def _stand_across(features: ScanFeatures, freedom: Array) -> Array:
    """Say which pieces of surface that belong to no feature stand across a motion, (k,)."""
    surface, cylinders = features.surface, features.cylinders
    off = surface.plane_labels < 0
    for anchor, direction, radius in zip(
        cylinders.axes.anchors, cylinders.axes.directions, cylinders.radii_m, strict=True
    ):
        distances = np.linalg.norm(np.cross(surface.points - anchor, direction), axis=1) - radius
        off &= np.abs(distances) > RADIUS_SHARE * radius + RADIUS_NOISES * features.noise_std_m
    centre = surface.points.mean(axis=0) if len(surface.points) else np.zeros(3)
    moved = np.cross(freedom[:3], surface.points - centre) + freedom[3:]
    lengths = np.maximum(np.linalg.norm(moved, axis=1), 1e-9)
    return np.asarray(off & (np.abs(np.einsum("ij,ij->i", surface.normals, moved)) > ACROSS_COSINE * lengths))


def free_freedoms(features: ScanFeatures) -> Array:
    """Give the motions that change no line and no plane of the scan, (6, k): columns (rotation vector, translation).

    Rotations are about axes through the features' centre, given in the scan's reduced frame.
    """
    lines, normals = features.lines.directions, features.planes.normals
    shifts = _null_directions(lines, normals)
    columns = [np.concatenate([np.zeros(3), shift]) for shift in shifts.T]
    turns = _free_turns(lines, normals, features.lines.anchors)
    columns += [np.concatenate([turn, np.zeros(3)]) for turn in turns]
    return np.array(columns).reshape(-1, 6).T


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
    """Find the axes about which a turn changes nothing: the common normal of planes, the only line, or both in one."""
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
