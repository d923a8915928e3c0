"""The pose that surfaces alone would choose near another one, without what lies apart, and how well they know it."""

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Matrix6
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.poses import inversion_jacobian
from algorithms.geometry.rotations import cross_matrix
from algorithms.matching.directions import comes_first
from algorithms.matching.polish import LEAST_GAPS, polished, surface_gaps
from algorithms.numbered_rows import numbered_rows
from algorithms.scans.pose_scores import FINAL_POINTS, score_poses
from algorithms.scans.surface_index import EvidenceLimits

NOISES, LEAST_GATE_M = 6.0, 0.02
"""Surfaces this many standard deviations of the noise apart, and at least so far, are not the same: 5 cm are a piece of
furniture that was moved, not noise."""
WIDEST_GATE_M = 0.05
"""With noise that asks for a wider gate nothing is gained over the search, and its pose stands."""
AS_GOOD = 0.99
"""Share of the other pose's fitting surface with which a pose fits as well."""

NEIGHBOURHOOD_M = 0.5
"""Surface points within a cube of this edge share their errors."""
LEAST_TESTIMONY = 0.02
"""Freedoms on which the surfaces say less than this share of what they say on the best known one count as open: there
only points at the rims of surfaces speak, whose positions are averages over what lies on both sides."""
OPEN_STD_M = 10.0
"""Standard deviation of what the surfaces do not fix."""


def surface_pose_near(
    target: ScanFeatures, source: ScanFeatures, pose: RigidTransform, rival: RigidTransform
) -> RigidTransform:
    """Fit the surfaces from a pose with a narrow gate, or give the rival where that lays more surface on surface.

    The search polishes its poses with a wide gate, so that a piece that was moved by centimetres between the scans
    bends them by millimetres. With a narrow gate such a piece takes no part; but a narrow gate alone would stay
    wherever it starts, so the pose must also explain as much surface within it as its rival does.

    Parameters
    ----------
    target, source
        Features of the two scans; their thinned surfaces are used.
    pose
        Pose in question, target from source, between the reduced frames.
    rival
        Best pose of the search.
    """
    if not comes_first(target, source):
        return surface_pose_near(source, target, pose.inv(), rival.inv()).inv()
    gate = max(NOISES * max(target.noise_std_m, source.noise_std_m), LEAST_GATE_M)
    if gate > WIDEST_GATE_M:
        return rival
    indices = (target.index, source.index)
    limits = EvidenceLimits(gate, np.radians(20.0), 2.5 * max(index.spacing_m for index in indices))
    rotations = np.array([p.rotation.as_matrix() for p in (pose, rival)])
    translations = np.array([p.translation for p in (pose, rival)], dtype=np.float64)
    scores = score_poses(rotations, translations, indices[0], indices[1], points=FINAL_POINTS, limits=limits)
    if scores.support[0] < AS_GOOD * scores.support[1]:
        return rival
    return polished(pose, indices[0], indices[1], distances_m=(gate, 0.6 * gate), points=FINAL_POINTS)


def surface_pose_covariance(target: ScanFeatures, source: ScanFeatures, pose: RigidTransform) -> Matrix6:
    """Estimate how well the surfaces fix the pose in which they fit best, from their own misfits.

    Along a flat facade only the reveals of its windows say where it is, and their thinned points are all wrong to the
    same side: the misfits of one neighbourhood count as one (cluster-robust covariance N⁻¹ (Σ u uᵀ) N⁻¹ with
    u = Σ p a g over the neighbourhood). What the surfaces leave open gets a variance of `OPEN_STD_M`².

    Parameters
    ----------
    target, source
        Features of the two scans; their thinned surfaces are used.
    pose
        Pose in which the surfaces fit best, target from source, between the reduced frames.

    Returns
    -------
    (6, 6) covariance of rotation vector (left, target axes) and translation [rad, m], as of `PoseEstimate`.
    """
    if not comes_first(target, source):
        back = pose.inv()
        turn = inversion_jacobian(back)
        return np.asarray(turn @ surface_pose_covariance(source, target, back) @ turn.T)
    indices = (target.index, source.index)
    gate = max(NOISES * max(target.noise_std_m, source.noise_std_m), WIDEST_GATE_M)
    limits = EvidenceLimits(gate, np.radians(20.0), 2.5 * max(index.spacing_m for index in indices))
    found = surface_gaps(pose, indices[0], indices[1], limits, FINAL_POINTS)
    if len(found.gaps_m) < LEAST_GAPS:
        return np.eye(6) * OPEN_STD_M**2
    centre = np.average(found.positions, axis=0, weights=found.weights)
    size = max(float(np.linalg.norm(found.positions - centre, axis=1).mean()), 1e-3)
    scale = np.repeat([size, 1.0], 3)
    weighted = found.design(centre) / scale * found.weights[:, None]
    values, vectors = np.linalg.eigh(weighted.T @ (found.design(centre) / scale))
    _, cells = numbered_rows(np.floor(found.positions / NEIGHBOURHOOD_M).astype(np.int64))
    sums = np.stack([np.bincount(cells, each * found.gaps_m) for each in weighted.T], axis=1)
    known = values > LEAST_TESTIMONY * values[-1]
    parts = (sums @ vectors)[:, known] / values[known]
    scaled = vectors[:, known] @ (parts.T @ parts) @ vectors[:, known].T
    scaled += vectors[:, ~known] @ vectors[:, ~known].T * OPEN_STD_M**2
    at_centre = scaled / np.outer(scale, scale)
    # where the centre goes to is w x (centre - t) + dt
    to_translation = np.eye(6)
    to_translation[3:, :3] = cross_matrix(centre - np.asarray(pose.translation))
    return np.asarray(to_translation @ at_centre @ to_translation.T)
