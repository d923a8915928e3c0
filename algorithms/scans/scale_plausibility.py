"""Are the coordinates metres? What no scan in metres can be, and the unit in which it would be one.

A cloud is a figure without a scale: angles, hidden surfaces and the steps of the scanner's circles are the same in any
unit. What has a scale is the world: how densely instruments measure, how far they reach, how large flat faces are. So a
scan is called implausible only where one of these is beyond everything known, and nothing is ever converted:

* *Spacing.* Laser scanners on tripods, cars and drones give neighbouring points millimetres to decimetres apart,
  airborne ones up to 3 m, thinned terrain models up to some more. Beyond `WIDEST_SPACING_M` no scan is known.
* *Flat faces.* A plane may be any length (a floor, a tunnel, flat country, a slope), but two plane faces across each
  other, as floor and wall, that are both hundreds of metres wide in either direction are not built, and slopes of
  mountains neither so plane nor so steep on both sides: rooms in millimetres or centimetres have them.
* *Height over width.* Degrees of longitude and latitude beside heights in metres make a thread, ten metres high and a
  fraction of a millimetre wide.
* *Range.* Where the file says where the instrument stood, terrestrial scanners reach `LONGEST_RANGE_M` at most.

What is small may be small: parts and models are scanned too. Feet are told from metres by none of these unless the scan
is large; a pair whose scans differ by such a factor is (`matching.unit_ratio`).
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree

from algorithms.arrays import Array, Points, Vector3
from algorithms.scans.far_points import without_far_points
from algorithms.scans.scan import Scan

WIDEST_SPACING_M = 12.0
"""Largest median distance of neighbouring points [m]."""
LONGEST_RANGE_M = 10_000.0
"""Farthest that 99 % of the points may be from a known instrument [m]."""
WIDEST_THREAD_M, LEAST_THREAD_M, THREAD_RATIO = 0.05, 1.0, 300.0
"""A scan that is narrower than the first in x and y [m], higher than the second [m], and so many times higher than wide
is in degrees: half a centimetre of them are half a kilometre."""
LARGEST_FACE_M = 40.0
"""Largest standard deviation across the narrower side of faces: 140 m from end to end."""
FLATNESS = 0.006
"""A face is flat when its points scatter by less than this share of the scan's size."""
LEAST_FACE = 0.04
"""Least share of the points on a face."""
AROUND, LEAST_ON = 4.0, 0.5
"""Of the points within so many times that distance of a face at least this share is on it: a plane that cuts through
rough ground has no more than a quarter."""
LEAST_DEPTH_M = 8.0
"""A scan with such faces has at least this standard deviation in every direction [m]."""
ACROSS_COSINE = 0.5
"""Two faces are across each other when their normals have a smaller cosine."""
SAME_COSINE = 0.97
"""Faces whose normals have a larger cosine are alike: one of them is enough."""
CONSECUTIVE, SAMPLE, DRAWS, DRAWN_AT_ONCE = 50_000, 3_000, 1_500, 100
"""Points among which neighbours are looked for; points in which faces are looked for; planes that are tried."""
LEAST_POINTS = 100
"""Fewer points have no faces."""
CELLS = 25.0
"""Cells to which a scan is thinned, along its size."""
NEAR_SHARE = 0.15
"""Of a plane to try, the second and third point are among this share of nearest ones to the first."""
UNITS: tuple[tuple[str, float], ...] = (
    ("millimetres", 0.001), ("centimetres", 0.01), ("inches", 0.0254), ("feet", 0.3048),
)  # fmt: skip
"""Other units that clouds are written in [m]."""


@dataclass(frozen=True)
class Extent:
    """What of a scan has a scale."""

    sides_m: tuple[float, float, float]
    """Sides of the box that holds 99 % of the points along each axis [m]."""
    spacing_m: float
    """Median distance of neighbouring points [m]."""


