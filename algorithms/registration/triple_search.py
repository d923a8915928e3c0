"""Which planes of two scans are the same, told by triples of them (Dold, Ripperda and Brenner 2007, section 2.3)."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array
from algorithms.errors import TooFewCorrespondencesError
from algorithms.features.scan_features import ScanFeatures
from algorithms.registration.plane_agreement import Agreement, LargePlanes, agreement_near
from algorithms.registration.plane_pairs_pose import PlanePairsPose
from algorithms.registration.planes_triples import TripleOptions
from algorithms.scans.pose_scores import score_poses, strict_limits

KEPT_POSES = 40
"""So many distinct poses, the best by planes that agree, are refined and compared."""
SAME_RAD, SAME_M = np.radians(2.0), 0.4
"""Poses nearer to each other than this are one."""
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

    fewest = min(len(target.planes), len(source.planes))
    if fewest < 3:
        raise TooFewCorrespondencesError(fewest, 3, "planes")
    planes = [LargePlanes.of(features.planes, options.max_planes, options.max_gap_m) for features in (target, source)]
    triples = [_triples(each.planes.normals, options) for each in planes]
    limits = np.array(
        [np.cos(options.max_angle_rad), options.max_distance_m, options.max_cosine_difference, options.max_shift_m,
         SAME_RAD, SAME_M]
    )  # fmt: skip
    rotations, shifts, scores = np.zeros((KEPT_POSES, 3, 3)), np.zeros((KEPT_POSES, 3)), np.zeros(KEPT_POSES)
    counted = 0
    if min(len(each[0]) for each in triples):
        counted = kernels.search(
            planes[0].rows, planes[1].rows, triples[0][0], triples[1][0], triples[0][1], triples[1][1], limits,
            options.max_poses, rotations, shifts, scores,
        )  # fmt: skip
    candidates = [
        candidate
        for k in np.argsort(-scores, kind="stable").tolist()
        if scores[k] > 0
        for candidate in [agreement_near(planes[0], planes[1], rotations[k], shifts[k], limits)]
        if candidate is not None
    ]
    if not candidates:
        raise TooFewCorrespondencesError(3 if counted else 0, 4, "planes that agree")
    best = _best(target, source, candidates)
    others = [each.count for each in candidates if _differ(each, candidates[best], planes[1].centre_m)]
    return TripleMatch(candidates[best].estimate, candidates[best].count, max(others, default=0), counted)


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


def _best(target: ScanFeatures, source: ScanFeatures, candidates: list[Agreement]) -> int:
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
    counts = np.array([each.count for each in candidates], dtype=np.float64)
    return int(np.lexsort((-counts, -scores.score))[0])


def _differ(first: Agreement, second: Agreement, centre: Array) -> bool:
    a, b = (each.estimate.pose.target_from_source for each in (first, second))
    turned = (a.rotation * b.rotation.inv()).magnitude() > SAME_RAD
    return bool(turned or np.linalg.norm(a.apply(centre) - b.apply(centre)) > SAME_M)
