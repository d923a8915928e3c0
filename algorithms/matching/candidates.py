"""Motions that lines and planes of two scans propose, before any of them is tested."""

import numpy as np

from algorithms.features.scan_features import ScanFeatures
from algorithms.matching.line_pairs import MAX_LINES, line_pair_motions
from algorithms.matching.options import MatchingOptions
from algorithms.matching.parallel_axes import parallel_axis_motions
from algorithms.matching.plane_triples import offset_votes, plane_motions
from algorithms.matching.sliding import sliding_motions
from algorithms.matching.votes import Motions, joined, vote_motions
from algorithms.scans.point_blocks import side_by_side

VOTE_RADIUS_RAD = 0.07
MOST_ROTATIONS = 200


def candidate_motions(
    target: ScanFeatures,
    source: ScanFeatures,
    options: MatchingOptions,
    *,
    max_lines: int = MAX_LINES,
    max_plane_hypotheses: int | None = None,
    sliding: bool = True,
) -> Motions:
    """Let pairs of lines that look alike vote for motions, and planes and surfaces propose more (MATH 1.7, 5.5).

    Parameters
    ----------
    target, source
        Features of the two scans; both with surface points.
    options
        Limits.
    max_lines
        So many of the longest lines form pairs.
    max_plane_hypotheses
        So many of the motions that planes propose, those with most votes; None: all.
    sliding
        Also look for the place along a direction of which the planes say nothing, surface by surface.
    """

    def by_lines() -> Motions:
        motions = line_pair_motions(
            target,
            source,
            max_angle_rad=options.max_angle_rad,
            max_distance_m=options.max_distance_m,
            max_lines=max_lines,
        )
        return vote_motions(
            motions,
            source.index.centre_m,
            radius_rad=VOTE_RADIUS_RAD,
            radius_m=2.0 * options.max_distance_m,
            most_rotations=MOST_ROTATIONS,
            most=options.max_line_hypotheses,
        )

    def by_planes_and_surfaces() -> tuple[Motions, Motions]:
        votes = offset_votes(target, source, max_angle_rad=options.max_angle_rad)
        by_planes = plane_motions(votes)
        if max_plane_hypotheses is not None:
            by_planes = by_planes[np.argsort(-by_planes.votes, kind="stable")[:max_plane_hypotheses]]
        return by_planes, sliding_motions(votes, target.index, source.index) if sliding else Motions.empty()

    voted, (by_planes, by_surfaces) = side_by_side(by_lines, by_planes_and_surfaces)
    by_axes = parallel_axis_motions(
        target, source, max_angle_rad=options.max_angle_rad, max_distance_m=options.max_distance_m
    )
    return joined([voted, by_planes, by_axes, by_surfaces])
