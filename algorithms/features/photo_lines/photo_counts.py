"""Photos of a station that gave nothing, in words."""

import numpy as np

from algorithms.features.mount_test import WHAT_TO_CHECK
from algorithms.features.scan_features import ScanFeatures

ENOUGH_SEGMENTS = 20
"""Of so many straight edges in a photo some lie on surface that the scan shows, where its camera stands as stated."""
FEW_LINES = 0.02
"""Share of the edges that give a line in space, below which a photo hardly looks at what was scanned."""


def photos_without_lines(features: ScanFeatures) -> list[str]:
    """Name the photos of a station of whose edges none, or hardly any, could be carried into space.

    Parameters
    ----------
    features
        Of the station. Photos count from 1, as the pictures among the results do.
    """
    edges = features.photo_edges
    if edges is None:
        return []
    segments, lines = edges.segment_counts, edges.projected_counts
    empty = np.flatnonzero((segments >= ENOUGH_SEGMENTS) & (lines <= FEW_LINES * segments))
    return [
        f"of {segments[q]} straight edges in photo {q + 1} "
        f"{'none' if lines[q] == 0 else f'only {lines[q]}'} could be carried into space: {WHAT_TO_CHECK}"
        for q in empty.tolist()
    ]
