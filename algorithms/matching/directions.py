"""In which direction two scans are laid on each other, so that nothing depends on which of them is called the target.

What is thinned, clustered, told in one scan's axes or measured at one scan's features has a direction: swapped, it
gives nearly the same, and near a limit another answer. So each such step is taken in the one direction that the scans
themselves choose, and what it found is turned round where the other one was asked for.
"""

from algorithms.features.scan_features import ScanFeatures


def comes_first(scan: ScanFeatures, other: ScanFeatures) -> bool:
    """Say which of two scans is the one that the other is laid on, whatever they are called.

    It is the one with more surface, so that the smaller one is moved; of equally large ones the bytes decide. Both come
    first only where they are the same.

    Parameters
    ----------
    scan, other
        Features of the two scans.
    """
    ours, theirs = len(scan.surface.points), len(other.surface.points)
    return ours > theirs or (ours == theirs and _content(scan) >= _content(other))


def _content(scan: ScanFeatures) -> tuple[bytes, ...]:
    arrays = scan.surface.points, scan.lines.anchors, scan.planes.centroids
    return tuple(array.tobytes() for array in arrays)
