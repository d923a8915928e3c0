"""Which planes of two scans are the same, told by triples of them (Dold, Ripperda and Brenner 2007, section 2.3)."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Indices, OtherIndexPairs, Scalars
from algorithms.errors import TooFewCorrespondencesError
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.planes import Planes
from algorithms.registration.plane_pairs_pose import PlanePairsPose, pose_of_plane_pairs
from algorithms.registration.planes_triples import TripleOptions
from algorithms.scans.pose_scores import score_poses, strict_limits

KEPT_POSES = 40
"""So many distinct poses, the best by planes that agree, are refined and compared."""
SAME_RAD, SAME_M = np.radians(2.0), 0.4
"""Poses nearer to each other than this are one."""
REFINEMENTS = 4
"""Rounds in which the planes that agree are found anew."""
TEST_POINTS = 3000
"""Surface points of each scan that say which of the best poses is right."""


@dataclass(frozen=True, eq=False)
class TripleMatch:
    """The pose that triples of planes propose."""

    estimate: PlanePairsPose
    """Pose by quaternion and least squares from all planes that agree."""
    agreeing: int
    """Source planes that agree with a target plane."""
    runner_up: int
    """The same in the best clearly different pose; 0 if there is none."""
    poses: int
    """How many poses were counted."""


@dataclass(frozen=True, eq=False)
class _Candidate:
    estimate: PlanePairsPose
    agreeing: int


def match_by_triples(target: ScanFeatures, source: ScanFeatures, options: TripleOptions) -> TripleMatch:
    """Lay triples of planes on each other, and take the pose in which most planes agree.

    Of the poses in which nearly as many agree the surfaces of the scans decide: the paper's count alone cannot tell a
    street from the same street the other way round.

    Parameters
    ----------
    target, source
        Features of both scans.
    options
        Limits.

    Raises
    ------
    TooFewCorrespondencesError
        When no three planes stand across each other, or no pose lets more than three agree.
    """
    from algorithms.registration import triple_search_kernels as kernels

    chosen = [_most_measured(features.planes, options.max_planes) for features in (target, source)]
    planes = [features.planes.without_boundaries(which) for features, which in zip((target, source), chosen, strict=True)]
    if min(len(each) for each in planes) < 3:
        raise TooFewCorrespondencesError(min(len(each) for each in planes), 3, "planes")
    centres = [each.centroids.mean(axis=0) for each in planes]
    described = [
        _described(each, _radii(features.planes, which), centre)
        for each, features, which, centre in zip(planes, (target, source), chosen, centres, strict=True)
    ]
    triples = [_triples(each.normals, options) for each in planes]
    limits = np.array(
        [np.cos(options.max_angle_rad), options.max_distance_m, options.max_cosine_difference, options.max_shift_m,
         SAME_RAD, SAME_M]
    )  # fmt: skip
    rotations, shifts, scores = np.zeros((KEPT_POSES, 3, 3)), np.zeros((KEPT_POSES, 3)), np.zeros(KEPT_POSES)
    counted = 0
    if min(len(each[0]) for each in triples):
        counted = kernels.search(
            *described, triples[0][0], triples[1][0], triples[0][1], triples[1][1], limits, options.max_poses,
            rotations, shifts, scores,
        )  # fmt: skip
    candidates = [
        candidate
        for k in np.argsort(-scores, kind="stable").tolist()
        if scores[k] > 0
        for candidate in [_refined(planes, described, centres, rotations[k], shifts[k], limits)]
        if candidate is not None
    ]
    if not candidates:
        raise TooFewCorrespondencesError(3 if counted else 0, 4, "planes that agree")
    best = _best(target, source, candidates)
    others = [each.agreeing for each in candidates if _differ(each, candidates[best], centres[1])]
    return TripleMatch(candidates[best].estimate, candidates[best].agreeing, max(others, default=0), counted)


def _most_measured(planes: Planes, most: int) -> Indices:
    return np.argsort(-planes.point_counts, kind="stable")[:most].astype(np.int64)


def _radii(planes: Planes, which: Indices) -> Scalars:
    """Give how far each plane reaches from its centroid [m]."""
    return np.array([float(np.linalg.norm(planes.boundary_of(k), axis=1).max(initial=0.0)) for k in which.tolist()])


def _described(planes: Planes, radii: Scalars, centre: Array) -> Array:
    """Put normal, centroid, radius and offset of each plane in a row, relative to a centre."""
    centroids = planes.centroids - centre
    offsets = np.einsum("ij,ij->i", planes.normals, centroids)
    return np.column_stack([planes.normals, centroids, radii, offsets])


def _triples(normals: Array, options: TripleOptions) -> tuple[Array, Array]:
    """List triples by falling triple product, each turned so that it is positive, with the cosines between them."""
    numbers = np.array(list(combinations(range(len(normals)), 3)), dtype=np.int64)
    a, b, c = (normals[numbers[:, k]] for k in range(3))
    products = np.einsum("ij,ij->i", np.cross(a, b), c)
    order = np.argsort(-np.abs(products), kind="stable")[: options.max_triples]
    order = order[np.abs(products[order]) >= options.least_product]
    numbers = np.where((products[order] < 0.0)[:, None], numbers[order][:, [0, 2, 1]], numbers[order])
    a, b, c = (normals[numbers[:, k]] for k in range(3))
    cosines = np.stack([np.einsum("ij,ij->i", x, y) for x, y in ((a, b), (b, c), (c, a))], axis=1)
    return np.ascontiguousarray(numbers), np.ascontiguousarray(cosines)


def _refined(
    planes: list[Planes], described: list[Array], centres: list[Array], rotation: Array, shift: Array, limits: Array
) -> _Candidate | None:
    """Estimate by all planes that agree, find these anew, and so on."""
    found: _Candidate | None = None
    for _ in range(REFINEMENTS):
        pairs = _agreeing(described, rotation, shift, limits)
        if len(pairs) < 4:
            return found
        estimate = pose_of_plane_pairs(planes[0], planes[1], pairs)
        if estimate is None:
            return found
        if found is not None and np.array_equal(pairs, found.estimate.pairs):
            break
        found = _Candidate(estimate, len(pairs))
        pose = estimate.pose.target_from_source
        rotation = np.ascontiguousarray(pose.rotation.as_matrix())
        shift = pose.apply(centres[1]) - centres[0]
    return found


def _agreeing(described: list[Array], rotation: Array, shift: Array, limits: Array) -> OtherIndexPairs:
    from algorithms.registration import triple_search_kernels as kernels

    partners = np.empty(len(described[1]), dtype=np.int64)
    kernels.agreeing(rotation, np.ascontiguousarray(shift), described[0], described[1], limits, 0, partners)
    matched = np.flatnonzero(partners >= 0)
    return np.stack([partners[matched], matched], axis=1)


def _best(target: ScanFeatures, source: ScanFeatures, candidates: list[_Candidate]) -> int:
    """Choose the candidate in which most surface lies on surface and least in space that was seen through."""
    poses: list[RigidTransform] = [each.estimate.pose.target_from_source for each in candidates]
    noise = max(target.noise_std_m, source.noise_std_m)
    limits = strict_limits(noise, max(target.index.spacing_m, source.index.spacing_m))
    scores = score_poses(
        np.array([pose.rotation.as_matrix() for pose in poses]),
        np.array([pose.translation for pose in poses], dtype=np.float64),
        target.index,
        source.index,
        points=TEST_POINTS,
        limits=limits,
    )
    counts = np.array([each.agreeing for each in candidates], dtype=np.float64)
    return int(np.lexsort((-counts, -scores.score))[0])


def _differ(first: _Candidate, second: _Candidate, centre: Array) -> bool:
    a, b = (each.estimate.pose.target_from_source for each in (first, second))
    turned = (a.rotation * b.rotation.inv()).magnitude() > SAME_RAD
    return bool(turned or np.linalg.norm(a.apply(centre) - b.apply(centre)) > SAME_M)
