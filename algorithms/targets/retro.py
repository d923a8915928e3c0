"""Retro-reflective squares and cylinders: bright spots in the intensity of structured scans, measured to a part of a
pixel (Haring 2003).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from algorithms.arrays import Array
from algorithms.errors import InvalidInputError
from algorithms.progress import NoProgress, Progress
from algorithms.targets.bright_spot import POINTS_OF_A_PLANE, SpotFit, fit_spot
from algorithms.targets.found import Candidate, FoundTarget, RejectedCandidate
from algorithms.targets.options import TargetKind
from algorithms.targets.seen_cloud import SeenCloud
from algorithms.targets.tangent_plane import plane_across, plane_through

BRIGHTER = 2.5
"""A spot is so many times as bright as the brightest tenth of what surrounds it."""
BLOCK_PX = 24
"""Side of the blocks whose intensities tell what is around."""
LEAST_PIXELS, MOST_PIXELS = 3, 1 << 20
LEVELS, BLUR_PX = 8, 2
"""Brightness is halved so often, and what lies so near to a brighter spot is its blur."""
SEEN_SHARE = 0.3
"""Blocks that hold fewer measurements are taken for as bright as the scan is in the middle."""
SMALLEST, LARGEST = 0.55, 1.6
"""A spot's sides relative to the target's, beyond what the beam and the raster blur."""
MOST_LOOKED_AT = 1000
STEEPEST_SHARE = 0.45
"""A square seen at more than 63 degrees, and whatever else is narrower than so much of its height, is none."""
RANGE_SPREAD = 1.5
"""The ranges of a target's pixels differ by at most so many sides."""
RIM_PX = 3
"""Pixels around a spot that take part in its measurement."""
BEFORE, MOST_BEFORE = 0.25, 0.1
"""What lies so many sides before the plane of a spot hides a part of it, if it is beside so much of its contour."""
LEAST_COVERAGE, MOST_COVERAGE = 0.6, 1.35
"""Pixels that are at least half as bright as the brightest, relative to those of a whole target: of a cylinder whose
foil shines as paper does 0.87."""
LEAST_AGREEMENT = 0.8
LEAST_CONTRAST, MOST_CONTRAST = 0.4, 1.3
"""Foil is 2.5 times as bright as what surrounds it, and that is not darker than nothing."""
EIGHT = np.ones((3, 3), dtype=np.int8)
"""Neighbours of a pixel."""


@dataclass(frozen=True, eq=False)
class BrightSpot:
    """A bright spot in the raster."""

    rows: slice
    columns: slice
    mask: Array
    """Within these: which pixels are brighter than halfway to the surroundings."""


