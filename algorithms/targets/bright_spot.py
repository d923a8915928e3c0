"""The centre of a bright spot: a blurred square or rectangle, and the beam's tail beside it, by least squares."""

from dataclasses import dataclass

import numpy as np
from scipy import special, stats
from scipy.optimize import least_squares

from algorithms.arrays import Array, Matrix3, Scalars, Vector3, Vectors2
from algorithms.targets.options import TargetKind
from algorithms.targets.seen_cloud import SeenCloud
from algorithms.targets.tangent_plane import TangentPlane, plane_across, plane_through

POINTS_OF_A_PLANE = 12
"""Of fewer pixels the target is taken to face the instrument."""
INNER_SHARE = 0.25
"""Pixels within so much of the spot's height from its top lie on the target as a whole."""
POINTS_OF_A_TAIL = 30
"""Pixels that a tail is told from."""
TAIL_SIGNIFICANCE, MOST_TAIL = 0.001, 0.4
STRIPS = 12
"""Of a cylinder."""
LEAST_STD_PX = 0.02
"""Of one pixel a centre is never known better: the raster itself repeats no better."""


@dataclass(frozen=True, eq=False)
class SpotFit:
    """A bright spot's centre, relative to the instrument."""

    centre_m: Vector3
    covariance_m2: Matrix3
    incidence_rad: float
    agreement: float
    """Share of the intensities' variance that the template explains."""
    rms: float
    """Residuals relative to the height of the spot."""
    contrast: float
    tail: float
    """Height of the tail relative to the spot; 0 where there is none."""


def fit_spot(
    cloud: SeenCloud,
    window: tuple[slice, ...],
    start: tuple[float, float],
    range_m: float,
    size_m: float,
    kind: TargetKind,
) -> SpotFit | None:
    """Measure the centre of a spot in a window of the raster.

    The directions of the window's pixels meet the target's plane where a square blurred by the beam should explain
    their intensities. An inhomogeneous beam draws a second, weaker one beside it along the horizontal circle, which is
    taken into the model where it explains significantly more: a centroid would be drawn towards it. Across the contour
    ranges are not averaged: the range is that of the target's own pixels.

    Parameters
    ----------
    cloud
        The scan about its instrument.
    window
        Rows and columns.
    start
        Row and column in the window near the centre.
    range_m
        Median range of the spot's pixels [m].
    size_m
        Side of the square, or width and height of the cylinder [m].
    kind
        Square or cylinder.

    Returns
    -------
    The fit, or None where the pixels do not tell a centre.
    """
    assert cloud.intensity is not None  # noqa: S101 - said to the type checker, tested by the caller
    index = cloud.index[window]
    there = index >= 0
    numbers = index[there]
    if len(numbers) < 9:
        return None
    directions = cloud.points[numbers] / cloud.ranges[numbers, None]
    values = cloud.intensity[numbers]
    rows, columns = np.nonzero(there)
    middle = _between_pixels(directions, rows, columns, start)
    # well inside the contour: farther out the range is a mixture with what is behind
    inner = values > values.max() - INNER_SHARE * (values.max() - np.median(values))
    outer = values > 0.5 * (values.max() + np.median(values))
    bright = inner if np.count_nonzero(inner) >= POINTS_OF_A_PLANE else outer
    own = cloud.ranges[numbers][bright]
    near_range = np.abs(own - range_m) < size_m
    own = own[near_range]
    if len(own) == 0:
        return None
    plane = _plane(cloud.points[numbers][bright], middle, own, kind)
    places, _ = plane.met_by(directions * range_m)
    step_m = range_m * cloud.step_rad
    seen = plane.met_by(middle[None, :] * range_m)[0][0]
    fit = _best(places, values, seen, size_m, step_m, kind)
    if fit is None or float(np.linalg.norm(fit[0][:2] - seen)) > size_m:
        return None
    solution, covariance, agreement, rms, tail = fit
    centre = plane.in_space(solution[:2])
    if kind is TargetKind.RETRO_CYLINDER:
        centre = _at_axis(centre, own, np.abs(places[bright][near_range, 0] - solution[0]), size_m)
    covariance = covariance + (LEAST_STD_PX * step_m) ** 2 * np.eye(2)
    level, height = float(solution[2]), float(solution[3])
    return SpotFit(
        centre_m=centre,
        covariance_m2=plane.covariance_of(solution[:2], covariance),
        incidence_rad=0.0 if kind is TargetKind.RETRO_CYLINDER else plane.incidence_rad,
        agreement=agreement,
        rms=rms,
        contrast=height / max(abs(2.0 * level + height), 1e-300),
        tail=tail,
    )


