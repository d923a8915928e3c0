"""What became of the lines of each station and source in a pair."""

import numpy as np

from algorithms.adjustment.snooping import CorrespondenceState
from algorithms.arrays import Flags, Indices
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.lines import LineSource
from algorithms.registration.base import FineRegistration
from schemas.results.registration_result import LineCount


def line_counts(
    fine: FineRegistration | None,
    target_features: ScanFeatures,
    source_features: ScanFeatures,
    *,
    target: str,
    source: str,
) -> list[LineCount]:
    """Count the lines of both stations that were found, matched, used and removed, source by source.

    Parameters
    ----------
    fine
        The adjustment; None when it did not come so far.
    target_features, source_features
        Features of both stations.
    target, source
        Names of the stations.
    """
    pairs = np.empty((0, 2), dtype=np.int64) if fine is None else fine.lines
    removed = np.zeros(0, dtype=bool)
    if fine is not None:
        removed = fine.adjustment.lines.states == int(CorrespondenceState.REMOVED)
    return [
        *_of_station(target, target_features, pairs[:, 0], removed),
        *_of_station(source, source_features, pairs[:, 1], removed),
    ]


def _of_station(station: str, features: ScanFeatures, matched: Indices, removed: Flags) -> list[LineCount]:
    """Count the lines of one station; one that has several partners is used where any of its pairs is."""
    used = np.zeros(len(features.lines), dtype=bool)
    paired = used.copy()
    paired[matched] = True
    used[matched[~removed]] = True
    counts = []
    for kind in LineSource:
        of_kind = features.lines.sources == int(kind)
        if kind is LineSource.PHOTO_EDGE and features.photo_edges is None:
            continue
        counts.append(
            LineCount(
                station=station,
                source=kind.label,
                found=int(of_kind.sum()),
                matched=int((of_kind & paired).sum()),
                used=int((of_kind & used).sum()),
                removed=int((of_kind & paired & ~used).sum()),
            )
        )
    return counts