def bright_spots(cloud: SeenCloud) -> list[BrightSpot]:
    """Find what is much brighter than its surroundings: retro-reflective targets of all kinds and sizes are among it.

    Parameters
    ----------
    cloud
        The scan about its instrument, structured and with intensities.

    Returns
    -------
    The brightest first.

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
    there = cloud.index >= 0
    return _spots(np.where(there, cloud.intensity[np.maximum(cloud.index, 0)], 0.0), there)


def find_retro_targets(
    cloud: SeenCloud, spots: Sequence[BrightSpot], size_m: float, kind: TargetKind, *, progress: Progress | None = None
) -> list[Candidate]:
    """Find retro-reflective targets of one size.

    Parameters
    ----------
    cloud
        The scan about its instrument.
    spots
        What is bright in it.
    size_m
        Side of the squares, or diameter and height of the cylinders [m].
    kind
        Squares or cylinders.
    progress
        Is told the spots that were looked at.
    """
    listener = progress or NoProgress()
    found: list[Candidate] = []
    for number, spot in enumerate(spots):
        listener.report(number / len(spots), "retro-reflective targets")
        candidate = _tested(cloud, spot, size_m, kind)
        if candidate is not None:
            found.append(candidate)
    return found


def _spots(values: Array, there: Array) -> list[BrightSpot]:
    """Find connected pixels that are much brighter than what surrounds them, the brightest first.

    Where much is bright, a target is a part of it: what is brighter than half of a part's height stands for itself, and
    the rest is looked at again without it.
    """
    background = _surroundings(values, there)
    bright = there & (values > BRIGHTER * background)
    spots, peaks = [], []
    for _ in range(LEVELS):
        labels, count = ndimage.label(bright, structure=EIGHT)
        if count == 0:
            break
        # the beam's tail and blur are below half, so that half of the height is where the target ends
        high = _upper_halves(values, background, labels, count)
        parts, count = ndimage.label(high, structure=EIGHT)
        for number, (rows, columns) in enumerate(ndimage.find_objects(parts), 1):
            mask = parts[rows, columns] == number
            if np.count_nonzero(mask) >= LEAST_PIXELS:
                spots.append(BrightSpot(rows, columns, mask))
                peaks.append(float(values[rows, columns][mask].max()))
        bright &= ~ndimage.binary_dilation(high, EIGHT, iterations=BLUR_PX)
    return [spots[k] for k in np.argsort(-np.asarray(peaks), kind="stable")[:MOST_LOOKED_AT]]


def _upper_halves(values: Array, background: Array, labels: Array, count: int) -> Array:
    """Mark the pixels of each label above the middle between its peak and its surroundings."""
    where = np.flatnonzero(labels)
    own, value = labels.ravel()[where], values.ravel()[where]
    peaks = np.zeros(count + 1)
    np.maximum.at(peaks, own, value)
    high = np.zeros(labels.size, dtype=bool)
    high[where] = value > 0.5 * (peaks[own] + background.ravel()[where])
    return high.reshape(labels.shape)


def _surroundings(values: Array, there: Array) -> Array:
    """Give the brightness of what is around each pixel: the upper tenth of blocks, the least of the 3 x 3 around."""
    rows, columns = (-(-length // BLOCK_PX) for length in values.shape)
    padded = np.full((rows * BLOCK_PX, columns * BLOCK_PX), np.nan, dtype=np.float32)
    padded[: values.shape[0], : values.shape[1]] = np.where(there, values, np.nan)
    blocks = padded.reshape(rows, BLOCK_PX, columns, BLOCK_PX).swapaxes(1, 2).reshape(rows, columns, -1)
    # where next to nothing else comes back (sky), a target would be its own surroundings
    counts = np.count_nonzero(np.isfinite(blocks), axis=2)
    known = counts > SEEN_SHARE * blocks.shape[2]
    upper = np.full((rows, columns), np.median(values[there]), dtype=np.float32)
    # what is missing is sorted to the end
    ordered, place = np.sort(blocks[known], axis=1), 0.9 * (counts[known] - 1)
    low = place.astype(np.int64)
    beside = np.minimum(low + 1, counts[known] - 1)
    below, above = (np.take_along_axis(ordered, each[:, None], axis=1)[:, 0] for each in (low, beside))
    upper[known] = below + (place - low) * (above - below)
    whole = np.repeat(np.repeat(ndimage.minimum_filter(upper, 3), BLOCK_PX, axis=0), BLOCK_PX, axis=1)
    return np.asarray(whole[: values.shape[0], : values.shape[1]])


def _tested(cloud: SeenCloud, spot: BrightSpot, size_m: float, kind: TargetKind) -> Candidate | None:
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
    whole = size_m**2 / float(np.prod(pixel))
    reason = (
        _wrong_shape(spot, pixel, ranges, size_m)
        or _wrong_coverage(len(numbers), (STEEPEST_SHARE * whole, whole), size_m)
        or _cut_off(cloud, spot, points, size_m)
    )
    if reason is not None:
        return RejectedCandidate(kind, where, reason)
    fit = _measured(cloud, spot, range_m, size_m, kind)
    if fit is None or float(np.linalg.norm(fit.centre_m - middle)) > 1.5 * size_m:
        return RejectedCandidate(kind, where, "its intensities allow no centre")
    expected = whole * np.cos(fit.incidence_rad)
    reason = _wrong_intensities(fit, size_m, kind) or _wrong_coverage(len(numbers), (expected, expected), size_m)
    if reason is not None:
        return RejectedCandidate(kind, where, reason)
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
        size_m,
        fit.normal,
        _range_misfit(points, ranges, fit, size_m, kind),
    )


def _range_misfit(points: Array, ranges: Array, fit: SpotFit, size_m: float, kind: TargetKind) -> float:
    """Give the median difference of ranges (n,) from those to a square or to an upright cylinder at the centre [m]."""
    beams = points / ranges[:, None]
    if kind is TargetKind.RETRO_SQUARE:
        normal = fit.centre_m if fit.normal is None else fit.normal
        return float(np.median(np.abs(ranges - (normal @ fit.centre_m) / (beams @ normal))))
    across, centre = np.einsum("ij,ij->i", beams[:, :2], beams[:, :2]), fit.centre_m[:2]
    along = beams[:, :2] @ centre
    # beside the cylinder the beam is nearest to it where it passes its axis
    hidden = np.maximum(along**2 - across * (centre @ centre - 0.25 * size_m**2), 0.0)
    return float(np.median(np.abs(ranges - (along - np.sqrt(hidden)) / across)))


def _wrong_coverage(pixels: int, expected: tuple[float, float], size_m: float) -> str | None:
    """Say how many pixels there are where a target shows some number between two, or nothing.

    Along the contour a pixel belongs to the target or not as it happens: as many as half a side may be missing.
    """
    least, most = (max(value, 1.0) for value in expected)
    if pixels < LEAST_COVERAGE * least - 0.5 * np.sqrt(least):
        return (
            f"it is only {pixels / least:.0%} of the surface of {size_m * 1e3:.0f} mm: part of something (sign, plate)"
        )
    if pixels > MOST_COVERAGE * most + 2.0 * np.sqrt(most):
        return f"it is {pixels / most:.0%} of the surface of {size_m * 1e3:.0f} mm: too large (sign, plate)"
    return None


def _cut_off(cloud: SeenCloud, spot: BrightSpot, points: Array, size_m: float) -> str | None:
    """Say that the spot is cut off by what stands before it, or by the end of the scan; or nothing."""
    rows, columns = (slice(part.start - 2, part.stop + 2) for part in (spot.rows, spot.columns))
    if min(rows.start, columns.start) < -1 or np.any(
        np.array([rows.stop, columns.stop]) > np.add(cloud.index.shape, 1)
    ):
        return "it is cut off by the end of the scan"
    inner = slice(max(rows.start, 0), rows.stop), slice(max(columns.start, 0), columns.stop)
    index = cloud.index[inner]
    mask = np.zeros((rows.stop - rows.start, columns.stop - columns.start), dtype=bool)
    mask[2:-2, 2:-2] = spot.mask
    # the pixels next to it may have met it in part
    rim = ndimage.binary_dilation(mask, EIGHT)
    ring = ndimage.binary_dilation(rim, EIGHT) & ~rim
    ring = ring[inner[0].start - rows.start :, inner[1].start - columns.start :][: index.shape[0], : index.shape[1]]
    around = index[ring]
    beside = cloud.points[around[around >= 0]]
    plane, margin = plane_through(points), BEFORE * size_m
    if plane is None or len(points) < POINTS_OF_A_PLANE:
        plane = plane_across(points.mean(axis=0), 0.0)
        margin += size_m
    before = (beside - plane.centre_m) @ plane.normal > margin + 4.0 * plane.noise_m
    share = float(np.count_nonzero(before)) / max(len(around), 1)
    if share <= MOST_BEFORE:
        return None
    return f"{share:.0%} of its contour is the edge of what stands before it: part of something (sign, plate)"


def _wrong_intensities(fit: SpotFit, size_m: float, kind: TargetKind) -> str | None:
    """Say why the intensities are not those of the target, or nothing."""
    if fit.agreement < LEAST_AGREEMENT:
        return f"a {kind.value} of {size_m * 1e3:.0f} mm explains only {max(fit.agreement, 0.0):.0%} of its intensities"
    if not LEAST_CONTRAST <= fit.contrast <= MOST_CONTRAST:
        return f"its contrast to what surrounds it is {fit.contrast:.2f}: not that of foil"
    return None


def _wrong_shape(spot: BrightSpot, pixel: Array, ranges: Array, size_m: float) -> str | None:
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


def _measured(cloud: SeenCloud, spot: BrightSpot, range_m: float, size_m: float, kind: TargetKind) -> SpotFit | None:
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
