"""Photos of a station that gave nothing, in words."""

import numpy as np

from algorithms.features.mount_test import WHAT_TO_CHECK
from algorithms.features.photo_lines.misstated_mounts import reading_in_words
from algorithms.features.scan_features import ScanFeatures

ENOUGH_SEGMENTS = 20
"""Of so many straight edges in a photo some lie on surface that the scan shows, where its camera stands as stated."""
FEW_LINES = 0.02
"""Share of the edges that give a line in space, below which a photo hardly looks at what was scanned."""


def photos_without_lines(features: ScanFeatures) -> list[str]:
    """Name the photos of a station that do not fit its scan as their poses were stated.

    Those of which nothing is found again in the scan, but would be if the pose were meant otherwise; and those of whose
    edges none, or hardly any, could be carried into space.

    Parameters
    ----------
    features
        Of the station. Photos count from 1, as the pictures among the results do.
    """
    edges = features.photo_edges
    if edges is None:
        return []
    segments, lines = edges.segment_counts, edges.projected_counts
    empty = (segments >= ENOUGH_SEGMENTS) & (lines <= FEW_LINES * segments)
    none = np.tile([-1, 0], (len(segments), 1))
    readings = none if edges.other_readings is None else edges.other_readings
    misstated = readings[:, 0] >= 0
    named = [
        f"no line of photo {q + 1} is found again in the scan as its camera's pose was stated, but "
        f"{readings[q, 1]} are with {reading_in_words(int(readings[q, 0]))}"
        for q in np.flatnonzero(misstated).tolist()
    ]
    return named + [
        f"of {segments[q]} straight edges in photo {q + 1} "
        f"{'none' if lines[q] == 0 else f'only {lines[q]}'} could be carried into space: {WHAT_TO_CHECK}"
        for q in np.flatnonzero(empty & ~misstated).tolist()
    ]