def _between_pixels(directions: Array, rows: Array, columns: Array, place: tuple[float, float]) -> Vector3:
    """Give the unit direction (3,) of a place between pixels: bilinear, by a plane through the directions around."""
    near = np.argsort((rows - place[0]) ** 2 + (columns - place[1]) ** 2)[:9]
    design = np.column_stack([np.ones(len(near)), rows[near] - place[0], columns[near] - place[1]])
    direction = np.linalg.lstsq(design, directions[near], rcond=None)[0][0]
    return np.asarray(direction / np.linalg.norm(direction))


def _plane(bright: Array, middle: Vector3, ranges: Scalars, kind: TargetKind) -> TangentPlane:
    """Give the plane in which the target is measured: its own where enough pixels show it, else that across the beam.

    A cylinder is seen as an upright rectangle whose plane turns with the instrument.
    """
    range_m = float(np.median(ranges))
    std = max(1.2533 * float(np.std(ranges)), 1e-4) / float(np.sqrt(len(ranges)))
    own = plane_through(bright) if kind is TargetKind.RETRO_SQUARE and len(bright) >= POINTS_OF_A_PLANE else None
    if own is not None and own.incidence_rad < np.deg2rad(70.0):
        return own
    place = middle * range_m
    if kind is TargetKind.RETRO_CYLINDER:
        normal = -np.array([place[0], place[1], 0.0]) / float(np.hypot(place[0], place[1]))
        across = np.array([-normal[1], normal[0], 0.0])
        return TangentPlane(place, normal, np.column_stack([across, np.array([0.0, 0.0, 1.0])]), std, std)
    return plane_across(place, std)


def _at_axis(centre: Vector3, ranges: Scalars, beside_m: Scalars, size_m: float) -> Vector3:
    """Move a place onto the axis of an upright cylinder: each pixel lies before it by what its place beside it tells.

    Parameters
    ----------
    centre
        (3,) the place, in the right direction [m].
    ranges
        (n,) ranges of pixels on the cylinder [m].
    beside_m
        (n,) horizontal distances of their beams from the axis [m].
    size_m
        Diameter [m].
    """
    length = float(np.linalg.norm(centre))
    horizontal = float(np.hypot(centre[0], centre[1])) / length
    radius = 0.5 * size_m
    depths = np.sqrt(np.maximum(radius**2 - np.minimum(beside_m, radius) ** 2, 0.0))
    return np.asarray(centre / length * float(np.mean(ranges + depths / horizontal)))


def _best(
    places: Vectors2, values: Scalars, start: Array, size_m: float, step_m: float, kind: TargetKind
) -> tuple[Array, Array, float, float, float] | None:
    """Fit without and with a tail, and take the tail where it is significant."""
    unit = float(np.ptp(values))
    if unit <= 0.0:
        return None
    level = float(np.median(values))
    first = np.array([start[0], start[1], level, unit, np.log(max(0.5 * step_m, 0.05 * size_m))])
    angles = (
        np.deg2rad([0.0, 22.5, 45.0, 67.5])
        if kind is TargetKind.RETRO_SQUARE and size_m > 4.0 * step_m
        else np.zeros(1)
    )
    free_turn = len(angles) > 1
    plain = None
    for angle in angles:
        trial = _fitted(places, values, np.append(first, angle), size_m, unit, kind, free_turn=free_turn, tail=False)
        if plain is None or trial[1] < plain[1]:
            plain = trial
    if plain is None:
        return None
    solution, omega, covariance = plain
    tail = 0.0
    n = len(values)
    if n >= POINTS_OF_A_TAIL:
        for side in (-1.0, 1.0):
            begin = np.concatenate([plain[0], [0.1, side * max(2.0 * step_m, 0.5 * size_m)]])
            other = _fitted(places, values, begin, size_m, unit, kind, free_turn=free_turn, tail=True)
            freedom = n - 8
            gain = (plain[1] - other[1]) / 2.0 / max(other[1] / freedom, 1e-300)
            if 0.0 < other[0][6] < MOST_TAIL and other[1] < omega and stats.f.sf(gain, 2, freedom) < TAIL_SIGNIFICANCE:
                solution, omega, covariance = other
                tail = float(other[0][6])
    whole = float(np.sum((values - values.mean()) ** 2))
    agreement = 1.0 - omega / whole
    rms = float(np.sqrt(omega / n)) / max(abs(float(solution[3])), 1e-300)
    return solution, covariance, agreement, rms, tail


