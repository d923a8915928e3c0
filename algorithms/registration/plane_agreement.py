"""Planes of two scans that agree in a pose, and the pose that they agree in best."""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, Indices, OtherIndexPairs, Scalars, Vector3
from algorithms.geometry.planes import Planes
from algorithms.registration.plane_pairs_pose import PlanePairsPose, pose_of_plane_pairs

NARROWING = (1.0, 1.0, 0.5, 0.3, 0.2, 0.2)
"""Rounds in which the planes that agree are found anew, each within so much of the limits."""
LEAST_PAIRS = 4
"""Three pairs of planes agree in some pose, whatever they are."""


@dataclass(frozen=True, eq=False)
class LargePlanes:
    """The largest planes of a scan, as the search compares them."""

    planes: Planes
    centre_m: Vector3
    """(3,) what the rows are relative to [m]."""
    rows: Array
    """(n, 8) normal, centroid, how far it reaches, and offset of each plane."""

    @staticmethod
    def of(every: Planes, most: int, gap_m: float) -> "LargePlanes":
        """Take the largest planes of a scan, at least one.

        Parameters
        ----------
        every
            All planes of the scan.
        most
            So many at most.
        gap_m
            Planes of two scans may be so far apart from rim to rim and still be pieces of one [m].
        """
        which: Indices = np.argsort(-every.areas_m2, kind="stable")[:most].astype(np.int64)
        planes = every.without_boundaries(which)
        centre = planes.centroids.mean(axis=0)
        centroids = planes.centroids - centre
        offsets = np.einsum("ij,ij->i", planes.normals, centroids)
        reach = _radii(every, which) + 0.5 * gap_m
        return LargePlanes(planes, centre, np.column_stack([planes.normals, centroids, reach, offsets]))

    def __len__(self) -> int:
        return len(self.rows)


@dataclass(frozen=True, eq=False)
class Agreement:
    """The pose in which planes agree."""

    estimate: PlanePairsPose
    count: int
    """Source planes that agreed in one of the rounds."""


def agreement_near(
    target: LargePlanes, source: LargePlanes, rotation: Array, shift: Array, limits: Array
) -> Agreement | None:
    """Estimate by all planes that agree, find these anew within narrower limits, and so on; None if too few agree.

    Parameters
    ----------
    target, source
        Planes of both scans.
    rotation, shift
        (3, 3), (3,) pose between the frames at their centres.
    limits
        Cosine of the largest angle and largest distance [m] in the first round; more is not looked at.
    """
    found: Agreement | None = None
    count = 0
    for share in NARROWING:
        narrowed = np.array([np.cos(share * np.arccos(limits[0])), share * limits[1]])
        pairs = _agreeing(target, source, rotation, shift, narrowed)
        if len(pairs) < LEAST_PAIRS:
            return found
        estimate = pose_of_plane_pairs(target.planes, source.planes, pairs)
        if estimate is None:
            return found
        count = max(count, len(pairs))
        found = Agreement(estimate, count)
        pose = estimate.pose.target_from_source
        rotation = np.ascontiguousarray(pose.rotation.as_matrix())
        shift = pose.apply(source.centre_m) - target.centre_m
    return found


def _agreeing(
    target: LargePlanes, source: LargePlanes, rotation: Array, shift: Array, limits: Array
) -> OtherIndexPairs:
    from algorithms.registration import triple_search_kernels as kernels

    partners = np.empty(len(source), dtype=np.int64)
    kernels.agreeing(
        np.ascontiguousarray(rotation), np.ascontiguousarray(shift), target.rows, source.rows, limits, 0, partners
    )
    matched = np.flatnonzero(partners >= 0)
    return np.stack([partners[matched], matched], axis=1)


def _radii(planes: Planes, which: Indices) -> Scalars:
    """Give how far each plane reaches from its centroid [m]."""
    return np.array([float(np.linalg.norm(planes.boundary_of(k), axis=1).max(initial=0.0)) for k in which.tolist()])
