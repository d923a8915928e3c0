"""Retro-reflective squares and cylinders: bright spots in the intensity of structured scans, measured to a part of a
pixel (Haring 2003).
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from algorithms.arrays import Array
from algorithms.errors import InvalidInputError
from algorithms.progress import NoProgress, Progress
from algorithms.targets.bright_spot import SpotFit, fit_spot
from algorithms.targets.found import Candidate, FoundTarget, RejectedCandidate
from algorithms.targets.options import TargetKind
from algorithms.targets.seen_cloud import SeenCloud

BRIGHTER = 2.5
"""A spot is so many times as bright as the brightest tenth of what surrounds it."""
BLOCK_PX = 24
"""Side of the blocks whose intensities tell what is around."""
LEAST_PIXELS, MOST_PIXELS = 3, 1 << 20
SMALLEST, LARGEST = 0.55, 1.6
"""A spot's sides relative to the target's, beyond what the beam and the raster blur."""
MOST_LOOKED_AT = 400
STEEPEST_SHARE = 0.45
"""A square seen at more than 63 degrees, and whatever else is narrower than so much of its height, is none."""
RANGE_SPREAD = 1.5
"""The ranges of a target's pixels differ by at most so many sides."""
LEAST_AGREEMENT = 0.6
RIM_PX = 3
"""Pixels around a spot that take part in its measurement."""


@dataclass(frozen=True, eq=False)
class _Spot:
    """A bright spot in the raster."""

    rows: slice
    columns: slice
    mask: Array
    """Within these: which pixels are brighter than halfway to the surroundings."""


def find_retro_targets(
    cloud: SeenCloud, size_m: float, kind: TargetKind, *, progress: Progress | None = None
) -> list[Candidate]:
    """Find retro-reflective targets of one size.

    Parameters
    ----------
    cloud
        The scan about its instrument, structured and with intensities.
    size_m
        Side of the squares, or diameter and height of the cylinders [m].
    kind
        Squares or cylinders.
    progress
        Is told the spots that were looked at.

    Raises
    ------
    InvalidInputError
        For a scan without intensities or without its raster.
    """
    if cloud.intensity is None:
        advice = "look for spheres"
        raise InvalidInputError("scan", "retro-reflective targets are seen in the intensities, and it has none", advice)
    if not cloud.structured:
        raise InvalidInputError(
            "scan",
            "retro-reflective targets are measured in the scanner's raster, and it has none",
            "give it structured",
        )
    listener = progress or NoProgress()
    there = cloud.index >= 0
    values = np.where(there, cloud.intensity[np.maximum(cloud.index, 0)], 0.0)
    spots = _spots(values, there)
    found: list[Candidate] = []
    for number, spot in enumerate(spots):
        listener.report(number / len(spots), "retro-reflective targets")
        candidate = _tested(cloud, spot, size_m, kind)
        if candidate is not None:
            found.append(candidate)
    return found


def _spots(values: Array, there: Array) -> list[_Spot]:
    """Find connected pixels that are much brighter than what surrounds them, the brightest first."""
    background = _surroundings(values, there)
    bright = there & (values > BRIGHTER * background)
    labels, count = ndimage.label(bright, structure=np.ones((3, 3)))
    if count == 0:
        return []
    peaks = ndimage.maximum(values, labels, np.arange(1, count + 1))
    boxes = ndimage.find_objects(labels)
    spots = []
    for label in (np.argsort(-np.asarray(peaks), kind="stable")[:MOST_LOOKED_AT] + 1).tolist():
        rows, columns = boxes[label - 1]
        peak, around = peaks[label - 1], background[rows, columns]
        # the beam's tail and blur are below half, so that half of the height is where the target ends
        mask = (labels[rows, columns] == label) & (values[rows, columns] > 0.5 * (peak + around))
        if np.count_nonzero(labels[rows, columns] == label) >= LEAST_PIXELS:
            spots.append(_Spot(rows, columns, mask))
    return spots


