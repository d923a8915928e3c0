"""Are two scans of a pair in different units? Told by a factor between units that joins what both measure."""

import numpy as np
from jaxtyping import Float64

from algorithms.arrays import Array, Scalars
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.planes import Planes

LARGE: tuple[tuple[float, str], ...] = (
    (1000.0, "millimetres"), (100.0, "centimetres"), (1.0 / 0.0254, "inches"),
)  # fmt: skip
"""How many of a unit are a metre, where that is more than scans of one place differ in size."""
FOOT = 1.0 / 0.3048
"""Feet in a metre."""
LEAST_RATIO, LARGEST_FACTOR = 12.0, 4.0
"""Scans of one place differ in size and in spacing by less than this ratio; where both differ by more, it is the unit
nearest to both that is asked for, if each is within this factor of it."""
FACES = 30
"""So many of the largest planes are compared."""
PARALLEL_COSINE = 0.9986
"""Planes within 3 degrees are parallel."""
NEAREST_M, FARTHEST_M = 1.5, 30.0
"""Distances of parallel planes between these bounds are compared [m]: rooms, storeys, buildings."""
RELATIVE = 0.004
"""Distances are equal when they differ by less than this share."""
LEAST_MATCHES, CLEARER = 6, 3.0
"""So many distances, and so many times as many as with any other factor, must agree with a foot."""
OTHER_FACTORS = np.exp(np.log(FOOT) + np.array([-0.31, -0.23, -0.17, -0.11, -0.06, 0.06, 0.11, 0.17, 0.23, 0.31]))
"""Factors that mean nothing: what agrees with them does so by chance."""


def unit_ratio_in_words(
    target: ScanFeatures, source: ScanFeatures, *, target_name: str, source_name: str
) -> str | None:
    """Say that two scans seem to be in different units; None where nothing says so.

    Sizes and spacings of two scans of one place are alike to a factor of two or three; where both differ by a thousand,
    a hundred or forty one of the scans is in another unit. A foot is too near to a metre for that: there distances of
    parallel planes, as floor and ceiling, must agree when they are converted, and not as they are.

    Parameters
    ----------
    target, source
        Features of both scans.
    target_name, source_name
        What to call them.
    """
    for ratio, larger, other in (
        (_ratios(target, source), target_name, source_name),
        (_ratios(source, target), source_name, target_name),
    ):
        apart = [float(np.abs(np.log(ratio / factor)).max()) for factor, _ in LARGE]
        if ratio.min() > LEAST_RATIO and min(apart) < np.log(LARGEST_FACTOR):
            return (
                f"{larger} is {ratio[0]:.0f} times as large as {other}, and its points stand {ratio[1]:.0f} times as "
                f"far apart: is it in {LARGE[int(np.argmin(apart))][1]}, and {other} in metres? Nothing is converted"
            )
    for first, second, in_feet, other in (
        (target, source, target_name, source_name),
        (source, target, source_name, target_name),
    ):
        if _agree_in_feet(_distances(first.planes, FOOT), _distances(second.planes, 1.0)):
            return (
                f"distances of parallel planes in {in_feet} are {FOOT:.3f} times those in {other}: is {in_feet} in "
                f"feet, and {other} in metres? Nothing is converted"
            )
    return None


def _distances(planes: Planes, unit: float) -> Scalars:
    """Give the distances of parallel planes that are rooms, storeys or buildings when a metre is so many units."""
    largest = np.argsort(-planes.areas_m2, kind="stable")[:FACES]
    normals, centroids = planes.normals[largest], planes.centroids[largest]
    i, j = np.triu_indices(len(largest), 1)
    parallel = np.abs(np.sum(normals[i] * normals[j], axis=1)) > PARALLEL_COSINE
    distances = np.abs(np.sum((centroids[i] - centroids[j]) * normals[i], axis=1))[parallel]
    return np.asarray(distances[(distances > NEAREST_M * unit) & (distances < FARTHEST_M * unit)])


def _agree_in_feet(in_feet: Scalars, in_metres: Float64[Array, "m"]) -> bool:
    """Tell whether clearly more distances agree when one scan is converted from feet than with any other factor."""
    if len(in_feet) == 0 or len(in_metres) == 0:
        return False
    ratios = np.log(in_feet[:, None] / in_metres[None, :])

    def matches(factor: float) -> int:
        agreeing = np.abs(ratios - np.log(factor)) < RELATIVE
        return int(min(agreeing.any(axis=0).sum(), agreeing.any(axis=1).sum()))

    others = max(matches(float(factor)) for factor in (1.0, *OTHER_FACTORS))
    return matches(FOOT) >= max(LEAST_MATCHES, CLEARER * others)


def _ratios(first: ScanFeatures, second: ScanFeatures) -> Scalars:
    """Give how many times as large a scan is as another one, and as widely spaced."""
    sizes = [float(np.sqrt(np.sum(np.var(each.surface.points, axis=0)))) for each in (first, second)]
    return np.array([sizes[0] / max(sizes[1], 1e-12), first.spacing_m / max(second.spacing_m, 1e-12)])
