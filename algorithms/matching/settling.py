"""Settle many poses of two scans, surface on surface, before they are compared."""

from collections.abc import Sequence

import numpy as np

from algorithms.arrays import Array
from algorithms.matching.votes import Motions, nearest_rotations
from algorithms.scans.point_blocks import over_blocks
from algorithms.scans.surface_index import EvidenceLimits, SurfaceIndex

ANGLE_RAD = np.radians(25.0)
LEAST_BLOCK = 5
"""Fewer poses are not worth a thread of their own."""
ROUNDS = 4
"""Most steps of each stage."""


def settled(
    motions: Motions, target: SurfaceIndex, source: SurfaceIndex, *, distances_m: Sequence[float], points: int
) -> Motions:
    """Move the source in each pose so that its surface and the target's lie in each other (point to plane).

    Parameters
    ----------
    motions
        Target from source, good to about the first of `distances_m`.
    target, source
        The two scans.
    distances_m
        Largest distances of corresponding surface, one stage each, falling [m].
    points
        How many surface points of each scan to use.

    Returns
    -------
    The improved poses with their votes; where too little fits they stay. What the surfaces do not fix stays too.
    """
    from algorithms.matching import settling_kernels as kernels

    reach = 2.5 * max(target.spacing_m, source.spacing_m)
    limits = np.array([EvidenceLimits(distance, ANGLE_RAD, reach).as_array() for distance in distances_m])
    rotations = np.array(motions.rotations, dtype=np.float64, order="C")
    translations = np.array(motions.translations_m, dtype=np.float64, order="C")
    ours, theirs = _arrays(target, points), _arrays(source, points)

    def settle(start: int, end: int) -> None:
        kernels.settle(rotations[start:end], translations[start:end], ours, theirs, limits, ROUNDS)

    over_blocks(settle, len(rotations), least=LEAST_BLOCK)
    return Motions(nearest_rotations(rotations), translations, motions.votes)


def _arrays(scan: SurfaceIndex, points: int) -> tuple[Array | float, ...]:
    """Give a scan in the order the compiled loops expect."""
    return (
        np.ascontiguousarray(scan.points[:points].T), scan.normals[:points], scan.weights[:points], scan.points,
        scan.normals, scan.owner, scan.low_m, scan.cell_m,
    )  # fmt: skip
