"""Poses that the building's own symmetry proposes beside one that was found."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.features.scan_features import ScanFeatures, Symmetries
from algorithms.matching.candidates import candidate_motions
from algorithms.matching.hypotheses import rank_hypotheses
from algorithms.matching.options import MatchingOptions
from algorithms.matching.self_likeness import SELF_CONTRADICTED, SELF_SUPPORT, Contradiction
from algorithms.matching.votes import Motions, motions_of

MAX_LINES, MOST_HYPOTHESES, MOST_POLISHED = 60, 2000, 16
"""Of so many lines pairs are formed, so many motions of a scan onto itself that lines and that planes propose are
tested, and so many looked at closely."""
SIFTS = ((64, 1000), (200, 150))
"""Surface points of the scan, and how many motions go on: a third of what two scans need, for of so few directions a
building looks like itself. With all, the same motions were found in 290 scans but for 2 of 1625 (and 4 others)."""
LEAST_TURN_RAD, LEAST_SHIFT_M = np.radians(4.5), 0.3
"""A smaller motion is none."""


def poses_by_symmetry(
    target: ScanFeatures, source: ScanFeatures, pose: RigidTransform, options: MatchingOptions
) -> Motions:
    """Look for motions that lay a scan onto itself, and apply them to a pose.

    Where a bridge looks the same from both banks, the scans of its two sides lie on each other almost perfectly,
    turned by half a circle. The right pose has little overlap and may never be proposed by pairs of lines; but each
    scan knows the half turn by which the bridge is like itself.

    Parameters
    ----------
    target, source
        Features of the two scans.
    pose
        Target from source.
    options
        Limits of the search.

    Returns
    -------
    Poses target from source, with one vote each; empty where no scan is like itself.
    """
    found = [motion * pose for motion in _symmetries(target, options)]
    found += [pose * motion for motion in _symmetries(source, options)]
    return motions_of(found)


def with_symmetries(scan: ScanFeatures, options: MatchingOptions) -> ScanFeatures:
    """Find the motions that lay a scan onto itself once for all pairs that it will be part of (a third of a second).

    Parameters
    ----------
    scan
        Features of a scan.
    options
        Limits of the search; pairs that are matched with others look for themselves.
    """
    found = _found_symmetries(scan, options) if len(scan.index.points) else []
    motions = np.array([motion.as_matrix() for motion in found]).reshape(-1, 4, 4)
    return replace(scan, symmetries=Symmetries(motions, options.max_angle_rad, options.max_distance_m))


def _symmetries(scan: ScanFeatures, options: MatchingOptions) -> list[RigidTransform]:
    """Give the motions that lay a scan onto itself without contradiction."""
    known = scan.symmetries
    if known is None or (known.max_angle_rad, known.max_distance_m) != (options.max_angle_rad, options.max_distance_m):
        return _found_symmetries(scan, options)
    return [RigidTransform.from_matrix(motion) for motion in known.motions]


def _found_symmetries(scan: ScanFeatures, options: MatchingOptions) -> list[RigidTransform]:
    """Find the motions that lay a scan onto itself without contradiction."""
    motions = candidate_motions(
        scan,
        scan,
        replace(options, max_line_hypotheses=MOST_HYPOTHESES),
        max_lines=MAX_LINES,
        max_plane_hypotheses=MOST_HYPOTHESES,
        sliding=False,
    )
    motions = motions[_moves(motions, scan)]
    if len(motions) == 0:
        return []
    ranked = rank_hypotheses(motions, scan.index, scan.index, noise_m=scan.noise_std_m, most=MOST_POLISHED, sifts=SIFTS)
    likeness = [
        Contradiction.of(float(support), float(violation))
        for support, violation in zip(ranked.scores.support, ranked.scores.violation, strict=True)
    ]
    # polishing may have led back to where nothing moves
    moved = _moves(motions_of(ranked.poses), scan)
    return [
        pose
        for pose, like, moves in zip(ranked.poses, likeness, moved, strict=True)
        if moves and like.support >= SELF_SUPPORT and like.share <= SELF_CONTRADICTED
    ]


def _moves(motions: Motions, scan: ScanFeatures) -> np.ndarray:
    """Say which motions are clearly none of the identity."""
    centre = scan.index.centre_m
    traces = np.einsum("hii->h", motions.rotations)
    turned = np.arccos(np.clip(0.5 * (traces - 1.0), -1.0, 1.0)) > LEAST_TURN_RAD
    shifted = np.linalg.norm(motions.rotations @ centre + motions.translations_m - centre, axis=1) > LEAST_SHIFT_M
    return np.asarray(turned | shifted)
