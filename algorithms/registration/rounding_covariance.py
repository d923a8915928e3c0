"""What rounded coordinates do to a pose from surfaces: errors that whole walls share, which no misfit shows.

All points of a wall on one step of the coordinates lie wrong by the same, and the wall of the other scan by something
else: misfits of that wall are alike everywhere, whatever the size of neighbourhoods. So the errors of each plane's
offset and tilts by rounding (`features.plane_rounding`) are carried to the pose by the derivatives of the estimate.
"""

import math

import numpy as np
from scipy.spatial.transform import Rotation

from algorithms.arrays import Array, Indices, Matrix6, Points, Scalars, Vector3
from algorithms.features.scan_features import ScanFeatures
from algorithms.numbered_rows import numbered_rows

LOOSE_EDGE_M = 0.5
"""Surface on no plane shares its errors within cubes of this edge [m]: small bodies lie on one step as walls do."""

DOMINATING_SHARE = 0.5
"""Mean share of the variance of planes' offsets from which on rounding is said to dominate."""

ACROSS = 0.99
"""Least cosine between the normal of a plane and an axis that it lies across."""
COMMON_SHARE = 0.5
"""Share of the variance of offsets by rounding that parallel planes are taken to have in common: nobody knows whether
the measures of a building are multiples of the step."""


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


def common_shift_covariance(target: ScanFeatures, source: ScanFeatures, rotation: Rotation) -> Matrix6:
    """Give the covariance (6, 6) of a pose by what rounding shifts all parallel planes of a scan by alike [m2].

    Where a building's measures are whole multiples of the step, floors and ceilings, or opposite walls, lie alike on
    the steps, and their errors are a shift of the whole scan, which does not average over planes.

    Parameters
    ----------
    target, source
        Features of both scans.
    rotation
        Target from source.
    """
    covariance = np.zeros((6, 6))
    turn = rotation.as_matrix()
    covariance[3:, 3:] = np.diag(_common_variances(target)) + turn @ np.diag(_common_variances(source)) @ turn.T
    return covariance


def _common_variances(scan: ScanFeatures) -> Vector3:
    """Give the variance of a shift along each axis of a scan's file that planes across it share [m2]."""
    variances = np.zeros(3)
    if scan.rounding is None or len(scan.planes) == 0:
        return variances
    for axis in range(3):
        across = np.abs(scan.planes.normals[:, axis]) > ACROSS
        if across.any():
            offsets = scan.rounding.plane_covariances[across, 2, 2]
            variances[axis] = COMMON_SHARE * np.average(offsets, weights=scan.planes.areas_m2[across] + 1e-9)
    return variances


def least_spread(target: ScanFeatures, source: ScanFeatures) -> float:
    """Give what distances between corresponding walls scatter by at least, by the rounding of coordinates [m]."""
    own = [0.0 if scan.rounding is None else scan.rounding.shared_std_m for scan in (target, source)]
    return math.hypot(*own)


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
    sums = np.array([np.bincount(group, row * column) for row in gain[:, on] for column in derivatives.T])
    sums = sums.reshape(len(gain), 3, len(numbers))
    return np.asarray(np.einsum("kip,pij,ljp->kl", sums, covariances[numbers], sums, optimize=True))


def _of_loose(gain: Array, scan: ScanFeatures, points: Points, normals: Points) -> Array:
    """Sum over cubes of surface that lies on no plane, each axis by itself, less what they average over."""
    rounding = scan.rounding
    total = np.zeros((len(gain), len(gain)))
    if rounding is None or len(points) == 0:
        return total
    share = rounding.shared_std_m / rounding.std_m if rounding.std_m > 0.0 else 0.0
    _, cubes = numbered_rows(np.floor(points / LOOSE_EDGE_M).astype(np.int64))
    variances: Scalars = np.square(rounding.steps_m) / 12.0 * min(share, 1.0) ** 2
    for axis in np.flatnonzero(variances > 0.0).tolist():
        sums = np.stack([np.bincount(cubes, row * normals[:, axis]) for row in gain])
        total += variances[axis] * sums @ sums.T
    return total
