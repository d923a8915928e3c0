"""The work of the method `egi`: rotations from sphere images, shifts from offsets of planes, and the estimate."""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.line_estimate import EstimatorStep
from algorithms.arrays import Array, Indices, OtherIndexPairs, Scalars
from algorithms.closest_points.motions import best_rotation
from algorithms.distributions.levelling import levelling
from algorithms.errors import TooFewCorrespondencesError
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.planes import Planes
from algorithms.geometry.poses import PoseEstimate
from algorithms.matching.coarse_registration import CoarseRegistration
from algorithms.matching.plane_triples import offset_votes_at, plane_motions
from algorithms.matching.votes import Motions
from algorithms.progress import Progress
from algorithms.registration.base import PairResult, RegistrationProblem
from algorithms.registration.egi import EgiMethod, SphereOptions, TurnAxes
from algorithms.registration.plane_agreement import Agreement, LargePlanes, agreement_near
from algorithms.registration.proposals import PoseProposal, ProposingProcedure, register_by_proposal
from algorithms.scans.pose_scores import PoseScores, score_poses, strict_limits
from algorithms.scans.surface_index import EvidenceLimits
from algorithms.sphere_images.gaussian_image import Directions
from algorithms.sphere_images.rotation_search import RotationPeaks, rotation_peaks

LABEL = "Extended Gaussian images (Horn 1984; Dold, Ripperda and Brenner 2007), shift from offsets of planes"
LEAST_PLANES = 3
SIFT_POINTS, TEST_POINTS, FINALISTS = 300, 3000, 60
"""Surface points of the first and of the last comparison of shifts, and how many come to the last."""
SIFT_M = 0.5
"""Surface so near counts in the first comparison: rotations are known to a cell of the sphere only."""
MOST_PLANES, GAP_M = 100, 20.0
"""Planes that complete the pose: the largest, and how far they may be apart from rim to rim [m]."""
ROUNDS = 3
"""Of directions that are paired anew in the better rotation."""


def register_by_spheres(problem: RegistrationProblem, method: EgiMethod, progress: Progress) -> PairResult:
    """Register two scans by sphere images; every failure becomes a result with its status and reasons.

    Parameters
    ----------
    problem
        Features of both scans.
    method
        Options.
    progress
        Is told the steps.
    """

    def propose(problem: RegistrationProblem, _search: CoarseRegistration) -> PoseProposal:
        return proposed_by_spheres(problem, method.sphere)

    procedure = ProposingProcedure(LABEL, method.matching, method.adjustment, method.surfaces, propose)
    return register_by_proposal(problem, procedure, progress)


def proposed_by_spheres(problem: RegistrationProblem, options: SphereOptions) -> PoseProposal:
    """Find the rotation in which the sphere images are alike, and the shift that goes with it.

    Parameters
    ----------
    problem
        Features of both scans.
    options
        Of the search.

    Raises
    ------
    TooFewCorrespondencesError
        When a scan has too few planes, or no shift follows from their offsets.
    """
    target, source = problem.target, problem.source
    fewest = min(len(target.planes), len(source.planes))
    if fewest < LEAST_PLANES:
        raise TooFewCorrespondencesError(fewest, LEAST_PLANES, "planes")
    about_vertical = options.axes is TurnAxes.VERTICAL
    levels = [levelling(each) if about_vertical else Rotation.identity() for each in (target, source)]
    ours, theirs = (_directions(each.planes, level) for each, level in zip((target, source), levels, strict=True))
    peaks = rotation_peaks(
        ours, theirs, finest_level=options.finest_level, about_vertical=about_vertical, most=options.max_peaks
    )
    rotations = np.array(
        [_between_cells(each, ours, theirs, peaks.width_rad, about_vertical=about_vertical) for each in peaks.rotations]
    )
    rotations = levels[0].inv().as_matrix() @ rotations @ levels[1].as_matrix()
    motions = plane_motions(offset_votes_at(rotations, target, source))
    if len(motions) == 0:
        raise TooFewCorrespondencesError(0, 3, "directions of planes whose offsets fix a shift")
    rotation, shift, score = _best_motion(motions, target, source)
    peak = int(np.argmax(np.einsum("hij,ij->h", rotations, rotation)))
    remarks = _remarks(peaks, peak, options, len(motions), score)
    found = _by_planes(target, source, rotation, shift, 2.0 * peaks.width_rad)
    rotating = EstimatorStep(
        "rotation", len(theirs.normals), 1 if about_vertical else 3, None, ROUNDS, 0.0, converged=True
    )
    if found is None:
        std_rad = peaks.width_rad / np.sqrt(12.0)
        covariance = np.diag([std_rad**2] * 3 + [SIFT_M**2 / 12.0] * 3)
        pose = PoseEstimate(RigidTransform.from_components(shift, Rotation.from_matrix(rotation)), covariance)
        return PoseProposal(pose, (rotating,), (*remarks, "too few planes agree to complete the pose by them"))
    estimate = found.estimate
    pairs = len(estimate.pairs)
    completing = EstimatorStep("shift and small turns", 3 * pairs, 6, estimate.sigma0, 1, 0.0, converged=True)
    completed = (
        f"completed by {pairs} planes that agree to {1e3 * estimate.offset_rms_m:.0f} mm and "
        f"{1e3 * estimate.angle_rms_rad:.2f} mrad (rms)"
    )
    return PoseProposal(estimate.pose, (rotating, completing), (*remarks, completed))