def extent_of(points: Points) -> Extent:
    """Measure a scan.

    Parameters
    ----------
    points
        (n, 3) [m].
    """
    sample = points[:: max(1, len(points) // (10 * SAMPLE))]
    low, high = np.quantile(sample, [0.005, 0.995], axis=0)
    first = max(0, (len(points) - CONSECUTIVE) // 2)
    some = points[first : first + CONSECUTIVE]
    step = max(1, len(some) // SAMPLE)
    nearest = np.asarray(cKDTree(some).query(some[::step], k=min(2, len(some)))[0]).reshape(-1, min(2, len(some)))[
        :, -1
    ]
    x, y, z = (float(side) for side in high - low)
    return Extent((x, y, z), float(np.median(nearest)))


def scan_warnings(scan: Scan) -> tuple[str, ...]:
    """Say what the owner of a scan should know: isolated far points, and what makes one doubt that it is in metres."""
    kept, far = without_far_points(scan)
    words = far.in_words()
    # a generator of its own: what is said of a scan does not depend on anything else
    own = scale_warnings(kept.points, kept.sensor_m, np.random.default_rng(0))
    return (*([] if words is None else [words]), *own)


def scale_warnings(points: Points, sensor_m: Vector3 | None, rng: np.random.Generator) -> tuple[str, ...]:
    """Say why the coordinates of a scan may not be metres; nothing where they may.

    Parameters
    ----------
    points
        (n, 3) without isolated far points [m].
    sensor_m
        Where the file says the instrument stood, in the same frame; None where it does not.
    rng
        Draws the planes that are tried.
    """
    extent = extent_of(points)
    x, y, z = extent.sides_m
    if max(x, y) < WIDEST_THREAD_M and z > max(LEAST_THREAD_M, THREAD_RATIO * max(x, y)):
        wide_mm = max(x, y) * 1e3
        words = (
            f"the coordinates are taken for metres, but the scan is {z:.3g} m high and only {wide_mm:.2g} mm wide: its "
            "x and y may be degrees of longitude and latitude, in which nothing can be measured. Nothing is converted: "
            "transform them to a projected system in metres (such as UTM) and send that"
        )
        return (words,)
    why = []
    if extent.spacing_m > WIDEST_SPACING_M:
        why.append(f"neighbouring points are {extent.spacing_m:.3g} m apart in the median, and no scanner measures so")
    sample = points[:: max(1, len(points) // (10 * SAMPLE))]
    if sensor_m is not None:
        far = float(np.quantile(np.linalg.norm(sample - sensor_m, axis=1), 0.99))
        if far > LONGEST_RANGE_M:
            why.append(f"points lie {far:.3g} m from the instrument, and no terrestrial scanner reaches so far")
    face = _smaller_of_two_faces(sample, rng)
    if face > LARGEST_FACE_M:
        why.append(
            f"it has flat faces across each other, as floor and walls, that are {face * np.sqrt(12.0):.0f} m wide and "
            "more in every direction, and nothing built is so large"
        )
    if not why:
        return ()
    sides = " × ".join(f"{side:.5g}" for side in extent.sides_m)
    words = (
        f"the coordinates are taken for metres, and the scan measures {sides} m, but {'; '.join(why)}. "
        f"{_fitting_units(extent, face)} Nothing is converted: state the unit, or send the scan in metres"
    )
    return (words,)


def _fitting_units(extent: Extent, face: float) -> str:
    """Say in which other units the scan would be one."""
    fitting = []
    for name, factor in UNITS:
        if extent.spacing_m * factor <= WIDEST_SPACING_M / 20.0 and face * factor <= LARGEST_FACE_M / 4.0:
            sides = " × ".join(f"{side * factor:.3g}" for side in extent.sides_m)
            fitting.append(f"in {name} it would measure {sides} m")
    return f"{'; '.join(fitting)}.".capitalize() if fitting else "No usual unit makes a scan of it."


def _smaller_of_two_faces(points: Points, rng: np.random.Generator) -> float:
    """Find two plane faces across each other; give the standard deviation of the smaller one's narrow side [m].

    Of all pairs the one in which the smaller face is largest counts; 0 where there are no two.
    """
    points = points - points.mean(axis=0)
    if len(points) < LEAST_POINTS:
        return 0.0
    least, middle, largest = np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(points.T)), 0.0)).tolist()
    if middle <= LARGEST_FACE_M or least < LEAST_DEPTH_M:
        return 0.0
    size = float(np.sqrt(least**2 + middle**2 + largest**2))
    # one point a cell: near the instrument points are dense, and say no more of the walls than others
    kept = np.sort(np.unique(np.floor(points / (size / CELLS)), axis=0, return_index=True)[1])
    points = points[kept[:: max(1, len(kept) // SAMPLE)]]
    if len(points) < LEAST_POINTS:
        return 0.0
    tolerance = FLATNESS * size
    near = max(3, int(NEAR_SHARE * len(points)))
    neighbours = np.asarray(cKDTree(points).query(points[rng.integers(len(points), size=DRAWS // 5)], k=near)[1])
    normals, widths = [np.empty((0, 3))], [np.empty(0)]
    for start in range(0, DRAWS, DRAWN_AT_ONCE):
        of = np.arange(start, start + DRAWN_AT_ONCE) % len(neighbours)
        chosen = points[neighbours[of[:, None], rng.integers(near, size=(DRAWN_AT_ONCE, 3))]]
        normal = np.cross(chosen[:, 1] - chosen[:, 0], chosen[:, 2] - chosen[:, 0])
        length = np.linalg.norm(normal, axis=1)
        good = length > (0.05 * size) ** 2
        normal, first = normal[good] / length[good, None], chosen[good, 0]
        off = np.abs(points @ normal.T - np.sum(normal * first, axis=1))
        on = off < tolerance
        enough = (on.mean(axis=0) > LEAST_FACE) & (on.sum(axis=0) > LEAST_ON * (off < AROUND * tolerance).sum(axis=0))
        normals.append(normal[enough])
        widths.append(np.array([_narrow_std(points[column]) for column in on.T[enough]]))
    normal, width = np.concatenate(normals), np.concatenate(widths)
    order = np.argsort(-width, kind="stable")
    distinct: list[int] = []
    for k in order[width[order] > LARGEST_FACE_M]:
        if all(abs(float(normal[k] @ normal[j])) < SAME_COSINE for j in distinct):
            distinct.append(int(k))
    return max(
        (
            float(min(width[j], width[k]))
            for j, k in combinations(distinct, 2)
            if abs(float(normal[j] @ normal[k])) < ACROSS_COSINE
        ),
        default=0.0,
    )


def _narrow_std(points: Points) -> float:
    """Give the second of the three principal standard deviations, of the inner part of a face."""
    values: Array = np.linalg.eigvalsh(np.cov(points.T))
    return float(np.sqrt(max(values[1], 0.0)))