def _surroundings(values: Array, there: Array) -> Array:
    """Give the brightness of what is around each pixel: the upper tenth of blocks, the least of the 3 x 3 around."""
    rows, columns = (-(-length // BLOCK_PX) for length in values.shape)
    padded = np.full((rows * BLOCK_PX, columns * BLOCK_PX), np.nan, dtype=np.float32)
    padded[: values.shape[0], : values.shape[1]] = np.where(there, values, np.nan)
    blocks = padded.reshape(rows, BLOCK_PX, columns, BLOCK_PX).swapaxes(1, 2).reshape(rows, columns, -1)
    known = np.isfinite(blocks).any(axis=2)
    upper = np.full((rows, columns), np.inf, dtype=np.float32)
    upper[known] = np.nanquantile(blocks[known], 0.9, axis=1)
    least = ndimage.minimum_filter(upper, 3)
    filled = np.where(np.isfinite(least), least, 0.0)
    whole = np.repeat(np.repeat(filled, BLOCK_PX, axis=0), BLOCK_PX, axis=1)
    return np.asarray(whole[: values.shape[0], : values.shape[1]])


def _tested(cloud: SeenCloud, spot: _Spot, size_m: float, kind: TargetKind) -> Candidate | None:
    """Measure a spot and test whether it is a target of the size; None where it is nothing worth a word."""
    index = cloud.index[spot.rows, spot.columns]
    numbers = index[spot.mask & (index >= 0)]
    if len(numbers) == 0 or len(numbers) > MOST_PIXELS:
        return None
    points, ranges = cloud.points[numbers], cloud.ranges[numbers]
    range_m = float(np.median(ranges))
    middle = points[np.argmin(np.abs(ranges - range_m))]
    pixel = np.array(
        [cloud.column_step_rad * np.hypot(middle[0], middle[1]), cloud.row_step_rad * range_m]
    )  # width and height of a pixel across the beam [m]
    where = middle + cloud.sensor_m
    reason = _wrong_shape(spot, pixel, ranges, size_m)
    if reason is not None:
        return RejectedCandidate(kind, where, reason)
    fit = _measured(cloud, spot, range_m, size_m, kind)
    if fit is None or float(np.linalg.norm(fit.centre_m - middle)) > 1.5 * size_m:
        return RejectedCandidate(kind, where, "its intensities allow no centre")
    if fit.agreement < LEAST_AGREEMENT:
        reason = f"a {kind.value} of {size_m * 1e3:.0f} mm explains only {fit.agreement:.0%} of its intensities"
        return RejectedCandidate(kind, where, reason)
    expected = size_m**2 / float(np.prod(pixel)) * np.cos(fit.incidence_rad)
    coverage = float(min(1.0, len(numbers) / max(expected, 1.0)))
    return FoundTarget(
        kind,
        fit.centre_m + cloud.sensor_m,
        fit.covariance_m2,
        len(numbers),
        fit.incidence_rad,
        fit.rms,
        coverage,
        fit.contrast,
        min(coverage, fit.agreement),
    )


def _wrong_shape(spot: _Spot, pixel: Array, ranges: Array, size_m: float) -> str | None:
    """Say why a spot is not as large as the target, or nothing.

    Parameters
    ----------
    spot
        The spot.
    pixel
        (2,) width and height of a pixel there [m].
    ranges
        Of its pixels [m].
    size_m
        Of the target [m].
    """
    rows, columns = np.nonzero(spot.mask)
    extent = np.array([np.ptp(columns) + 1, np.ptp(rows) + 1]) * pixel
    words = f"{extent[0] * 1e3:.0f} mm wide and {extent[1] * 1e3:.0f} mm high"
    # turned by 45 degrees a square is as wide as its diagonal
    if np.any(extent > LARGEST * size_m + 2.0 * pixel):
        return f"it is {words}: too large for {size_m * 1e3:.0f} mm (sign, plate)"
    if np.any(extent + pixel < np.array([STEEPEST_SHARE, SMALLEST]) * size_m):
        return f"it is {words}: too small for {size_m * 1e3:.0f} mm (lamp, glint)"
    if np.ptp(ranges) > RANGE_SPREAD * size_m:
        return f"its ranges differ by {np.ptp(ranges):.3f} m: it is no single surface"
    return None


def _measured(cloud: SeenCloud, spot: _Spot, range_m: float, size_m: float, kind: TargetKind) -> SpotFit | None:
    """Fit the spot in the window of its pixels and some around them."""
    window = tuple(
        slice(max(0, part.start - RIM_PX), min(length, part.stop + RIM_PX))
        for part, length in zip((spot.rows, spot.columns), cloud.index.shape, strict=True)
    )
    rows, columns = np.nonzero(spot.mask)
    start = (
        spot.rows.start + float(rows.mean()) - window[0].start,
        spot.columns.start + float(columns.mean()) - window[1].start,
    )
    return fit_spot(cloud, window, start, range_m, size_m, kind)