def _by_planes(
    target: ScanFeatures, source: ScanFeatures, rotation: Array, shift: Array, turn_rad: float
) -> Agreement | None:
    """Complete a rotation that is known to a cell, and a shift that is known to half a metre, by planes that agree."""
    ours, theirs = (LargePlanes.of(features.planes, MOST_PLANES, GAP_M) for features in (target, source))
    between = rotation @ theirs.centre_m + shift - ours.centre_m
    return agreement_near(ours, theirs, rotation, between, np.array([np.cos(turn_rad), SIFT_M]))


def _remarks(peaks: RotationPeaks, peak: int, options: SphereOptions, shifts: int, score: float) -> tuple[str, ...]:
    """Say how clear the rotation is."""
    correlations = peaks.correlations / max(float(peaks.correlations[0]), 1e-12)
    like = int(np.count_nonzero(correlations >= options.ambiguity_ratio)) - 1
    cell = np.degrees(peaks.width_rad)
    words = [
        (
            f"cells of {cell:.1f} degrees; the rotation taken is number {peak + 1} by correlation "
            f"({correlations[peak]:.0%} of the highest); of {shifts} shifts the best lays {score:.0%} of all on surface"
        )
    ]
    if like > 0:
        words.append(
            f"the spheres alone are ambiguous: {like} other rotation{'s have' if like > 1 else ' has'} at least "
            f"{options.ambiguity_ratio:.0%} of the highest correlation"
        )
    return tuple(words)


def _directions(planes: Planes, level: Rotation) -> Directions:
    """Weigh normals by the root of the area: a front counts more than a sill, but not as much as all the rest."""
    return Directions(level.apply(planes.normals), np.sqrt(planes.areas_m2))


def _between_cells(
    rotation: Array, ours: Directions, theirs: Directions, width_rad: float, *, about_vertical: bool
) -> Array:
    """Turn to where directions meet directions, finer than the cells."""
    for _ in range(ROUNDS):
        moved = theirs.normals @ rotation.T
        cosines = moved @ ours.normals.T
        nearest: Indices = np.argmax(cosines, axis=1)
        near = cosines[np.arange(len(moved)), nearest] > np.cos(2.0 * width_rad)
        pairs: OtherIndexPairs = np.stack([nearest[near], np.flatnonzero(near)], axis=1)
        if len(pairs) < LEAST_PLANES:
            return rotation
        weights: Scalars = np.minimum(ours.weights[pairs[:, 0]], theirs.weights[pairs[:, 1]])
        t, s = ours.normals[pairs[:, 0]], theirs.normals[pairs[:, 1]]
        if about_vertical:
            cross = float(weights @ (s[:, 0] * t[:, 1] - s[:, 1] * t[:, 0]))
            rotation = Rotation.from_euler(
                "z", np.arctan2(cross, float(weights @ (s[:, :2] * t[:, :2]).sum(1)))
            ).as_matrix()
        else:
            rotation = best_rotation(t, s, weights).as_matrix()
    return rotation


def _best_motion(motions: Motions, target: ScanFeatures, source: ScanFeatures) -> tuple[Array, Array, float]:
    """Choose the motion that lays most surface on surface and least into space that was seen through."""
    spacing = max(target.index.spacing_m, source.index.spacing_m)
    wide = EvidenceLimits(SIFT_M, np.radians(20.0), 2.5 * spacing)
    first = _scored(motions.rotations, motions.translations_m, target, source, SIFT_POINTS, wide, sifting=True)
    best = np.argsort(-first.score, kind="stable")[:FINALISTS]
    narrow = strict_limits(max(target.noise_std_m, source.noise_std_m), spacing)
    rotations, translations = motions.rotations[best], motions.translations_m[best]
    limits = EvidenceLimits(2.0 * narrow.max_distance_m, narrow.max_angle_rad, narrow.reach_m)
    last = _scored(rotations, translations, target, source, TEST_POINTS, limits, sifting=False)
    k = int(np.argmax(last.score))
    return rotations[k], translations[k], float(last.support[k])


def _scored(
    rotations: Array,
    translations: Array,
    target: ScanFeatures,
    source: ScanFeatures,
    points: int,
    limits: EvidenceLimits,
    *,
    sifting: bool,
) -> PoseScores:
    return score_poses(
        np.ascontiguousarray(rotations), np.ascontiguousarray(translations), target.index, source.index,
        points=points, limits=limits, sifting=sifting,
    )  # fmt: skip
