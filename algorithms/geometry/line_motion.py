"""Moving lines by a rigid motion, and finding the motion from matched lines in closed form (MATH 1.6, 1.8)."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Scalars, Vector3
from algorithms.errors import TooFewCorrespondencesError
from algorithms.geometry.line_pairs_geometry import LinePairs, line_pairs_of, motions_between_pairs
from algorithms.geometry.lines import Lines
from algorithms.geometry.rotations import rotation_between_directions

NEARLY_PARALLEL_SINE = 0.02
"""Start values treat lines as one direction when no two of them differ by more than this sine (1.3 gon)."""


def moved_lines(lines: Lines, target_from_source: RigidTransform) -> Lines:
    """Carry lines into another frame.

    The bases are rotated along, so that the covariances of (a1, a2, b1, b2) and the dependence on the parent planes
    stay as they are.

    Parameters
    ----------
    lines
        Lines in the source frame.
    target_from_source
        Rigid motion.
    """
    rotation = target_from_source.rotation.as_matrix()
    return replace(
        lines,
        anchors=lines.anchors @ rotation.T + np.asarray(target_from_source.translation),
        directions=lines.directions @ rotation.T,
        bases=rotation @ lines.bases,
    )


def lines_about(lines: Lines, origin_m: Vector3) -> Lines:
    """Give the lines relative to a local origin, to be done before any product of coordinates (MATH 3.4)."""
    return replace(lines, anchors=lines.anchors - origin_m)


def motion_from_matched_lines(target: Lines, source: Lines) -> RigidTransform:
    """Find start values of the motion from matched lines, line k to line k, without a first guess (MATH 1.8).

    The two lines with the largest angle between them give candidates for all direction signs; with the signs matched
    the rotation follows from all directions at once and the translation from a linear system over all lines. The
    candidate that leaves the smallest offsets wins. Exact for error-free lines. Two lines alone leave a half turn about
    their common perpendicular open, and parallel lines the shift along them: one of the answers is given then.

    Parameters
    ----------
    target, source
        n >= 2 matched lines each; signs of directions need not agree.

    Raises
    ------
    TooFewCorrespondencesError
        With fewer than two lines.
    """
    n = len(target)
    if n < 2:
        raise TooFewCorrespondencesError(n, 2)
    sines = np.linalg.norm(np.cross(source.directions[:, None, :], source.directions[None, :, :]), axis=2)
    i, j = np.unravel_index(int(np.argmax(sines)), sines.shape)
    if sines[i, j] < NEARLY_PARALLEL_SINE:
        candidates = _rotations_of_parallel_lines(target, source)
    else:
        pair = np.array([[i, j]], dtype=np.int64)
        candidates = _rotations_of_pair(line_pairs_of(target, pair), line_pairs_of(source, pair))
    solutions = [_refined(target, source, rotation) for rotation in candidates]
    return min(solutions, key=lambda solution: solution[1])[0]


def matched_signs(target: Lines, source: Lines, rotation: Rotation) -> Scalars:
    """Give for each matched line +1 or -1, the sign of (R d_source).d_target."""
    cosines = np.einsum("ij,ij->i", rotation.apply(source.directions), target.directions)
    return np.where(cosines < 0.0, -1.0, 1.0)


def _rotations_of_pair(target: LinePairs, source: LinePairs) -> list[Rotation]:
    """Give the rotations of the four assignments that keep A on A."""
    return [Rotation.from_matrix(matrix) for matrix in motions_between_pairs(target, source).rotations[0, :4]]


def _rotations_of_parallel_lines(target: Lines, source: Lines) -> list[Rotation]:
    """Give two rotations of a parallel bundle, one for each sense: axis from directions, turn from the places."""
    axes, places = [], []
    for lines in (source, target):
        axis = np.linalg.svd(lines.directions)[2][0]
        centred = lines.anchors - lines.anchors.mean(axis=0)
        feet = centred - np.outer(centred @ axis, axis)
        places.append(feet - feet.mean(axis=0))
        axes.append(axis)
    weight = max(float(np.linalg.norm(places[0])), 1.0)  # the axis weighs as much as all places together
    return [
        rotation_between_directions(
            np.vstack([sense * weight * axes[0], places[0]]), np.vstack([weight * axes[1], places[1]])
        )
        for sense in (1.0, -1.0)
    ]


def _refined(target: Lines, source: Lines, rotation: Rotation) -> tuple[RigidTransform, float]:
    """Improve a candidate over all lines; give it with its cost (offsets relative to the spread, and tilts)."""
    signed = source.directions * matched_signs(target, source, rotation)[:, None]
    spread = np.linalg.svd(signed, compute_uv=False)[1]
    if spread >= NEARLY_PARALLEL_SINE:
        rotation = rotation_between_directions(signed, target.directions)
    gaps = target.anchors - rotation.apply(source.anchors)
    projections = np.swapaxes(target.bases, 1, 2)
    system = projections.reshape(-1, 3)
    right_side = np.einsum("nij,nj->ni", projections, gaps).reshape(-1)
    translation = np.linalg.lstsq(system, right_side)[0]
    size = max(float(np.sqrt(((target.anchors - target.anchors.mean(axis=0)) ** 2).sum(axis=1).mean())), 1e-3)
    offsets = (right_side - system @ translation) / size
    tilts = np.einsum("nij,nj->ni", projections, rotation.apply(signed))
    cost = float(offsets @ offsets + (tilts**2).sum())
    return RigidTransform.from_components(translation, rotation), cost
