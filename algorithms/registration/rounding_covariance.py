"""What rounded coordinates do to a pose from surfaces: errors that whole walls share, which no misfit shows.

All points of a wall on one step of the coordinates lie wrong by the same, and the wall of the other scan by something
else: misfits of that wall are alike everywhere, whatever the size of neighbourhoods. So the errors of each plane's
offset and tilts by rounding (`features.plane_rounding`) are carried to the pose by the derivatives of the estimate.
"""

import numpy as np

from algorithms.arrays import Array, Indices, Points, Scalars
from algorithms.features.scan_features import ScanFeatures

LOOSE_EDGE_M = 0.5
"""Surface on no plane shares its errors within cubes of this edge [m]: small bodies lie on one step as walls do."""

DOMINATING_SHARE = 0.5
"""Mean share of the variance of planes' offsets from which on rounding is said to dominate."""


def rounding_covariance(
    gain: Array, target: ScanFeatures, source: ScanFeatures, of_target: Indices, of_source: Indices
) -> Array:
    """Give the covariance (k, k) that rounded coordinates of both scans add to that of an estimate by surfaces.

    Σ G_P C_P G_Pᵀ over the planes P of both scans, with G_P = Σ g (-u, -v, 1) over the distances measured on P.

    Parameters
    ----------
    gain
        (k, n) g, what the estimate changes by with each distance.
    target, source
        Features of both scans.
    of_target, of_source
        (n,) surface points that the distances were measured between, numbers of `index`.
    """
    total = np.zeros((len(gain), len(gain)))
    for scan, numbers in ((target, of_target), (source, of_source)):
        if scan.rounding is None:
            continue
        points, normals = scan.index.points[numbers], scan.index.normals[numbers]
        labels = scan.surface.plane_labels[scan.index.numbers[numbers]]
        total += _of_planes(gain, scan, scan.rounding.plane_covariances, points, labels)
        loose = np.flatnonzero(labels < 0)
        total += _of_loose(gain[:, loose], scan, points[loose], normals[loose])
    return total


def least_spread(target: ScanFeatures, source: ScanFeatures) -> float:
    """Give what distances between corresponding walls scatter by at least, by the rounding of coordinates [m]."""
    own = [0.0 if scan.rounding is None else scan.rounding.shared_std_m for scan in (target, source)]
    return float(np.hypot(*own))


def remark_on_rounding(scan: ScanFeatures) -> str | None:
    """Say that rounded coordinates dominate the standard deviations of a scan; None where they do not."""
    rounding, planes = scan.rounding, scan.planes
    if rounding is None or len(planes) == 0:
        return None
    shares = rounding.plane_covariances[:, 2, 2] / planes.covariances[:, 2, 2]
    if float(np.mean(shares)) < DOMINATING_SHARE:
        return None
    steps = [f"{1e3 * step:.3g}" for step in rounding.steps_m.tolist()]
    size = f"{steps[0]} mm" if len(set(steps)) == 1 else f"{', '.join(steps)} mm along x, y, z"
    if rounding.range_step_m > rounding.steps_m.max():
        size = f"{1e3 * rounding.range_step_m:.3g} mm in the distance from the instrument"
    how = f"fall on slices of about {size}" if rounding.uneven else f"are rounded to {size}"
    return f"coordinates {how}: this dominates the standard deviations"


def _of_planes(gain: Array, scan: ScanFeatures, covariances: Array, points: Points, labels: Array) -> Array:
    """Sum over the planes of a scan."""
    planes = scan.planes
    on = np.flatnonzero(labels >= 0)
    numbers, group = np.unique(labels[on], return_inverse=True)
    arms = points[on] - planes.centroids[labels[on]]
    places = np.einsum("ni,nij->nj", arms, planes.bases[labels[on]])
    derivatives = np.column_stack([-places, np.ones(len(on))])
    sums = np.zeros((len(numbers), len(gain), 3))
    np.add.at(sums, group, gain[:, on].T[:, :, None] * derivatives[:, None, :])
    return np.asarray(np.einsum("pki,pij,plj->kl", sums, covariances[numbers], sums))


def _of_loose(gain: Array, scan: ScanFeatures, points: Points, normals: Points) -> Array:
    """Sum over cubes of surface that lies on no plane, each axis by itself, less what they average over."""
    rounding = scan.rounding
    total = np.zeros((len(gain), len(gain)))
    if rounding is None or len(points) == 0:
        return total
    share = rounding.shared_std_m / rounding.std_m if rounding.std_m > 0.0 else 0.0
    cubes = np.unique(np.floor(points / LOOSE_EDGE_M).astype(np.int64), axis=0, return_inverse=True)[1].ravel()
    variances: Scalars = np.square(rounding.steps_m) / 12.0 * min(share, 1.0) ** 2
    for axis in np.flatnonzero(variances > 0.0).tolist():
        sums = np.stack([np.bincount(cubes, row * normals[:, axis]) for row in gain])
        total += variances[axis] * sums @ sums.T
    return total
