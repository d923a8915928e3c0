"""Horizontal slices of a scan, and their normal distributions."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from algorithms.arrays import Array, Flags, Indices, Scalars, Vector3, Vectors2
from algorithms.features.scan_features import ScanFeatures

MARGIN_CELLS = 2
"""Free cells around the points."""
LEAST_STD_SHARE = 0.04
"""Distributions are at least so many cells wide: from one size of cells to the next the pose is known to about that."""


@dataclass(frozen=True, eq=False)
class Layers:
    """Points of a levelled scan in horizontal slices."""

    points: Vectors2
    """(n, 2) [m]."""
    numbers: Indices
    """(n,) which slice each lies in."""
    count: int
    """Slices, empty ones included."""

    def thinned(self, most: int) -> "Layers":
        """Keep so many points, evenly chosen."""
        if len(self.points) <= most:
            return self
        which = np.linspace(0, len(self.points) - 1, most).astype(np.int64)
        return Layers(np.ascontiguousarray(self.points[which]), self.numbers[which], self.count)


@dataclass(frozen=True, eq=False)
class LayerDistributions:
    """Normal distributions of slices in four grids that are shifted by half a cell each."""

    low: Array
    """(2,) lower corner of the first grid [m]."""
    cell_m: float
    means: Array
    """(4, layers, rows, columns, 2) [m]."""
    precisions: Array
    """(4, layers, rows, columns, 3) xx, xy, yy of the inverse covariance [1/m²]."""
    found: Array
    """(4, layers, rows, columns) whether there are enough points."""


@dataclass(frozen=True, eq=False)
class Score:
    """How well points lie in distributions, and how that changes with the pose."""

    value: float
    gradient: Vector3
    """(3,) by x, y [1/m] and heading [1/rad]."""
    hessian: Array
    """(3, 3)."""
    outer: Array
    """(3, 3) sum of the outer products of the single points' gradients."""


def layers_of(features: ScanFeatures, heights_m: Sequence[float], thickness_m: float, level: Rotation) -> Layers:
    """Cut slices out of the thinned surface of a scan.

    Parameters
    ----------
    features
        Of the scan.
    heights_m
        Middles of the slices above the instrument, or above the middle of the surface where that is unknown [m].
    thickness_m
        Of each slice [m].
    level
        Turns the scan so that its z axis is vertical; the slices are those of the turned scan.
    """
    points = level.apply(features.surface.points)
    sensor = features.sensor_m
    middle = float(np.median(points[:, 2])) if sensor is None else float(level.apply(sensor)[2])
    parts, numbers = [], []
    for number, height in enumerate(heights_m):
        inside: Flags = np.abs(points[:, 2] - middle - height) <= 0.5 * thickness_m
        parts.append(points[inside, :2])
        numbers.append(np.full(int(inside.sum()), number, dtype=np.int64))
    joined = np.concatenate(parts)
    # an even mixture: any prefix of the slices is a fair sample
    order = np.random.default_rng(7).permutation(len(joined))
    return Layers(np.ascontiguousarray(joined[order]), np.concatenate(numbers)[order], len(heights_m))


def distributions_of(layers: Layers, cell_m: float) -> LayerDistributions:
    """Describe slices by normal distributions.

    Parameters
    ----------
    layers
        At least one point.
    cell_m
        Edge of the cells [m].
    """
    from algorithms.distributions import layer_kernels as kernels

    low = layers.points.min(axis=0) - MARGIN_CELLS * cell_m
    columns, rows = (np.ceil((layers.points.max(axis=0) - low) / cell_m).astype(int) + MARGIN_CELLS).tolist()
    shape = (4, layers.count, rows, columns)
    means, precisions, found = np.zeros((*shape, 2)), np.zeros((*shape, 3)), np.zeros(shape, dtype=np.bool_)
    kernels.cell_distributions(
        layers.points, layers.numbers, low, cell_m, LEAST_STD_SHARE * cell_m, means, precisions, found
    )
    return LayerDistributions(low, cell_m, means, precisions, found)


def score_in(distributions: LayerDistributions, layers: Layers, pose: Scalars) -> Score:
    """Score the pose of points in distributions.

    Parameters
    ----------
    distributions
        Of the target.
    layers
        Of the source.
    pose
        (3,) translation [m] and heading [rad], target from source.
    """
    from algorithms.distributions import layer_kernels as kernels

    derivatives = np.empty((7, 3))
    value = kernels.score(
        pose, layers.points, layers.numbers, distributions.low, distributions.cell_m, distributions.means,
        distributions.precisions, distributions.found, derivatives,
    )  # fmt: skip
    return Score(value, derivatives[0], derivatives[1:4], derivatives[4:])