def _fitted(
    places: Vectors2,
    values: Scalars,
    start: Array,
    size_m: float,
    unit: float,
    kind: TargetKind,
    *,
    free_turn: bool,
    tail: bool,
) -> tuple[Array, float, Array]:
    """Give the solution, its sum of squares, and the covariance (2, 2) of the centre."""
    free = np.ones(len(start), dtype=bool)
    free[5] = free_turn
    fixed = start.copy()

    def whole(x: Array) -> Array:
        out = fixed.copy()
        out[free] = x
        return out

    blur = float(start[4])

    def residuals(x: Array) -> Array:
        full = whole(x)
        # the blur is known to a factor of two or so: half a pixel, the beam
        return np.append((_model(full, places, size_m, kind, tail=tail) - values) / unit, 0.03 * (full[4] - blur))

    scale = np.array([size_m, size_m, unit, unit, 1.0, 1.0, 1.0, size_m])[: len(start)]
    fitted = least_squares(residuals, start[free], method="lm", x_scale=scale[free], max_nfev=400)
    solution = whole(fitted.x)
    misfits = np.asarray(fitted.fun)[:-1]
    design = np.asarray(fitted.jac)[:-1]
    inverse = np.linalg.pinv(design.T @ design + 1e-12 * np.diag(1.0 / scale[free] ** 2), hermitian=True)
    gain = design @ inverse
    leverage = np.minimum(np.einsum("ij,ij->i", gain, design), 0.95)
    meat = gain * (misfits / (1.0 - leverage))[:, None]
    return solution, float(np.sum(misfits**2)) * unit**2, np.asarray((meat.T @ meat)[:2, :2])


def _model(x: Array, places: Vectors2, size_m: float, kind: TargetKind, *, tail: bool) -> Scalars:
    """Give the intensities (n,) of level, height, blur and turn of a shape; with a tail, of a weaker one beside it."""

    def shape(offset: Vectors2) -> Scalars:
        if kind is TargetKind.RETRO_CYLINDER:
            return _cylinder(offset, x[4], size_m)
        return _square(offset, x[4], x[5], size_m)

    value = shape(places - x[:2])
    if tail:
        value = (1.0 - x[6]) * value + x[6] * shape(places - x[:2] - np.array([x[7], 0.0]))
    return np.asarray(x[2] + x[3] * value)


def _cylinder(offset: Vectors2, log_blur: float, size_m: float) -> Scalars:
    """Give an upright cylinder (n,): strips as bright as the cosine at which the beam meets them."""
    blur = np.sqrt(2.0) * np.exp(np.clip(log_blur, -20.0, 5.0))
    half = 0.5 * size_m
    edges = np.linspace(-1.0, 1.0, STRIPS + 1)
    brightness = np.sqrt(1.0 - (0.5 * (edges[1:] + edges[:-1])) ** 2)
    steps = special.erf((offset[:, :1] - half * edges) / blur)
    across = 0.5 * (steps[:, :-1] - steps[:, 1:]) @ brightness
    along = special.erf((offset[:, 1] + half) / blur) - special.erf((offset[:, 1] - half) / blur)
    return np.asarray(across * 0.5 * along)


def _square(offset: Vectors2, log_blur: float, turn: float, size_m: float) -> Scalars:
    cosine, sine = np.cos(turn), np.sin(turn)
    blur = np.sqrt(2.0) * np.exp(np.clip(log_blur, -20.0, 5.0))
    half = 0.5 * size_m
    out = np.ones(len(offset))
    for along in (offset @ np.array([cosine, sine]), offset @ np.array([-sine, cosine])):
        out = out * 0.5 * (special.erf((along + half) / blur) - special.erf((along - half) / blur))
    return out
